//! OBJ: `v`, `vt`, `vn`, `f` of any degree, `l` for dangling edges, `p` for isolated vertices, `usemtl` with a library and
//! images beside the mesh.
//!
//! Numbers are the shortest decimals that read back to the same `f64`, so to the same lattice point. The first layer of
//! texture coordinates, of normals and of colours go in, all others are left out. A vertex whose corners differ in their
//! colours is repeated: OBJ keeps colours at vertices.

use std::borrow::Cow;
use std::io::Write;

use super::sidecars::Sidecars;
use super::split::Split;
use super::{Census, WriteErrorKind, WriteWarning, mtl};
use crate::io::name;
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE};

pub(super) fn write<'m>(
    out: &mut impl Write,
    mesh: &'m Mesh,
    beside: &mut Sidecars<'m>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let mut warnings = Vec::new();
    let census = Census::of(mesh);
    let first = |kind: LayerKind| mesh.layers.iter().find(|l| l.kind == kind);
    let (uvs, normals, colours) = (first(LayerKind::Uv), first(LayerKind::Normal), first(LayerKind::Color));
    for layer in &mesh.layers {
        if ![uvs, normals, colours].into_iter().flatten().any(|l| std::ptr::eq(l, layer)) {
            warnings.push(WriteWarning::LayerLeftOut { layer: layer.name.clone(), count: layer.len() as u64 });
        }
    }
    let names = materials(mesh, beside, &mut warnings);
    if let (Some(library), false) = (beside.files.iter().find(|f| f.0.ends_with(".mtl")), names.is_empty()) {
        writeln!(out, "mtllib {}", library.0)?;
    }

    let coloured: Vec<&Layer> = colours.into_iter().collect();
    let split = Split::new(mesh, &coloured);
    if split.repeated(mesh) > 0 {
        warnings.push(WriteWarning::Repeated { count: split.repeated(mesh) });
    }
    if let Some(layer) = colours.filter(|l| l.width == 4) {
        let count = layer.values.chunks_exact(4).filter(|c| c[3] != 1.0).count() as u64;
        if count > 0 {
            warnings.push(WriteWarning::AlphaLeftOut { layer: layer.name.clone(), count });
        }
    }
    let mut line = Line::default();
    for (place, &v) in split.vertex.iter().enumerate() {
        line.begin(b"v");
        line.numbers(&mesh.positions[v as usize]);
        if let Some(layer) = colours {
            let value = split.values[0][place];
            if value != NO_VALUE {
                line.numbers(&layer.value(value)[..3]);
            }
        }
        line.end(out)?;
    }
    for (keyword, layer) in [(&b"vt"[..], uvs), (b"vn", normals)] {
        let Some(layer) = layer else { continue };
        if !layer.isolated.is_empty() {
            let (name, count) = (layer.name.clone(), layer.isolated.len() as u64);
            warnings.push(WriteWarning::PointValuesLeftOut { layer: name, count });
        }
        for value in layer.values.chunks_exact(layer.width as usize) {
            line.begin(keyword);
            line.numbers(value);
            line.end(out)?;
        }
    }
    let mut faces = Faces { mesh, split: &split, uvs, normals, line, normals_of_edges: 0 };
    // What has no material comes first: OBJ has no word to go back to none.
    let mut now = NO_VALUE;
    for f in 0..mesh.face_count() {
        if mesh.material.get(f).is_none_or(|&m| m == NO_VALUE) {
            faces.write(out, f)?;
        }
    }
    for (f, &material) in mesh.material.iter().enumerate().filter(|(_, m)| **m != NO_VALUE) {
        if material != now {
            now = material;
            out.write_all(b"usemtl ")?;
            out.write_all(&name::to_bytes(names.get(material as usize).map_or("unknown", String::as_str)))?;
            out.write_all(b"\n")?;
        }
        faces.write(out, f)?;
    }
    if faces.normals_of_edges > 0 {
        let layer = normals.map(|l| l.name.clone()).unwrap_or_default();
        warnings.push(WriteWarning::EdgeValuesLeftOut { layer, count: faces.normals_of_edges });
    }
    let mut line = faces.line;
    for &v in &census.isolated {
        line.begin(b"p");
        line.text.push(b' ');
        line.index(v);
        line.end(out)?;
    }
    Ok(warnings)
}

/// Prepare the library and the images; the names of the materials.
fn materials<'m>(mesh: &'m Mesh, beside: &mut Sidecars<'m>, warnings: &mut Vec<WriteWarning>) -> Vec<String> {
    let appearance = &mesh.appearance;
    if appearance.materials.is_empty() {
        if !appearance.images.is_empty() {
            warnings.push(WriteWarning::FilesLeftOut { count: appearance.images.len() as u64 });
        }
        return Vec::new();
    }
    let own = beside.own_name("mtl");
    let images = beside.images(mesh);
    let (text, names, simplified) = mtl::library(appearance, &images);
    match own {
        Some(name) => {
            beside.files.push((name, Cow::Owned(name::to_bytes(&text).into_owned())));
            let missing = appearance.images.iter().filter(|i| i.bytes.is_empty()).count() as u64;
            if missing > 0 {
                warnings.push(WriteWarning::ImagesMissing { count: missing });
            }
        }
        None => warnings.push(WriteWarning::FilesLeftOut { count: 1 + appearance.images.len() as u64 }),
    }
    if simplified > 0 {
        warnings.push(WriteWarning::MaterialsSimplified { count: simplified });
    }
    names
}

struct Faces<'m> {
    mesh: &'m Mesh,
    split: &'m Split,
    uvs: Option<&'m Layer>,
    normals: Option<&'m Layer>,
    line: Line,
    normals_of_edges: u64,
}

impl Faces<'_> {
    fn write(&mut self, out: &mut impl Write, f: usize) -> Result<(), WriteErrorKind> {
        let own = self.mesh.face_start[f] as usize..self.mesh.face_start[f + 1] as usize;
        let edge = own.len() == 2;
        let at = |layer: Option<&Layer>| layer.map_or(NO_VALUE, |l| l.corners[own.start]);
        let (has_uv, has_normal) = (at(self.uvs) != NO_VALUE, at(self.normals) != NO_VALUE && !edge);
        self.normals_of_edges += u64::from(edge && at(self.normals) != NO_VALUE);
        let line = &mut self.line;
        line.begin(if edge { b"l" } else { b"f" });
        for corner in own {
            // A line of very many corners is passed on in parts.
            if line.text.len() > 4096 {
                out.write_all(&line.text)?;
                line.text.clear();
            }
            line.text.push(b' ');
            line.index(self.split.corners[corner]);
            if let (Some(uvs), true) = (self.uvs, has_uv) {
                line.text.push(b'/');
                line.index(uvs.corners[corner]);
            }
            if let (Some(normals), true) = (self.normals, has_normal) {
                line.text.extend_from_slice(if has_uv { b"/" } else { b"//" });
                line.index(normals.corners[corner]);
            }
        }
        line.end(out)?;
        Ok(())
    }
}

/// A line on its way.
#[derive(Default)]
struct Line {
    text: Vec<u8>,
    float: Option<zmij::Buffer>,
}

impl Line {
    fn begin(&mut self, keyword: &[u8]) {
        self.text.clear();
        self.text.extend_from_slice(keyword);
    }

    fn numbers(&mut self, numbers: &[f64]) {
        let float = self.float.get_or_insert_with(zmij::Buffer::new);
        for &x in numbers {
            self.text.push(b' ');
            let text = float.format_finite(x);
            self.text.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
        }
    }

    /// A number of the format, which counts from 1.
    fn index(&mut self, i: u32) {
        let mut digits = [0; 11];
        let (mut at, mut rest) = (digits.len(), u64::from(i) + 1);
        while rest > 0 {
            at -= 1;
            digits[at] = b'0' + (rest % 10) as u8;
            rest /= 10;
        }
        self.text.extend_from_slice(&digits[at..]);
    }

    fn end(&mut self, out: &mut impl Write) -> Result<(), WriteErrorKind> {
        self.text.push(b'\n');
        out.write_all(&self.text)?;
        Ok(())
    }
}
