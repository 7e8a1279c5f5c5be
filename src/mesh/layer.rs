//! Attribute layers: values on corners.
//!
//! A layer is one attribute of one file: a set of texture coordinates, normals, colours, a scalar. Each corner of an element names one
//! of the layer's values; corners of one vertex that name equal values share a *wedge*, and an edge across which wedges differ is a *seam*.
//! Per-vertex data is the case without seams. An element has values at all of its corners or at none.

/// No value: at the corners of an element that a layer leaves out, and for an element without a material.
pub const NO_VALUE: u32 = u32::MAX;

/// The most components that a value has.
pub const MAX_WIDTH: u8 = 4;

/// What the values of a layer mean: decides how they are quantized, predicted and written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LayerKind {
    /// Texture coordinates, 2 components, with `v` upwards as in OBJ (glTF counts downwards; its reader and writer turn them).
    Uv,
    /// Unit normals, 3 components.
    Normal,
    /// Unit tangents, 3 components, and the sign of the bitangent, −1 or 1.
    Tangent,
    /// Colours, 3 components or 4 with alpha, in `0..=1` as the file has them (no transfer function applied).
    Color,
    /// Anything else, 1 to 4 components: quality, intensity, confidence, a time.
    #[default]
    Scalar,
}

/// How the file stored the numbers, so that a writer can give them back in kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Stored {
    /// 32-bit floating point, or decimal text.
    #[default]
    F32,
    /// 64-bit floating point.
    F64,
    /// Integers of 8 bits without sign (colours: 255 is 1.0).
    U8,
    /// Integers of 16 bits without sign (colours: 65,535 is 1.0).
    U16,
    /// Integers of 32 bits without sign.
    U32,
    /// Integers of 8 bits.
    I8,
    /// Integers of 16 bits.
    I16,
    /// Integers of 32 bits.
    I32,
}

impl Stored {
    /// Whether the numbers are integers.
    pub fn is_integer(self) -> bool {
        !matches!(self, Stored::F32 | Stored::F64)
    }
}

/// One attribute on the corners of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Its name in the file: `uv`, `uv1`, `normal`, `color`, `quality`; the `n`-th layer of texture coordinates (counted from 0) is
    /// what a material's `texCoord` number `n` means.
    pub name: String,
    /// What it means.
    pub kind: LayerKind,
    /// Components of a value, 1 to [`MAX_WIDTH`].
    pub width: u8,
    /// How the file stored the numbers.
    pub stored: Stored,
    /// The values, `width` numbers each.
    pub values: Vec<f64>,
    /// For each corner of the mesh its value, or [`NO_VALUE`] at all corners of an element.
    pub corners: Vec<u32>,
    /// Values of isolated vertices, which have no corners: vertex and value, in increasing order of vertex.
    pub isolated: Vec<[u32; 2]>,
}

impl Layer {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len() / self.width.max(1) as usize
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Value `i`, `width` numbers.
    pub fn value(&self, i: u32) -> &[f64] {
        let w = self.width as usize;
        &self.values[i as usize * w..(i as usize + 1) * w]
    }

    /// A layer with one value per vertex: `values` has `width` numbers for each of `vertices` vertices.
    pub fn per_vertex(
        name: &str,
        kind: LayerKind,
        width: u8,
        stored: Stored,
        values: Vec<f64>,
        mesh_corners: &[u32],
        vertices: usize,
    ) -> Self {
        let mut used = vec![false; vertices];
        mesh_corners.iter().for_each(|&v| used[v as usize] = true);
        let isolated = (0..vertices as u32).filter(|&v| !used[v as usize]).map(|v| [v, v]).collect();
        Layer { name: name.into(), kind, width, stored, values, corners: mesh_corners.to_vec(), isolated }
    }
}
