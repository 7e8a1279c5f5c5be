//! What quantization costs: how far vertices and values move, and which of them fall together.
//!
//! A loss is measured against the median distance of neighbours, which a few outliers do not change: it is they that
//! stretch the range on which all others then fall together.

use crate::format::container::LayerHeader;
use crate::mesh::lattice::Lattice;
use crate::mesh::quantizer::Quantizer;
use crate::mesh::{LayerKind, Mesh, NO_VALUE};
use rayon::prelude::*;
use std::fmt;

/// A vertex or value that moves by more than this part of the median distance of neighbours is worth a warning.
pub const PART: f64 = 0.5;

/// Elements whose edges are looked at, about.
const SAMPLED: usize = 1 << 18;

/// What quantization costs a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loss {
    /// How far the farthest vertex moves, in the units of the mesh.
    pub shift: f64,
    /// The distance of lattice planes.
    pub step: f64,
    /// Places of vertices that fall together with another place.
    pub merged: u64,
    /// The median length of edges that have one; 0 without edges.
    pub edge: f64,
    /// The layers whose values move far.
    pub layers: Vec<LayerLoss>,
}

/// What quantization costs a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerLoss {
    /// The layer.
    pub layer: String,
    /// What it is.
    pub kind: LayerKind,
    /// How far a value moves at most, in one number.
    pub shift: f64,
    /// The median difference of corners that follow each other, as far as they differ.
    pub median: f64,
}

/// A loss that is worth a line.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum LossWarning {
    /// Of positions.
    Positions(Loss),
    /// Of a layer.
    Layer(LayerLoss),
}

impl fmt::Display for LossWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LossWarning::Positions(loss) => {
                write!(f, "the lattice of step {} ", short(loss.step))?;
                if loss.merged > 0 {
                    write!(f, "makes {} places of vertices fall together with others and ", loss.merged)?;
                }
                write!(f, "moves vertices by up to {}", short(loss.shift))?;
                if loss.edge > 0.0 {
                    write!(f, ", where the median edge is {}", short(loss.edge))?;
                }
                write!(f, "; more --position-bits or a smaller --position-step keeps more")
            }
            LossWarning::Layer(LayerLoss { layer, kind, shift, median }) => {
                let option = match kind {
                    LayerKind::Uv => "more --uv-bits or a smaller --uv-step keeps more",
                    _ => "more --scalar-bits keep more",
                };
                let (shift, median) = (short(*shift), short(*median));
                write!(
                    f,
                    "layer {layer}: values move by up to {shift}, where the median difference of neighbours is {median}; {option}"
                )
            }
        }
    }
}

/// A number with four digits.
fn short(x: f64) -> String {
    let magnitude = x.abs();
    if magnitude == 0.0 || (1e-3..1e6).contains(&magnitude) {
        let digits = if magnitude == 0.0 { 0 } else { (3 - magnitude.log10().floor() as i32).max(0) as usize };
        let text = format!("{x:.digits$}");
        return if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text };
    }
    format!("{x:.3e}")
}

impl Loss {
    /// Measure what it costs `mesh` to have its vertices at `quantized` and its layers as `layers` say.
    pub(super) fn measure(mesh: &Mesh, lattice: &Lattice, quantized: &[[i32; 3]], layers: &[LayerHeader]) -> Self {
        let at = |v: u32| mesh.positions[v as usize];
        let edges = edges(mesh).map(|(_, [a, b])| {
            let (p, q) = (at(mesh.corners[a]), at(mesh.corners[b]));
            (0..3).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum::<f64>()
        });
        Loss {
            shift: lattice.largest_shift(&mesh.positions, quantized),
            step: lattice.step,
            merged: merged(&mesh.positions, quantized),
            edge: median(edges).sqrt(),
            layers: (0..layers.len()).filter_map(|l| layer_loss(mesh, l, &layers[l])).collect(),
        }
    }

    /// What of it is worth a line.
    pub fn warnings(&self) -> Vec<LossWarning> {
        let positions = self.merged > 0 || self.edge > 0.0 && self.shift > PART * self.edge;
        let layers = self.layers.iter().cloned().map(LossWarning::Layer);
        positions.then(|| LossWarning::Positions(self.clone())).into_iter().chain(layers).collect()
    }
}

/// Elements, evenly chosen where there are many, with the places of two corners that follow each other.
fn edges(mesh: &Mesh) -> impl Iterator<Item = (usize, [usize; 2])> + '_ {
    let stride = (mesh.face_count() / SAMPLED).max(1);
    (0..mesh.face_count()).step_by(stride).flat_map(move |f| {
        let (from, to) = (mesh.face_start[f] as usize, mesh.face_start[f + 1] as usize);
        (from..to).map(move |i| (f, [i, if i + 1 < to { i + 1 } else { from }]))
    })
}

/// The median of those that are more than 0; 0 without any.
fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut numbers: Vec<f64> = numbers.filter(|x| *x > 0.0).collect();
    if numbers.is_empty() {
        return 0.0;
    }
    let middle = numbers.len() / 2;
    *numbers.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// How many places there are more than lattice points that hold them.
fn merged(positions: &[[f64; 3]], quantized: &[[i32; 3]]) -> u64 {
    // Both zeros are one place.
    let place = |p: &[f64; 3]| p.map(|c| (c + 0.0).to_bits());
    let mut all: Vec<([i32; 3], [u64; 3])> = quantized.iter().copied().zip(positions.iter().map(place)).collect();
    all.par_sort_unstable();
    all.windows(2).filter(|w| w[0].0 == w[1].0 && w[0].1 != w[1].1).count() as u64
}

/// The loss of a layer, where it is worth a line. Colours have fixed steps, directions fixed bits: nothing stretches them.
fn layer_loss(mesh: &Mesh, number: usize, header: &LayerHeader) -> Option<LayerLoss> {
    let layer = &mesh.layers[number];
    if !matches!(layer.kind, LayerKind::Uv | LayerKind::Scalar) || !matches!(header.quantizer, Quantizer::Linear { .. })
    {
        return None;
    }
    let width = layer.width as usize;
    let moved = |&value: &u32| {
        let (value, mut back) = (layer.value(value), [0.0; 4]);
        let quantized = header.quantizer.quantize(layer.kind, value);
        header.quantizer.restore(layer.kind, &quantized[..width], &mut back[..width]);
        value.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let shift = layer.corners.par_iter().filter(|v| **v != NO_VALUE).map(moved).reduce(|| 0.0, f64::max);
    let difference = |[a, b]: [usize; 2]| {
        let (a, b) = (layer.corners[a], layer.corners[b]);
        let known = a != NO_VALUE && b != NO_VALUE;
        let apart = |c: usize| (layer.value(a)[c] - layer.value(b)[c]).abs();
        if known { (0..width).map(apart).fold(0.0, f64::max) } else { 0.0 }
    };
    let median = median(edges(mesh).map(|(_, pair)| difference(pair)));
    let loss = LayerLoss { layer: layer.name.clone(), kind: layer.kind, shift, median };
    (median > 0.0 && shift > PART * median).then_some(loss)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::{EncodeOptions, encode};
    use crate::mesh::{Layer, Stored};

    fn loss(mesh: &Mesh) -> Loss {
        encode(mesh, &EncodeOptions::default()).unwrap().report.loss
    }

    /// A grid of `n` by `n` vertices a step apart with texture coordinates of 0 to 1.
    fn grid(n: u32) -> Mesh {
        let mut mesh = Mesh::default();
        let at = |x: u32, y: u32| y * n + x;
        for y in 0..n {
            mesh.positions.extend((0..n).map(|x| [f64::from(x), f64::from(y), 0.0]));
        }
        for y in 1..n {
            (1..n).for_each(|x| mesh.push_face(&[at(x - 1, y - 1), at(x, y - 1), at(x, y), at(x - 1, y)]));
        }
        let values = mesh.positions.iter().flat_map(|p| [p[0] / f64::from(n), p[1] / f64::from(n)]).collect();
        let count = mesh.positions.len();
        mesh.layers = vec![Layer::per_vertex("uv", LayerKind::Uv, 2, Stored::F32, values, &mesh.corners, count)];
        mesh
    }

    #[test]
    fn an_ordinary_mesh_has_no_warning() {
        let loss = loss(&grid(17));
        assert_eq!((loss.merged, loss.edge), (0, 1.0));
        assert!(loss.shift > 0.0 && loss.shift <= loss.step, "{loss:?}");
        assert_eq!(loss.warnings(), []);
    }

    #[test]
    fn an_outlier_that_is_used_is_warned_of() {
        let mut mesh = grid(16);
        mesh.positions[0] = [-1e6, 0.0, 0.0];
        mesh.layers[0].values[0] = -1e5;
        let loss = loss(&mesh);
        assert!(loss.merged > 200 && loss.edge == 1.0, "{loss:?}");
        let lines: Vec<String> = loss.warnings().iter().map(ToString::to_string).collect();
        assert!(
            lines[0].starts_with("the lattice of step 244.2 makes 254 places of vertices fall together with others")
                && lines[0].ends_with("median edge is 1; more --position-bits or a smaller --position-step keeps more"),
            "{lines:?}"
        );
        assert!(
            lines[1].starts_with("layer uv: values move by up to ")
                && lines[1].ends_with("neighbours is 0.0625; more --uv-bits or a smaller --uv-step keeps more"),
            "{lines:?}"
        );
    }

    #[test]
    fn what_nothing_refers_to_changes_nothing() {
        let mesh = grid(16);
        let plain = encode(&mesh, &EncodeOptions::default()).unwrap().bytes;
        let mut other = mesh.clone();
        // A value that no corner names.
        other.layers[0].values.extend([-1e9, 1e9]);
        assert!(encode(&other, &EncodeOptions::default()).unwrap().bytes == plain);
        // A vertex that no element uses, within reach.
        other.positions.push([1e4, 0.0, 0.0]);
        let encoded = encode(&other, &EncodeOptions::default()).unwrap();
        assert_eq!((encoded.report.loss.merged, encoded.report.loss.step), (0, loss(&mesh).step));
        assert_eq!(encoded.report.vertices, 257);
    }

    #[test]
    fn numbers_are_short() {
        for (x, text) in [(0.0, "0"), (1.0, "1"), (0.0625, "0.0625"), (244.2002, "244.2"), (1e-9, "1.000e-9")] {
            assert_eq!(short(x), text);
        }
    }
}
