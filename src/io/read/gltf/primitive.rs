//! Primitives: runs of indices into faces, edges and points, in all seven modes.
//!
//! Primitives of one mesh that share an accessor of positions share its vertex records.

use serde_json::Value;

use super::super::build::{Builder, Kind};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::super::warning::{Layer, Warning};
use super::accessor::Accessor;
use super::attribute::{Emitted, Source, Wanted};
use super::json::{in_range, list, uint};
use super::scene::Matrix;
use super::{Document, draco, top};
use crate::mesh::NO_VALUE;

/// `primitive.mode`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Points,
    Lines,
    LineLoop,
    LineStrip,
    Triangles,
    TriangleStrip,
    TriangleFan,
}

impl Mode {
    fn parse(code: u64) -> Result<Self, Kind> {
        Ok(match code {
            0 => Mode::Points,
            1 => Mode::Lines,
            2 => Mode::LineLoop,
            3 => Mode::LineStrip,
            4 => Mode::Triangles,
            5 => Mode::TriangleStrip,
            6 => Mode::TriangleFan,
            _ => return Err(ReadErrorKind::Syntax(format!("{code} is not a mode of primitives; mend the document"))),
        })
    }

    /// The most faces and corners that `n` indices make.
    fn elements(self, n: usize) -> (usize, usize) {
        match self {
            Mode::Points => (0, 0),
            Mode::Lines => (n / 2, n),
            Mode::LineLoop | Mode::LineStrip => (n, n.saturating_mul(2)),
            Mode::Triangles => (n / 3, n),
            Mode::TriangleStrip | Mode::TriangleFan => (n, n.saturating_mul(3)),
        }
    }

    /// True when `n` indices leave some over, or are too few for one element.
    fn incomplete(self, n: usize) -> bool {
        match self {
            Mode::Points => false,
            Mode::Lines => !n.is_multiple_of(2),
            Mode::LineLoop | Mode::LineStrip => n == 1,
            Mode::Triangles => !n.is_multiple_of(3),
            Mode::TriangleStrip | Mode::TriangleFan => n == 1 || n == 2,
        }
    }
}

struct Primitive {
    mode: Mode,
    /// Which of the mesh's runs of positions.
    positions: usize,
    indices: Option<Accessor>,
    attributes: Vec<Source>,
    material: u32,
}

/// A checked mesh: what one instance of it holds.
pub(super) struct MeshPlan {
    number: usize,
    positions: Vec<Accessor>,
    primitives: Vec<Primitive>,
    /// Vertex records of one instance.
    pub records: usize,
    /// The most faces of one instance.
    pub faces: usize,
    /// The most corners of one instance.
    pub corners: usize,
}

impl MeshPlan {
    /// Check mesh `number`, load its buffers and count what is left out.
    pub fn new(doc: &mut Document<'_>, number: usize, wanted: &mut Wanted, b: &mut Builder) -> Result<Self, Fail> {
        let json = doc.json;
        let mesh = &list(json, "meshes").at(top)?[number];
        let at = || Place::Item(format!("meshes[{number}]"));
        let mut plan =
            MeshPlan { number, positions: Vec::new(), primitives: Vec::new(), records: 0, faces: 0, corners: 0 };
        let mut numbers: Vec<u64> = Vec::new();
        let mut incomplete = 0;
        for (p, primitive) in list(mesh, "primitives").at(at)?.iter().enumerate() {
            let at = || Place::Item(format!("meshes[{number}].primitives[{p}]"));
            let accessors = list(json, "accessors").at(top)?;
            let mut mode = uint(primitive, "mode").and_then(|m| Mode::parse(m.unwrap_or(4))).at(at)?;
            let empty = Value::Null;
            let attributes = primitive.get("attributes").unwrap_or(&empty);
            let packed = draco::unpack(doc, primitive, at, &mut b.budget)?;
            if packed.is_some() && mode == Mode::TriangleStrip {
                // Draco gives triangles, whatever they were.
                mode = Mode::Triangles;
            }
            // Without positions there is nothing to see; the specification says to skip it.
            let Some(position) = uint(attributes, "POSITION").at(at)? else { continue };
            let identity = doc.replaced.get(&position).map_or(position, |r| r.identity);
            let run = match numbers.iter().position(|&n| n == identity) {
                Some(run) => run,
                None => {
                    let a = Accessor::new::<3>(doc, position, &mut b.budget)?;
                    plan.records = plan.records.saturating_add(a.count);
                    numbers.push(identity);
                    plan.positions.push(a);
                    numbers.len() - 1
                }
            };
            let indices = match uint(primitive, "indices").at(at)? {
                _ if packed.is_some() => packed,
                Some(n) => {
                    in_range(n, accessors.len(), "accessors").at(at)?;
                    let a = Accessor::new::<1>(doc, n, &mut b.budget)?;
                    if !a.is_unsigned() {
                        let wrong = "indices are not unsigned whole numbers; mend the document".to_string();
                        return Err(ReadErrorKind::Syntax(wrong)).at(|| a.place());
                    }
                    Some(a)
                }
                None => None,
            };
            let records = plan.positions[run].count;
            let n = indices.as_ref().map_or(records, |a| a.count);
            let (faces, corners) = mode.elements(n);
            plan.faces = plan.faces.saturating_add(faces);
            plan.corners = plan.corners.saturating_add(corners);
            incomplete += u64::from(mode.incomplete(n));
            let materials = list(json, "materials").at(top)?.len();
            let material = uint(primitive, "material").at(at)?.filter(|_| !b.drop.materials);
            let there = material.is_none_or(|m| m < materials as u64);
            b.tally.drop_layer(Layer::Materials, u64::from(!there));
            let kept = b.appearance.materials.len() as u64;
            let material = material.filter(|m| *m < kept).map_or(NO_VALUE, |m| m as u32);
            let attributes = wanted.sources(doc, attributes, records, b)?;
            doc.replaced.clear();
            left_out(primitive, b);
            plan.primitives.push(Primitive { mode, positions: run, indices, attributes, material });
        }
        if incomplete > 0 {
            b.tally.others.push(Warning::IncompletePrimitives { count: incomplete });
        }
        Ok(plan)
    }

    /// One instance of the mesh.
    pub fn emit(&self, doc: &Document<'_>, matrix: &Matrix, wanted: &Wanted, b: &mut Builder) -> Result<(), Fail> {
        let mut first = Vec::with_capacity(self.positions.len());
        let identity = *matrix == Matrix::IDENTITY;
        for run in &self.positions {
            first.push(b.records());
            let (mut block, mut held) = ([[0.0; 3]; 128], 0);
            run.each(doc, |p: [f64; 3]| {
                block[held] = if identity { p } else { matrix.apply(p) };
                held += 1;
                if held == block.len() {
                    held = 0;
                    return b.vertices(&block);
                }
                Ok(())
            })?;
            b.vertices(&block[..held]).at(|| run.place())?;
        }
        let mirrored = matrix.mirrors();
        let mut emitted = Emitted::default();
        for (i, primitive) in self.primitives.iter().enumerate() {
            let count = self.positions[primitive.positions].count;
            let at = || Place::Item(format!("meshes[{}].primitives[{i}]", self.number));
            b.use_material(primitive.material).at(at)?;
            let corner = b.corner_count();
            let mut elements = Elements::new(primitive.mode, mirrored, b);
            let base = first[primitive.positions];
            // Nearly all there is in the world: whole triangles, their indices side by side.
            let mut whole = false;
            if let (Mode::Triangles, Some(indices)) = (primitive.mode, &primitive.indices) {
                let done = indices.threes(doc, |[x, y, z]| {
                    let largest = x.max(y).max(z) as usize;
                    if largest >= count {
                        let first = [x, y, z].into_iter().map(|i| i as usize).find(|&i| i >= count);
                        return Err(outside(first.unwrap_or(largest), count));
                    }
                    // All records have been counted, so the sums fit.
                    let base = base as u32;
                    let t = elements.turned([base + x, base + y, base + z]);
                    elements.b.triangle(t)
                });
                if let Some(done) = done {
                    done?;
                    whole = true;
                }
            }
            match &primitive.indices {
                _ if whole => {}
                Some(indices) => indices.each(doc, |[index]: [f64; 1]| {
                    let index = index as usize;
                    if index >= count {
                        return Err(outside(index, count));
                    }
                    elements.put((base + index) as u32)
                })?,
                None => {
                    for v in base..base + count {
                        elements.put(v as u32).at(at)?;
                    }
                }
            }
            elements.end()?;
            if primitive.mode == Mode::Points {
                self.points(doc, primitive, base, wanted, b)?;
            }
            for source in &primitive.attributes {
                emitted.put(doc, source, matrix, wanted, [base, count], corner, b)?;
            }
        }
        Ok(())
    }
}

impl MeshPlan {
    /// Points have what their primitive has, even where others share their vertices and have more.
    fn points(
        &self,
        doc: &Document<'_>,
        primitive: &Primitive,
        base: usize,
        wanted: &Wanted,
        b: &mut Builder,
    ) -> Result<(), Fail> {
        for layer in wanted.others(&primitive.attributes) {
            let Builder { layers, budget, .. } = b;
            let list = &mut layers[layer].without;
            let mut put = |v: usize| {
                if list.len() == list.capacity() {
                    budget.grow(list, 1, "points")?;
                }
                list.push((base + v) as u32);
                Ok(())
            };
            match &primitive.indices {
                Some(indices) => indices.each(doc, |[index]: [f64; 1]| put(index as usize))?,
                None => {
                    let at = || Place::Item(format!("meshes[{}]", self.number));
                    (0..self.positions[primitive.positions].count).try_for_each(put).at(at)?;
                }
            }
        }
        Ok(())
    }
}

#[cold]
fn outside(index: usize, count: usize) -> Kind {
    let (index, vertices) = (index as i64, count as u64);
    ReadErrorKind::IndexOutOfRange { what: "a primitive", index, vertices, first: 0 }
}

/// Vertices in, elements out.
struct Elements<'b> {
    mode: Mode,
    mirrored: bool,
    b: &'b mut Builder,
    /// The vertices that the next element needs: those before, and for loops and fans the first.
    held: [u32; 2],
    count: usize,
    first: u32,
}

impl<'b> Elements<'b> {
    fn new(mode: Mode, mirrored: bool, b: &'b mut Builder) -> Self {
        Elements { mode, mirrored, b, held: [0; 2], count: 0, first: 0 }
    }

    #[inline]
    fn turned(&self, [x, y, z]: [u32; 3]) -> [u32; 3] {
        if self.mirrored { [x, z, y] } else { [x, y, z] }
    }

    #[inline]
    fn put(&mut self, v: u32) -> Result<(), Kind> {
        if self.count == 0 {
            self.first = v;
        }
        let [u, w] = self.held;
        self.held = [w, v];
        self.count += 1;
        match self.mode {
            Mode::Points => Ok(()),
            Mode::Lines if self.count.is_multiple_of(2) => self.b.edge(w, v),
            Mode::LineLoop | Mode::LineStrip if self.count >= 2 => self.b.edge(w, v),
            Mode::Triangles if self.count.is_multiple_of(3) => self.b.triangle(self.turned([u, w, v])),
            // Every other triangle of a strip is turned round; the specification keeps its first vertex first.
            Mode::TriangleStrip if self.count >= 3 => {
                let t = if self.count % 2 == 1 { [u, w, v] } else { [u, v, w] };
                self.b.strip_triangle(self.turned(t))
            }
            Mode::TriangleFan if self.count >= 3 => self.b.strip_triangle(self.turned([w, v, self.first])),
            _ => Ok(()),
        }
    }

    fn end(self) -> Result<(), Kind> {
        if self.mode == Mode::LineLoop && self.count > 2 {
            return self.b.edge(self.held[1], self.first);
        }
        Ok(())
    }
}

/// Count what a primitive has beside positions, indices, attributes and a material.
fn left_out(primitive: &Value, b: &mut Builder) {
    let targets = primitive.get("targets").and_then(Value::as_array).map_or(0, |t| t.len() as u64);
    b.tally.drop_layer(Layer::MorphTargets, targets);
}
