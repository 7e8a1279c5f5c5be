//! A batch: the independent splits between two adjacent levels, as data in the numbering of the coarser level.
//!
//! The record is general: for each element around a split vertex it says which child gets it, and it lists every
//! triangle and dangling edge that appears. What the fans make implicit is the codec's business, not the operator's.
//! Invariants: `vertex` is strictly increasing; no element of the coarser level names two split vertices.

/// No vertex.
pub const NONE: u32 = u32::MAX;
/// Marks an element that a batch inserts.
pub const NEW: u32 = 1 << 31;

/// What becomes of an element around a vertex `v` that splits into `v1` and `v2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Side {
    /// `v` becomes `v1`.
    #[default]
    One = 0,
    /// `v` becomes `v2`.
    Two = 1,
    /// `v` becomes `v1, v2` in the order of the element: its degree grows by one.
    Grow12 = 2,
    /// `v` becomes `v2, v1`.
    Grow21 = 3,
}

impl Side {
    /// The side with the roles of the children exchanged.
    pub fn swapped(self) -> Self {
        match self {
            Side::One => Side::Two,
            Side::Two => Side::One,
            Side::Grow12 => Side::Grow21,
            Side::Grow21 => Side::Grow12,
        }
    }
}

/// A triangle that appears between the children of a split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Inserted {
    /// The third vertex, in the numbering of the coarser level.
    pub apex: u32,
    /// `false`: the triangle is `(v1, v2, apex)`; `true`: `(v2, v1, apex)`.
    pub reversed: bool,
}

/// How one vertex splits: connectivity only.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// One side for each element of the star, in the order of the star.
    pub sides: Vec<Side>,
    /// The triangles that appear, in canonical order.
    pub triangles: Vec<Inserted>,
    /// How many dangling edges `(v1, v2)` appear.
    pub edges: u32,
}

impl Split {
    /// Empty the record and make room for a star of `elements` elements.
    pub fn reset(&mut self, elements: usize) {
        self.sides.clear();
        self.sides.resize(elements, Side::One);
        self.triangles.clear();
        self.edges = 0;
    }

    /// Exchange the roles of the children.
    pub fn swap(&mut self) {
        for s in &mut self.sides {
            *s = s.swapped();
        }
        for t in &mut self.triangles {
            t.reversed = !t.reversed;
        }
    }
}

/// The splits that make a finer level out of a coarser one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batch {
    /// The vertices that split, strictly increasing.
    pub vertex: Vec<u32>,
    /// `v1 − v2` for each, in steps of the coarser level's shift.
    pub delta: Vec<[i32; 3]>,
    /// Split `i` owns `sides[side_start[i] .. side_start[i + 1]]`.
    pub side_start: Vec<u32>,
    /// One side for each element of the star of each split vertex.
    pub sides: Vec<Side>,
    /// Split `i` owns `triangles[triangle_start[i] .. triangle_start[i + 1]]`.
    pub triangle_start: Vec<u32>,
    /// The triangles that appear.
    pub triangles: Vec<Inserted>,
    /// Dangling edges that appear between the children of each split.
    pub edges: Vec<u32>,
    /// Vertices of the finer level that have no parent, in steps of the coarser level's shift.
    pub new_vertices: Vec<[i32; 3]>,
    /// The shift of the finer level; at most that of the coarser one.
    pub shift: u8,
    /// For each vertex of the finer level and each axis the bits that it gains; empty when the shift stays.
    pub low_bits: Vec<[u16; 3]>,
    /// Curvature compensation in 1/256 (see [`super::placement`]).
    pub alpha: u8,
    /// What becomes of the attributes.
    pub attributes: AttributeBatch,
}

impl Default for Batch {
    fn default() -> Self {
        Batch {
            vertex: Vec::new(),
            delta: Vec::new(),
            side_start: vec![0],
            sides: Vec::new(),
            triangle_start: vec![0],
            triangles: Vec::new(),
            edges: Vec::new(),
            new_vertices: Vec::new(),
            shift: 0,
            low_bits: Vec::new(),
            alpha: 0,
            attributes: AttributeBatch::default(),
        }
    }
}

impl Batch {
    /// Number of splits.
    pub fn len(&self) -> usize {
        self.vertex.len()
    }

    /// Whether nothing splits.
    pub fn is_empty(&self) -> bool {
        self.vertex.is_empty()
    }

    /// Append a split; `vertex` has to be larger than those before.
    pub fn push(&mut self, vertex: u32, split: &Split, delta: [i32; 3]) {
        self.vertex.push(vertex);
        self.delta.push(delta);
        self.sides.extend_from_slice(&split.sides);
        self.side_start.push(self.sides.len() as u32);
        self.triangles.extend_from_slice(&split.triangles);
        self.triangle_start.push(self.triangles.len() as u32);
        self.edges.push(split.edges);
    }

    /// Append the splits and low bits of `other`, whose vertices come after those here. `widths` are those of the layers.
    pub fn append(&mut self, other: &Batch, widths: &[usize]) {
        self.attributes.append(&other.attributes, self.sides.len(), widths);
        self.vertex.extend_from_slice(&other.vertex);
        self.delta.extend_from_slice(&other.delta);
        let (s, t) = (self.sides.len() as u32, self.triangles.len() as u32);
        self.sides.extend_from_slice(&other.sides);
        self.side_start.extend(other.side_start[1..].iter().map(|x| x + s));
        self.triangles.extend_from_slice(&other.triangles);
        self.triangle_start.extend(other.triangle_start[1..].iter().map(|x| x + t));
        self.edges.extend_from_slice(&other.edges);
        self.new_vertices.extend_from_slice(&other.new_vertices);
        self.low_bits.extend_from_slice(&other.low_bits);
    }

    /// Make room for exactly what `others` hold, so that appending them takes no more memory than they do.
    pub fn reserve(&mut self, others: &[Batch]) {
        let sum = |of: fn(&Batch) -> usize| others.iter().map(of).sum::<usize>();
        let (splits, low_bits) = (sum(|b| b.len()), sum(|b| b.low_bits.len()));
        self.vertex.reserve_exact(splits);
        self.delta.reserve_exact(splits);
        self.side_start.reserve_exact(splits);
        self.sides.reserve_exact(sum(|b| b.sides.len()));
        self.triangle_start.reserve_exact(splits);
        self.triangles.reserve_exact(sum(|b| b.triangles.len()));
        self.edges.reserve_exact(splits);
        self.low_bits.reserve_exact(low_bits);
    }

    /// The sides of split `i`.
    pub fn sides_of(&self, i: usize) -> &[Side] {
        &self.sides[self.side_start[i] as usize..self.side_start[i + 1] as usize]
    }

    /// The triangles of split `i`.
    pub fn triangles_of(&self, i: usize) -> &[Inserted] {
        &self.triangles[self.triangle_start[i] as usize..self.triangle_start[i + 1] as usize]
    }
}

/// What a batch does to a layer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WedgeBatch {
    /// For each entry of [`Batch::sides`] the wedge that the corner gets; for an element that grows, the wedge at the first child.
    pub star: Vec<u32>,
    /// For elements that grow: entry of [`Batch::sides`] and the wedge at the second child.
    pub grown: Vec<(u32, u32)>,
    /// For each element that appears (a split's triangles before its dangling edges) the wedges at the first child, the second, the apex.
    pub inserted: Vec<[u32; 3]>,
    /// Wedges of the coarser level that change their values.
    pub changed: Vec<u32>,
    /// Their values.
    pub changed_values: Vec<i32>,
    /// The values of the new wedges, which are named `NEW | i` until they join the level.
    pub fresh: Vec<i32>,
}

/// What a batch does to the attributes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AttributeBatch {
    /// Layer by layer.
    pub layers: Vec<WedgeBatch>,
    /// The labels of the elements that appear; empty where all have label 0.
    pub labels: Vec<u16>,
}

impl AttributeBatch {
    /// Append what `other` says, whose splits come behind. `sides` is how many sides came before; `widths` are those of the layers.
    pub(super) fn append(&mut self, other: &AttributeBatch, sides: usize, widths: &[usize]) {
        self.labels.extend_from_slice(&other.labels);
        for ((mine, its), &width) in self.layers.iter_mut().zip(&other.layers).zip(widths) {
            let base = (mine.fresh.len() / width.max(1)) as u32;
            let name = |w: u32| if w != NONE && w & NEW != 0 { w + base } else { w };
            mine.star.extend(its.star.iter().map(|&w| name(w)));
            mine.grown.extend(its.grown.iter().map(|&(i, w)| (i + sides as u32, name(w))));
            mine.inserted.extend(its.inserted.iter().map(|t| t.map(name)));
            mine.changed.extend_from_slice(&its.changed);
            mine.changed_values.extend_from_slice(&its.changed_values);
            mine.fresh.extend_from_slice(&its.fresh);
        }
    }
}
