//! What a viewer does with attributes, materials and images: levels with their wedges as they come, images fetched apart.
#![cfg(all(feature = "encode", feature = "samples"))]

use crate::common::small;
use lodestream::format::complex::NONE;
use lodestream::format::container::{FileIndex, Kind, Parsed};
use lodestream::format::decoder::{DecodeError, DecodeOptions, Decoder, Step};
use lodestream::samples::torus;
use small::{file, with_attributes};

fn front(bytes: &[u8]) -> FileIndex {
    match FileIndex::parse(bytes) {
        Ok(Parsed::Ready(front)) => front,
        other => panic!("{other:?}"),
    }
}

/// The place of the first chunk of a kind.
fn of(front: &FileIndex, kind: Kind) -> usize {
    front.chunks().iter().position(|c| c.kind == kind).unwrap()
}

#[test]
fn each_level_has_wedges_labels_and_as_much_of_the_appearance_as_arrived() {
    let mesh = with_attributes(torus(9, 8), 4);
    let bytes = file(&mesh, 11);
    let front = front(&bytes);
    let mut decoder = Decoder::new(DecodeOptions::default());
    assert!(decoder.appearance().is_none() && decoder.attributes().layers.is_empty());
    // All but the images.
    let images = front.chunks()[of(&front, Kind::Image)].offset as usize;
    decoder.push(&bytes[..images]);
    let announced = front.header().attributes.clone();
    let mut wedges = vec![0; announced.layers.len()];
    while let Step::Level(l) = decoder.next_level().unwrap() {
        let (faces, attributes) = (decoder.faces(), decoder.attributes());
        assert_eq!(attributes.labels.len(), faces.len(), "level {l}");
        assert_eq!(attributes.layers.len(), announced.layers.len());
        for (k, layer) in attributes.layers.iter().enumerate() {
            assert_eq!(layer.corner.len(), faces.corners.len());
            assert!(layer.len() >= wedges[k], "wedges never go");
            wedges[k] = layer.len();
            // A wedge belongs to one vertex, and is missing exactly where the label leaves the layer out.
            let mut vertex = vec![NONE; layer.len()];
            for (f, corners) in faces.iter().enumerate() {
                let has = announced.labels[attributes.labels[f] as usize].layers >> k & 1 == 1;
                for (&v, &w) in corners.iter().zip(&layer.corner[faces.start[f] as usize..]) {
                    assert_eq!(w != NONE, has);
                    if has {
                        let known = &mut vertex[w as usize];
                        assert!(*known == NONE || *known == v);
                        *known = v;
                    }
                }
            }
        }
    }
    let full: Vec<usize> = announced.layers.iter().map(|l| l.wedges as usize).collect();
    assert_eq!(wedges, full);
    let appearance = decoder.appearance().unwrap();
    assert_eq!((&appearance.materials, &appearance.textures), (&mesh.appearance.materials, &mesh.appearance.textures));
    assert_eq!(appearance.images[1].mime, "image/jpeg");
    assert!(appearance.images[1].bytes.is_empty());
    decoder.push(&bytes[images..]);
    assert_eq!(decoder.next_level(), Ok(Step::Full));
    assert_eq!(decoder.appearance(), Some(&mesh.appearance));
}

#[test]
fn materials_and_images_may_be_fetched_apart() {
    let mesh = with_attributes(torus(9, 8), 4);
    let bytes = file(&mesh, 11);
    let front = front(&bytes);
    let payload = |k: usize| {
        let payload = front.payload(&bytes, k).unwrap().unwrap().to_vec();
        front.check_chunk(k, &payload).unwrap();
        (front.chunks()[k], payload)
    };
    let (materials, image) = (of(&front, Kind::Appearance), of(&front, Kind::Image) + 1);
    let mut decoder = Decoder::new(DecodeOptions::default());
    // The front, then what is to be seen first; an image says nothing without the materials.
    decoder.push(&bytes[..front.chunks()[0].offset as usize]);
    assert_eq!(decoder.next_level(), Ok(Step::NeedBytes));
    let (info, bytes_of_image) = payload(image);
    assert!(matches!(
        Decoder::new(DecodeOptions::default()).offer(info, bytes_of_image.clone()),
        Err(DecodeError::Corrupt { .. })
    ));
    let (info_of_materials, texts) = payload(materials);
    decoder.offer(info_of_materials, texts.clone()).unwrap();
    decoder.offer(info, bytes_of_image).unwrap();
    decoder.offer(info_of_materials, texts).unwrap();
    assert_eq!(decoder.appearance(), Some(&mesh.appearance));
    // Then all of the file, in which they are once more.
    decoder.push(&bytes[front.chunks()[0].offset as usize..]);
    while let Step::Level(_) = decoder.next_level().unwrap() {
        decoder.to_mesh().validate().unwrap();
    }
    decoder.finish().unwrap();
    assert_eq!(decoder.appearance(), Some(&mesh.appearance));
    // What is not a chunk of the file is said to be none.
    let (_, mut damaged) = payload(image);
    damaged[0] ^= 1;
    assert!(front.check_chunk(image, &damaged).is_err());
    assert!(front.check_chunk(image, &damaged[1..]).is_err());
    assert!(front.check_chunk(1000, &damaged).is_err());
}
