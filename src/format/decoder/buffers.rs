//! The level at hand as a renderer's buffers: triangles by index, vertices split where attributes differ, values written into buffers of
//! the caller's.
//!
//! A polygon `c0 c1 … cn` becomes the fan `(c0, c1, c2), (c0, c2, c3), …` in its own orientation; dangling edges are lines, vertices
//! that no element names are points. Degenerate faces have no area and are left out. Split vertices come in the order of the vertices
//! that they were split from, so that a vertex and its copies lie side by side.

use super::Decoder;
use crate::format::complex::{Faces, NONE, Wedges};
use std::ops::Range;
use thiserror::Error;

/// A level as triangles, lines and points over split vertices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RenderLevel {
    /// For each split vertex the vertex of the level that it is a copy of; non-decreasing.
    pub vertex: Vec<u32>,
    /// Three split vertices for each triangle, by material.
    pub triangles: Vec<u32>,
    /// The runs of [`RenderLevel::triangles`] with one material each, in increasing order of material, those without one last.
    pub groups: Vec<Group>,
    /// Two split vertices for each dangling edge.
    pub lines: Vec<u32>,
    /// Split vertices that no element names.
    pub points: Vec<u32>,
    /// For each layer and each split vertex its wedge, or [`NONE`].
    wedge: Vec<Vec<u32>>,
}

/// Triangles with one material.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The material's number in the file, if they have one.
    pub material: Option<u32>,
    /// Where in [`RenderLevel::triangles`] their indices stand.
    pub indices: Range<u32>,
}

/// How a quantized position becomes a coordinate: `offset + scale * q` on each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionTransform {
    /// Units of the model for each step of the level at hand.
    pub scale: f64,
    /// The coordinates of the quantized position 0 0 0.
    pub offset: [f64; 3],
}

/// A buffer or a layer that does not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BufferError {
    /// The buffer has another length.
    #[error("a buffer of {found} numbers for {needed}")]
    Length {
        /// The numbers that there are to write.
        needed: usize,
        /// The numbers that fit.
        found: usize,
    },
    /// The file has no such layer.
    #[error("layer {layer} of a file with {layers}")]
    Layer {
        /// The layer that was asked for.
        layer: usize,
        /// How many there are.
        layers: usize,
    },
    /// The level is not the one at hand.
    #[error("a level of {found} vertices where the level at hand has {needed}")]
    Level {
        /// Vertices of the level at hand.
        needed: usize,
        /// Vertices of the level that was given.
        found: usize,
    },
}

impl Decoder {
    /// The level at hand over split vertices: one for each combination of wedges that the corners of a vertex have.
    pub fn render_level(&self) -> RenderLevel {
        let (level, layers) = (self.complex(), &self.attributes().layers);
        let vertices = level.positions.len();
        let mut out = RenderLevel::default();
        let split = split_corners(vertices, &level.faces, layers, &mut out);
        let mut by_material: Vec<(u32, u32)> =
            (0..level.faces.len() as u32).map(|f| (self.material(f).unwrap_or(NONE), f)).collect();
        // Stable: the order of the elements within a material is that of the level.
        by_material.sort_by_key(|&(material, _)| material);
        for (material, f) in by_material {
            let corners = &split[level.faces.start[f as usize] as usize..level.faces.start[f as usize + 1] as usize];
            if let &[a, b] = corners {
                out.lines.extend([a, b]);
                continue;
            }
            let from = out.triangles.len() as u32;
            for pair in corners[1..].windows(2) {
                out.triangles.extend([corners[0], pair[0], pair[1]]);
            }
            let (material, to) = ((material != NONE).then_some(material), out.triangles.len() as u32);
            match out.groups.last_mut() {
                Some(group) if group.material == material => group.indices.end = to,
                _ => out.groups.push(Group { material, indices: from..to }),
            }
        }
        out
    }

    /// The material of element `f` of the level at hand.
    fn material(&self, f: u32) -> Option<u32> {
        let open = self.open.as_ref()?;
        let label = self.attributes().labels.get(f as usize).copied().unwrap_or(0);
        let labels = &open.index.header().attributes.labels;
        labels.get(label as usize).and_then(|label| label.material.checked_sub(1))
    }

    /// How the quantized positions of the level at hand become coordinates: a vertex lies in the middle of its cell while low bits are not
    /// known. `None` before the first level.
    pub fn position_transform(&self) -> Option<PositionTransform> {
        let open = self.open.as_ref()?;
        let lattice = open.index.header().lattice;
        let shift = open.state.level.shift as u32;
        let half = ((1u64 << shift) - 1) as f64 / 2.0;
        Some(PositionTransform {
            scale: lattice.step * (1u64 << shift) as f64,
            offset: lattice.origin.map(|c| c + half * lattice.step),
        })
    }

    /// Write the positions of split vertices, three numbers each, relative to `origin`: with an origin near the model `f32` is precise
    /// also for coordinates of a national grid.
    ///
    /// # Errors
    /// [`BufferError::Length`] unless `out` has `3 * level.vertex.len()` numbers; [`BufferError::Level`].
    pub fn write_positions(&self, level: &RenderLevel, origin: [f64; 3], out: &mut [f32]) -> Result<(), BufferError> {
        let positions = &self.complex().positions;
        self.check(level, 3, out.len())?;
        let Some(PositionTransform { scale, offset }) = self.position_transform() else { return Ok(()) };
        let from: [f64; 3] = std::array::from_fn(|k| offset[k] - origin[k]);
        for (out, &v) in out.chunks_exact_mut(3).zip(&level.vertex) {
            let p = positions[v as usize];
            for k in 0..3 {
                out[k] = (from[k] + scale * p[k] as f64) as f32;
            }
        }
        Ok(())
    }

    /// Write the quantized positions of split vertices, three numbers each; [`Decoder::position_transform`] says what they mean.
    ///
    /// # Errors
    /// [`BufferError::Length`] unless `out` has `3 * level.vertex.len()` numbers; [`BufferError::Level`].
    pub fn write_quantized_positions(&self, level: &RenderLevel, out: &mut [i32]) -> Result<(), BufferError> {
        let positions = &self.complex().positions;
        self.check(level, 3, out.len())?;
        for (out, &v) in out.chunks_exact_mut(3).zip(&level.vertex) {
            out.copy_from_slice(&positions[v as usize]);
        }
        Ok(())
    }

    /// Components of the values of layer `layer`, as many numbers as [`Decoder::write_layer`] writes for each split vertex.
    pub fn layer_width(&self, layer: usize) -> Option<usize> {
        let open = self.open.as_ref()?;
        open.index.header().attributes.layers.get(layer).map(|l| l.width as usize)
    }

    /// Write the values of a layer at split vertices, [`Decoder::layer_width`] numbers each; zeros where a vertex has none.
    ///
    /// # Errors
    /// [`BufferError::Layer`] for a layer that is not there, else as [`Decoder::write_positions`].
    pub fn write_layer(&self, level: &RenderLevel, layer: usize, out: &mut [f32]) -> Result<(), BufferError> {
        let layers = self.open.as_ref().map_or(&[][..], |open| &open.index.header().attributes.layers);
        let (Some(about), Some(wedges), Some(of)) =
            (layers.get(layer), self.attributes().layers.get(layer), level.wedge.get(layer))
        else {
            return Err(BufferError::Layer { layer, layers: layers.len() });
        };
        let width = about.width as usize;
        self.check(level, width, out.len())?;
        let mut value = [0.0; crate::mesh::MAX_WIDTH as usize];
        for (out, &w) in out.chunks_exact_mut(width.max(1)).zip(of) {
            if w == NONE {
                out.fill(0.0);
                continue;
            }
            about.quantizer.restore(about.kind, wedges.value(w), &mut value[..width]);
            out.iter_mut().zip(value).for_each(|(out, c)| *out = c as f32);
        }
        Ok(())
    }

    fn check(&self, level: &RenderLevel, width: usize, found: usize) -> Result<(), BufferError> {
        let vertices = self.complex().positions.len();
        let given = level.vertex.last().map_or(0, |&v| v as usize + 1);
        if given != vertices {
            return Err(BufferError::Level { needed: vertices, found: given });
        }
        let needed = level.vertex.len() * width;
        if needed == found { Ok(()) } else { Err(BufferError::Length { needed, found }) }
    }

    /// The vertices of the level at hand that do not stand in the level before, at the same number and place, as runs in increasing
    /// order; runs with fewer than `gap` unchanged vertices between them are joined. All of them where coordinates gained precision.
    pub fn changed_vertices(&self, gap: u32) -> Vec<Range<u32>> {
        let parents = self.parents();
        let refined = self.open.as_ref().is_some_and(|open| open.gained_precision);
        let stays = |v: usize| {
            let own = parents[v] == v as u32;
            let twin = parents.get(v + 1) == Some(&parents[v]) || (v > 0 && parents[v - 1] == parents[v]);
            own && !twin && !refined
        };
        let mut runs: Vec<Range<u32>> = Vec::new();
        for v in (0..parents.len()).filter(|&v| !stays(v)) {
            let v = v as u32;
            match runs.last_mut() {
                Some(run) if v - run.end <= gap => run.end = v + 1,
                _ => runs.push(v..v + 1),
            }
        }
        runs
    }
}

/// The split vertex of each corner; tells `out` of the split vertices.
fn split_corners(vertices: usize, faces: &Faces, layers: &[Wedges], out: &mut RenderLevel) -> Vec<u32> {
    // The corners of each vertex, by counting.
    let mut start = vec![0u32; vertices + 1];
    faces.corners.iter().for_each(|&v| start[v as usize + 1] += 1);
    for v in 0..vertices {
        start[v + 1] += start[v];
    }
    let mut next = start.clone();
    let mut list = vec![0u32; faces.corners.len()];
    for (corner, &v) in (0u32..).zip(&faces.corners) {
        list[next[v as usize] as usize] = corner;
        next[v as usize] += 1;
    }
    let key = |corner: u32| layers.iter().map(move |layer| layer.corner[corner as usize]);
    let mut of = vec![0u32; faces.corners.len()];
    out.wedge = vec![Vec::new(); layers.len()];
    for v in 0..vertices {
        let own = &mut list[start[v] as usize..start[v + 1] as usize];
        if own.is_empty() {
            out.points.push(out.vertex.len() as u32);
            out.vertex.push(v as u32);
            out.wedge.iter_mut().for_each(|layer| layer.push(NONE));
            continue;
        }
        own.sort_by(|&a, &b| key(a).cmp(key(b)));
        for same in own.chunk_by(|&a, &b| key(a).eq(key(b))) {
            let number = out.vertex.len() as u32;
            out.vertex.push(v as u32);
            out.wedge.iter_mut().zip(key(same[0])).for_each(|(layer, w)| layer.push(w));
            same.iter().for_each(|&corner| of[corner as usize] = number);
        }
    }
    of
}
