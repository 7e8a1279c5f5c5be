//! Surveys: how large the mesh in a file is going to be, before memory is spent on reading it.
//!
//! Headers tell where they can be trusted to; text is passed through once, in constant memory; where reading welds
//! equal positions (STL, glTF) their number is estimated within a few per cent. A survey never fails because of what a
//! file holds: a damaged file gets the counts that it shows, and reading it will tell what is wrong.

mod distinct;
mod gltf;
mod text;

use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::{DropSet, Format, Packing, ply};
use crate::image::jpeg::Working;
use crate::io::beside::{Folder, open_regular};
use crate::mesh::{LayerKind, Mesh};
use distinct::Distinct;
#[cfg(feature = "ingest")]
pub(crate) use gltf::drawn_images;

/// The kinds of layers in the order in which a survey counts them.
const KINDS: [LayerKind; 5] =
    [LayerKind::Uv, LayerKind::Normal, LayerKind::Tangent, LayerKind::Color, LayerKind::Scalar];

/// The attributes of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Values {
    /// Layers.
    pub layers: u64,
    /// Values of all layers.
    pub values: u64,
    /// Numbers of all values: two for each texture coordinate, three for each normal.
    pub numbers: u64,
}

impl Values {
    fn plus(self, other: Values) -> Values {
        Values {
            layers: self.layers.saturating_add(other.layers),
            values: self.values.saturating_add(other.values),
            numbers: self.numbers.saturating_add(other.numbers),
        }
    }
}

/// What reading a file is going to give.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Survey {
    /// Vertices after welding, where the format is welded.
    pub vertices: u64,
    /// Polygons and dangling edges.
    pub elements: u64,
    /// Corners of all elements.
    pub corners: u64,
    /// Vertex records before welding.
    pub records: u64,
    /// Bytes of the file after unpacking, and of the buffers beside it.
    pub unpacked: u64,
    /// Bytes of a JSON document that is parsed as a whole.
    pub document: u64,
    /// Bytes of the images inside the file.
    pub images: u64,
    /// What work on the largest image inside the file takes.
    pub working: Working,
    /// Attributes, by the place of their kind in `KINDS`; see [`Survey::carried`].
    pub(crate) attributes: [Values; 5],
    /// Whether the file itself was seen (or its header told all); else the counts are usual ones for its size.
    pub exact: bool,
}

impl Survey {
    /// All attributes but those of kinds that are dropped.
    pub fn carried(&self, drop: DropSet) -> Values {
        let kept = KINDS.iter().zip(&self.attributes).filter(|(kind, _)| !drop.kind(**kind));
        kept.fold(Values::default(), |sum, (_, values)| sum.plus(*values))
    }

    /// What a mesh is that has been read, from so many records.
    pub fn of_mesh(mesh: &Mesh, records: u64) -> Self {
        let mut survey = Survey {
            vertices: mesh.vertex_count() as u64,
            elements: mesh.face_count() as u64,
            corners: mesh.corners.len() as u64,
            records,
            exact: true,
            ..Survey::default()
        };
        for layer in &mesh.layers {
            survey.add(layer.kind, 1, layer.len() as u64, u64::from(layer.width));
        }
        for image in &mesh.appearance.images {
            let bytes = image.bytes.len() as u64;
            survey.images += bytes;
            survey.working = survey.working.and(Working::of(&mut &image.bytes[..], bytes));
        }
        survey
    }

    /// `layers` layers more, of `values` values of `width` numbers.
    fn add(&mut self, kind: LayerKind, layers: u64, values: u64, width: u64) {
        if let Some((_, own)) = KINDS.iter().zip(&mut self.attributes).find(|(k, _)| **k == kind) {
            *own = own.plus(Values { layers, values, numbers: values.saturating_mul(width) });
        }
    }

    /// What the header of a PLY says of attributes: as many values as vertices, or as corners.
    fn add_ply(&mut self, header: &ply::HeaderCounts) {
        for &(kind, width) in &header.layers {
            self.add(kind, 1, self.vertices, width);
        }
        for &(kind, width) in &header.face_layers {
            self.add(kind, 1, self.corners, width);
        }
    }
}

/// Bytes that the header of a PLY is looked for in.
const HEAD: usize = 1 << 16;

/// Survey a file of `format`; packed files are recognized.
///
/// # Errors
/// Those of the reader; damaged content is not one.
pub fn survey(input: impl Read + Seek, format: Format) -> io::Result<Survey> {
    survey_beside(input, format, None)
}

/// Survey a file by its path, with the buffers of a glTF beside it.
///
/// # Errors
/// Those of opening and reading the file.
pub fn survey_path(path: &Path, format: Format) -> io::Result<Survey> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    survey_beside(open_regular(path)?.0, format, Some(&Folder::new(folder, None)))
}

fn survey_beside(mut input: impl Read + Seek, format: Format, folder: Option<&Folder>) -> io::Result<Survey> {
    let size = input.seek(SeekFrom::End(0))?;
    input.seek(SeekFrom::Start(0))?;
    let mut magic = Vec::with_capacity(8);
    (&mut input).take(8).read_to_end(&mut magic)?;
    input.seek(SeekFrom::Start(0))?;
    if let Some(packing) = Packing::of(&magic) {
        let mut unpacked = packing.reader(BufReader::with_capacity(1 << 16, input));
        // Damaged data ends the survey where it ends reading.
        return Ok(stream(&mut unpacked, None, format).unwrap_or(Survey { unpacked: size, ..Survey::default() }));
    }
    match format {
        Format::Gltf | Format::Glb => gltf::survey(&mut BufReader::with_capacity(1 << 16, input), size, folder),
        _ => stream(&mut input, Some(size), format),
    }
}

/// Survey a file of `size` bytes of which only the first are at hand.
pub fn survey_head(head: &[u8], size: u64, format: Format) -> Survey {
    let usual = |bytes_per_vertex: u64, packed: u64| {
        let unpacked = size.saturating_mul(packed);
        let vertices = unpacked / bytes_per_vertex;
        let (elements, corners) = (vertices.saturating_mul(2), vertices.saturating_mul(6));
        Survey { vertices, elements, corners, records: vertices, unpacked, ..Survey::default() }
    };
    let per_vertex = match format {
        Format::Obj => 75,
        Format::Ply => 38,
        Format::Stl => 100,
        Format::Off => 60,
        Format::Gltf | Format::Glb => 48,
    };
    if Packing::of(head).is_some() {
        return usual(per_vertex, 3);
    }
    match format {
        Format::Ply => {
            let told = ply::survey_header(head).and_then(|h| h.binary_corners(size).map(|corners| (h, corners)));
            if let Some((h, corners)) = told {
                let edges = h.edges.min(size);
                let (vertices, elements, corners) = (h.vertices, h.faces.saturating_add(edges), corners + 2 * edges);
                let exact = true;
                let mut s = Survey {
                    vertices,
                    elements,
                    corners,
                    records: vertices,
                    unpacked: size,
                    exact,
                    ..Survey::default()
                };
                s.add_ply(&h);
                return s;
            }
        }
        Format::Stl if size.checked_sub(84).is_some_and(|body| body % 50 == 0) && !head.starts_with(b"solid") => {
            let faces = (size - 84) / 50;
            let (vertices, corners) = (faces / 2 + 2, 3 * faces);
            return Survey {
                vertices,
                elements: faces,
                corners,
                records: corners,
                unpacked: size,
                ..Survey::default()
            };
        }
        Format::Gltf | Format::Glb => {
            if let Ok(Some((doc, ..))) = gltf::document(&mut io::Cursor::new(head), head.len() as u64) {
                return Survey { unpacked: size, exact: false, ..gltf::counts(&doc, |_| None) };
            }
        }
        _ => {}
    }
    usual(per_vertex, 1)
}

/// Survey what a reader gives. `size`: bytes in all, where they are known.
fn stream(input: &mut dyn Read, size: Option<u64>, format: Format) -> io::Result<Survey> {
    let mut head = Vec::with_capacity(HEAD);
    (&mut *input).take(HEAD as u64).read_to_end(&mut head)?;
    let rest = |input: &mut dyn Read| match size {
        Some(size) => Ok(size),
        None => Ok::<u64, io::Error>(head.len() as u64 + io::copy(input, &mut io::sink())?),
    };
    let mut survey = match format {
        Format::Obj => text::obj(input, &head)?,
        Format::Off => text::off(input, &head)?,
        Format::Stl => stl(input, &head)?,
        Format::Ply => match ply::survey_header(&head) {
            None => Survey { unpacked: rest(input)?, ..Survey::default() },
            Some(h) => {
                let (corners, unpacked) = match h.ascii {
                    true => text::ply_faces(input, &head[h.body..], h.lines_before_faces, h.faces)?,
                    false => {
                        let unpacked = rest(input)?;
                        (h.binary_corners(unpacked).unwrap_or(3 * h.faces), unpacked)
                    }
                };
                let unpacked = if h.ascii { unpacked + h.body as u64 } else { unpacked };
                // Counts that the bytes have no room for are not going to be read.
                let edges = h.edges.min(unpacked);
                let (vertices, elements) = (h.vertices.min(unpacked), h.faces.min(unpacked) + edges);
                let corners = corners + 2 * edges;
                let corners = corners.min(unpacked);
                let mut s = Survey { vertices, elements, corners, records: vertices, unpacked, ..Survey::default() };
                s.add_ply(&h);
                s
            }
        },
        Format::Gltf | Format::Glb => {
            let mut all = head;
            input.read_to_end(&mut all)?;
            let size = all.len() as u64;
            gltf::survey(&mut io::Cursor::new(all), size, None)?
        }
    };
    survey.exact = true;
    Ok(survey)
}

/// STL of either kind.
fn stl(input: &mut dyn Read, head: &[u8]) -> io::Result<Survey> {
    let ascii = head.trim_ascii_start().starts_with(b"solid")
        && memchr::memmem::find(&head[..head.len().min(1024)], b"facet").is_some();
    if ascii || head.len() < 84 {
        return text::stl(input, head);
    }
    let (mut held, mut faces, mut places) = (head[84..].to_vec(), 0u64, Distinct::new());
    let mut total = head.len() as u64;
    let mut buffer = vec![0u8; 1 << 16];
    loop {
        let whole = held.len() / 50 * 50;
        for record in held[..whole].chunks_exact(50) {
            faces += 1;
            for corner in record[12..48].chunks_exact(12) {
                let word = |i: usize| u32::from_le_bytes([corner[i], corner[i + 1], corner[i + 2], corner[i + 3]]);
                places.add_point([word(0), word(4), word(8)]);
            }
        }
        held.drain(..whole);
        let n = input.read(&mut buffer)?;
        if n == 0 {
            break;
        }
        total += n as u64;
        held.extend_from_slice(&buffer[..n]);
    }
    let corners = 3 * faces;
    let vertices = places.count().min(corners);
    let (elements, records, exact) = (faces, corners, true);
    Ok(Survey { vertices, elements, corners, records, unpacked: total, exact, ..Survey::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::read::{ReadOptions, read_bytes};
    use crate::io::write::write_to;

    #[test]
    fn a_survey_foretells_what_reading_gives() {
        for (name, mesh) in [
            ("asteroid", crate::samples::asteroid(30, 1)),
            ("mixed", crate::samples::mixed(60, 60, 1)),
            ("soup", crate::samples::soup(2000, 4000, 1)),
        ] {
            for extension in ["obj", "ply", "stl", "glb"] {
                let format = Format::from_extension(extension).unwrap();
                let mut bytes = Vec::new();
                write_to(&mut bytes, format, &mesh, None).unwrap();
                let told = survey(io::Cursor::new(&bytes), format).unwrap();
                let read = read_bytes(&bytes, format, None, &ReadOptions::default()).unwrap();
                let near = |a: u64, b: usize| (a as f64 - b as f64).abs() <= 0.05 * b as f64 + 2.0;
                let what = format!("{name}.{extension}: {told:?}");
                assert!(near(told.vertices, read.mesh.vertex_count()), "{what}, read {}", read.mesh.vertex_count());
                assert!(near(told.corners, read.mesh.corners.len()), "{what}, read {}", read.mesh.corners.len());
                assert!(near(told.elements, read.mesh.face_count()), "{what}, read {}", read.mesh.face_count());
                assert!(near(told.records, read.map.len()), "{what}, read {}", read.map.len());
                assert_eq!(told.unpacked, bytes.len() as u64);
                let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
                io::Write::write_all(&mut packed, &bytes).unwrap();
                let packed = packed.finish().unwrap();
                assert_eq!(survey(io::Cursor::new(&packed), format).unwrap(), told, "{name}.{extension}.gz");
                let head = survey_head(&bytes[..bytes.len().min(1 << 16)], bytes.len() as u64, format);
                assert!(head.vertices > 0 && head.vertices < 8 * told.vertices, "{what}, by its head {head:?}");
            }
        }
    }

    #[test]
    fn damaged_files_are_surveyed_for_what_they_show() {
        for format in Format::ALL {
            for bytes in
                [&b""[..], b"x", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n", &[0x1f, 0x8b, 3]]
            {
                let told = survey(io::Cursor::new(bytes), format).unwrap();
                assert!(told.vertices <= 1000, "{told:?}");
                survey_head(bytes, 1000, format);
            }
        }
        let off = survey(io::Cursor::new(b"OFF\n1000000 2000000 0\n0 0 0\n"), Format::Off).unwrap();
        assert_eq!((off.vertices, off.elements), (1, 0));
    }
}
