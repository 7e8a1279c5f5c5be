//! The runs of numbers of which the binary chunk of a GLB is made.

use std::collections::BTreeSet;
use std::io::Write;
use std::ops::Range;

use serde_json::{Value, json};

use super::super::{WriteErrorKind, WriteWarning};
use super::{Scene, stored};
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE, Stored};

/// A part of the binary chunk; each begins at a multiple of four bytes.
pub(super) enum Part {
    Positions,
    /// Values of a layer, one per vertex.
    Attribute(usize),
    /// Triangles or edges of a run of faces.
    Faces(Range<usize>),
    /// Isolated vertices with the same layers.
    Points(u64),
    /// An image as it is.
    Image(usize),
}

/// A layer as an attribute.
pub(super) struct Attribute<'m> {
    pub layer: &'m Layer,
    /// Its place among the layers of the mesh.
    pub at: usize,
    /// Its name in the file.
    pub name: String,
    /// Its number among those of its kind.
    pub set: usize,
    /// One of U8, U16, I8, I16, F32.
    stored: Stored,
}

/// All layers as attributes.
pub(super) fn attributes<'m>(mesh: &'m Mesh, warnings: &mut Vec<WriteWarning>) -> Vec<Attribute<'m>> {
    let mut taken = BTreeSet::new();
    let mut out = Vec::with_capacity(mesh.layers.len());
    for (at, layer) in mesh.layers.iter().enumerate() {
        let set = mesh.layers[..at].iter().filter(|l| l.kind == layer.kind).count();
        let plain = match layer.kind {
            LayerKind::Uv => format!("TEXCOORD_{set}"),
            LayerKind::Color => format!("COLOR_{set}"),
            LayerKind::Normal if set == 0 => "NORMAL".to_string(),
            LayerKind::Tangent if set == 0 => "TANGENT".to_string(),
            _ => format!("_{}", layer.name.replace(char::is_control, "_")),
        };
        let mut name = plain.clone();
        while !taken.insert(name.clone()) {
            name.push('_');
        }
        let whole = |lo: f64, hi: f64| layer.values.iter().all(|x| x.fract() == 0.0 && (lo..=hi).contains(x));
        let stored = match (layer.kind, layer.stored) {
            (LayerKind::Color, Stored::U8 | Stored::U16) => layer.stored,
            (LayerKind::Scalar, Stored::U8) if whole(0.0, 255.0) => Stored::U8,
            (LayerKind::Scalar, Stored::U16) if whole(0.0, 65535.0) => Stored::U16,
            (LayerKind::Scalar, Stored::I8) if whole(-128.0, 127.0) => Stored::I8,
            (LayerKind::Scalar, Stored::I16) if whole(-32768.0, 32767.0) => Stored::I16,
            _ => Stored::F32,
        };
        if stored == Stored::F32 && layer.kind == LayerKind::Scalar {
            let count = layer.values.iter().filter(|&&x| f64::from(x as f32) != x).count() as u64;
            if count > 0 && !matches!(layer.stored, Stored::F32) {
                warnings.push(WriteWarning::ValuesRounded { layer: layer.name.clone(), count });
            }
        }
        out.push(Attribute { layer, at, name, set, stored });
    }
    out
}

impl Attribute<'_> {
    fn component(&self) -> (u16, usize) {
        match self.stored {
            Stored::I8 => (5120, 1),
            Stored::U8 => (5121, 1),
            Stored::I16 => (5122, 2),
            Stored::U16 => (5123, 2),
            _ => (5126, 4),
        }
    }

    /// Bytes of a vertex, a multiple of four.
    pub fn stride(&self) -> usize {
        (self.component().1 * self.layer.width as usize).next_multiple_of(4)
    }

    /// Its accessor, without the buffer view.
    pub fn accessor(&self, count: usize) -> Value {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][(self.layer.width as usize).clamp(1, 4) - 1];
        let mut accessor = json!({"componentType": self.component().0, "count": count, "type": kind});
        if self.layer.kind == LayerKind::Color && self.stored != Stored::F32 {
            accessor["normalized"] = json!(true);
        }
        accessor
    }

    /// The numbers of a value; `None`: there is none.
    fn numbers(&self, value: Option<&[f64]>) -> [f64; 4] {
        let mut out = [0.0; 4];
        if let Some(value) = value {
            out[..value.len()].copy_from_slice(value);
        }
        let unit = |v: [f64; 3]| {
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            // A direction has to be one.
            if length > 0.0 && length.is_finite() { v.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
        };
        match self.layer.kind {
            // Upwards here, downwards there.
            LayerKind::Uv if value.is_some() => [out[0], 1.0 - out[1], 0.0, 0.0],
            LayerKind::Normal if self.set == 0 => {
                let [x, y, z] = unit([out[0], out[1], out[2]]);
                [x, y, z, 0.0]
            }
            LayerKind::Tangent if self.set == 0 => {
                let [x, y, z] = unit([out[0], out[1], out[2]]);
                [x, y, z, if out[3] < 0.0 { -1.0 } else { 1.0 }]
            }
            LayerKind::Color => {
                let scale = match self.stored {
                    Stored::U8 => 255.0,
                    Stored::U16 => 65535.0,
                    _ => 1.0,
                };
                out.map(|x| x.clamp(0.0, 1.0) * scale)
            }
            _ => out,
        }
    }

    fn put(&self, record: &mut Vec<u8>, value: Option<&[f64]>) {
        let numbers = self.numbers(value);
        for &x in &numbers[..self.layer.width as usize] {
            match self.stored {
                Stored::U8 => record.push(x.round() as u8),
                Stored::I8 => record.push(x.round() as i8 as u8),
                Stored::U16 => record.extend_from_slice(&(x.round() as u16).to_le_bytes()),
                Stored::I16 => record.extend_from_slice(&(x.round() as i16).to_le_bytes()),
                _ => record.extend_from_slice(&(x as f32).to_le_bytes()),
            }
        }
        record.resize(record.len().next_multiple_of(4), 0);
    }
}

impl Part {
    /// Bytes, without what fills them up to a multiple of four.
    pub fn size(&self, scene: &Scene<'_>) -> u64 {
        let vertices = scene.split.vertex.len() as u64;
        match self {
            Part::Positions => 12 * vertices,
            Part::Attribute(at) => scene.attributes[*at].stride() as u64 * vertices,
            Part::Faces(run) => {
                let indices = |f: &u32| match scene.mesh.face(*f as usize).len() {
                    2 => 2,
                    n => 3 * (n as u64 - 2),
                };
                4 * scene.order[run.clone()].iter().map(indices).sum::<u64>()
            }
            Part::Points(mask) => 4 * scene.points.get(mask).map_or(0, |p| p.len() as u64),
            Part::Image(i) => scene.mesh.appearance.images[*i].bytes.len() as u64,
        }
    }

    pub fn write(&self, out: &mut impl Write, scene: &Scene<'_>, shift: &[f64; 3]) -> Result<(), WriteErrorKind> {
        let mesh = scene.mesh;
        match self {
            Part::Positions => {
                for &v in &scene.split.vertex {
                    for x in stored(&mesh.positions[v as usize], shift) {
                        out.write_all(&x.to_le_bytes())?;
                    }
                }
            }
            Part::Attribute(at) => {
                let attribute = &scene.attributes[*at];
                let mut record = Vec::with_capacity(16);
                for &i in &scene.split.values[*at] {
                    record.clear();
                    attribute.put(&mut record, (i != NO_VALUE).then(|| attribute.layer.value(i)));
                    out.write_all(&record)?;
                }
            }
            Part::Faces(run) => {
                for &f in &scene.order[run.clone()] {
                    let own = mesh.face_start[f as usize] as usize..mesh.face_start[f as usize + 1] as usize;
                    let face = &scene.split.corners[own];
                    if let [a, b] = *face {
                        out.write_all(&a.to_le_bytes())?;
                        out.write_all(&b.to_le_bytes())?;
                        continue;
                    }
                    for pair in face[1..].windows(2) {
                        for v in [face[0], pair[0], pair[1]] {
                            out.write_all(&v.to_le_bytes())?;
                        }
                    }
                }
            }
            Part::Points(mask) => {
                for v in scene.points.get(mask).into_iter().flatten() {
                    out.write_all(&v.to_le_bytes())?;
                }
            }
            Part::Image(i) => out.write_all(&mesh.appearance.images[*i].bytes)?,
        }
        let rest = self.size(scene).next_multiple_of(4) - self.size(scene);
        out.write_all(&[0; 3][..rest as usize])?;
        Ok(())
    }
}
