//! The level at hand in the units of the model.

use super::open::Open;
use crate::mesh::{Layer, Mesh, NO_VALUE};

impl Open {
    pub(super) fn positions(&self) -> Vec<[f64; 3]> {
        let (lattice, level) = (self.index.header().lattice, &self.state.level);
        let shift = level.shift as u32;
        let (scale, half) = ((1u64 << shift) as f64, ((1u64 << shift) - 1) as f64 / 2.0);
        level
            .positions
            .iter()
            .map(|p| std::array::from_fn(|k| lattice.origin[k] + (p[k] as f64 * scale + half) * lattice.step))
            .collect()
    }

    /// The level at hand as a mesh, with the degenerate faces when it is the full one.
    pub(super) fn to_mesh(&self) -> Mesh {
        let level = &self.state.level;
        let mut mesh = Mesh {
            positions: self.positions(),
            face_start: level.faces.start.clone(),
            corners: level.faces.corners.clone(),
            ..Mesh::default()
        };
        let full = self.at == Some(self.index.full_level());
        if let (Some(degenerate), true) = (&self.degenerate, full) {
            for f in degenerate.iter() {
                mesh.push_face(f);
            }
        }
        let extra = self.extra.as_ref().filter(|_| full);
        let isolated = extra.map_or(Vec::new(), |_| self.isolated(level));
        let announced = &self.index.header().attributes;
        for (l, (layer, wedges)) in announced.layers.iter().zip(&self.state.attributes.layers).enumerate() {
            let width = layer.width as usize;
            let mut values = vec![0.0; wedges.len() * width];
            for (out, value) in
                values.chunks_exact_mut(width.max(1)).zip(wedges.values.chunks_exact(wedges.width.max(1)))
            {
                layer.quantizer.restore(layer.kind, value, out);
            }
            let mut out = Layer {
                name: layer.name.clone(),
                kind: layer.kind,
                width: layer.width,
                stored: layer.stored,
                values,
                corners: wedges.corner.clone(),
                isolated: Vec::new(),
            };
            let add = |out: &mut Layer, value: &[i32]| {
                let at = out.values.len();
                out.values.resize(at + width, 0.0);
                layer.quantizer.restore(layer.kind, &value[..wedges.width], &mut out.values[at..]);
                (at / width.max(1)) as u32
            };
            if let Some(extra) = extra {
                for value in extra.corners.get(l).into_iter().flatten() {
                    let i = value.as_ref().map_or(NO_VALUE, |v| add(&mut out, v));
                    out.corners.push(i);
                }
                for (&v, value) in isolated.iter().zip(extra.isolated.get(l).into_iter().flatten()) {
                    if let Some(value) = value {
                        let i = add(&mut out, value);
                        out.isolated.push([v, i]);
                    }
                }
            }
            out.corners.resize(mesh.corners.len(), NO_VALUE);
            mesh.layers.push(out);
        }
        if announced.materials > 0 {
            let material =
                |label: u16| announced.labels.get(label as usize).map_or(NO_VALUE, |l| l.material.wrapping_sub(1));
            let complex = level.faces.len();
            mesh.material = if self.state.attributes.labels.is_empty() {
                vec![material(0); complex]
            } else {
                self.state.attributes.labels.iter().map(|&l| material(l)).collect()
            };
            let degenerate = extra.map_or(&[][..], |e| &e.labels);
            let more = mesh.face_count() - complex;
            mesh.material.extend((0..more).map(|f| material(degenerate.get(f).copied().unwrap_or(0))));
        }
        if let Some(appearance) = &self.images.appearance {
            mesh.appearance = appearance.clone();
        } else {
            // Its chunk has not arrived: a number alone is no material.
            mesh.material = Vec::new();
        }
        mesh
    }
}
