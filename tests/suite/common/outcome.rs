//! What a file decodes to, as lines of text with checksums. `golden.py` and `expected.py` in `tests/reference` write
//! the same lines.

use lodestream::format::decoder::{DecodeOptions, Decoder, Step};

/// Levels, vertices, faces (those that repeat a vertex included), and a checksum of every level's coordinates, elements
/// and parents, of the elements aside, and of the full mesh with its materials and images.
pub fn describe(name: &str, bytes: &[u8]) -> String {
    run(name, bytes, &mut |_| {})
}

/// A line for each level, with checksums of its positions, elements and attributes; one for elements aside; one for
/// each image; then the line of [`describe`], named `all`.
pub fn expected(name: &str, bytes: &[u8]) -> String {
    let mut out = String::new();
    let all = run(name, bytes, &mut |line| out += &line).replace(&format!("{name}: "), "all: ");
    out + &all
}

struct Sum(crc32fast::Hasher);

impl Sum {
    fn of(numbers: impl IntoIterator<Item = u32>) -> u32 {
        let mut sum = crc32fast::Hasher::new();
        numbers.into_iter().for_each(|n| sum.update(&n.to_le_bytes()));
        sum.finalize()
    }

    fn u32(&mut self, n: u32) {
        self.0.update(&n.to_le_bytes());
    }

    fn u64(&mut self, n: u64) {
        self.0.update(&n.to_le_bytes());
    }
}

fn level_line(number: usize, decoder: &Decoder) -> String {
    let (level, attributes) = (decoder.complex(), decoder.attributes());
    let positions = Sum::of(level.positions.iter().flatten().map(|&c| c as u32));
    let elements = Sum::of(level.faces.iter().flat_map(|f| std::iter::once(f.len() as u32).chain(f.iter().copied())));
    let labels = attributes.labels.iter().map(|&l| u32::from(l));
    let layers = attributes.layers.iter();
    let layers = layers.flat_map(|l| l.corner.iter().copied().chain(l.values.iter().map(|&x| x as u32)));
    let attributes = Sum::of(labels.chain(layers));
    let (vertices, faces, corners) = (level.positions.len(), level.faces.len(), level.faces.corners.len());
    let counts = format!("{vertices} vertices, {faces} elements, {corners} corners, shift {}", level.shift);
    format!("level {number}: {counts}, {positions:08x} {elements:08x} {attributes:08x}\n")
}

fn run(name: &str, bytes: &[u8], say: &mut dyn FnMut(String)) -> String {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    let mut sum = Sum(crc32fast::Hasher::new());
    let mut levels = 0;
    loop {
        match decoder.next_level().unwrap_or_else(|error| panic!("{name}: {error}")) {
            Step::Level(_) => levels += 1,
            Step::Full => break,
            Step::NeedBytes => panic!("{name}: it ends early"),
        }
        say(level_line(levels - 1, &decoder));
        let level = decoder.complex();
        sum.u32(level.shift as u32);
        level.positions.iter().flatten().for_each(|&c| sum.u32(c as u32));
        level.faces.start.iter().chain(&level.faces.corners).for_each(|&c| sum.u32(c));
        decoder.parents().iter().for_each(|&p| sum.u32(p));
        for layer in &decoder.attributes().layers {
            layer.corner.iter().for_each(|&w| sum.u32(w));
            layer.values.iter().for_each(|&x| sum.u32(x as u32));
        }
        decoder.attributes().labels.iter().for_each(|&l| sum.u32(l.into()));
    }
    if let Some(aside) = decoder.degenerate() {
        aside.start.iter().chain(&aside.corners).for_each(|&c| sum.u32(c));
        let numbers = aside.iter().flat_map(|f| std::iter::once(f.len() as u32).chain(f.iter().copied()));
        say(format!("aside: {} elements, {} corners, {:08x}\n", aside.len(), aside.corners.len(), Sum::of(numbers)));
    }
    decoder.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    let mesh = decoder.to_mesh();
    mesh.validate().unwrap_or_else(|error| panic!("{name}: {error}"));
    // Coordinates too, bit for bit.
    mesh.positions.iter().flatten().for_each(|c| sum.u64(c.to_bits()));
    for layer in &mesh.layers {
        layer.values.iter().for_each(|x| sum.u64(x.to_bits()));
        layer.corners.iter().chain(layer.isolated.as_flattened()).for_each(|&i| sum.u64(i.into()));
        layer.name.bytes().for_each(|b| sum.u64(b.into()));
    }
    mesh.material.iter().for_each(|&m| sum.u64(m.into()));
    let texts = [&mesh.appearance.materials, &mesh.appearance.textures, &mesh.appearance.samplers];
    texts.into_iter().flatten().for_each(|t| t.bytes().for_each(|b| sum.u64(b.into())));
    for (i, image) in mesh.appearance.images.iter().enumerate() {
        image.name.bytes().chain(image.mime.bytes()).for_each(|b| sum.u64(b.into()));
        image.bytes.iter().for_each(|&b| sum.u64(b.into()));
        say(format!("image {i}: {} bytes, {:08x}\n", image.bytes.len(), crc32fast::hash(&image.bytes)));
    }
    let (vertices, faces, layers) = (mesh.vertex_count(), mesh.face_count(), mesh.layers.len());
    let counts = format!("{levels} levels, {vertices} vertices, {faces} faces, {layers} layers");
    format!("{name}: {counts}, checksum {:08x}\n", sum.0.finalize())
}
