//! Scenes: which mesh stands where, and how often.

use glam::{DAffine3, DMat3, DMat4, DVec3};
use serde_json::Value;

use super::super::build::{Builder, Kind};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::super::warning::Layer;
use super::accessor::Accessor;
use super::json::{as_uint, in_range, index, list, numbers};
use super::{Document, top};

/// An affine map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matrix(DAffine3);

impl Matrix {
    pub const IDENTITY: Matrix = Matrix(DAffine3::IDENTITY);

    /// First `other`, then `self`.
    pub fn times(&self, other: &Matrix) -> Matrix {
        if *other == Matrix::IDENTITY { *self } else { Matrix(self.0 * other.0) }
    }

    #[inline]
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        self.0.transform_point3(p.into()).to_array()
    }

    /// Whether directions stay as they are.
    pub fn keeps_directions(&self) -> bool {
        self.0.matrix3 == DMat3::IDENTITY
    }

    /// A unit vector along the surface in its new place.
    pub fn tangent(&self, v: [f64; 3]) -> [f64; 3] {
        unit(self.0.transform_vector3(v.into()), v)
    }

    /// A unit normal in its new place: by the inverse transpose, which is the matrix of cofactors but for a factor.
    pub fn normal(&self, v: [f64; 3]) -> [f64; 3] {
        let DMat3 { x_axis: a, y_axis: b, z_axis: c } = self.0.matrix3;
        let cofactors = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b));
        let sign = if self.mirrors() { -1.0 } else { 1.0 };
        unit(cofactors * (sign * DVec3::from(v)), v)
    }

    /// True when it turns right hands into left ones.
    pub fn mirrors(&self) -> bool {
        self.0.matrix3.determinant() < 0.0
    }

    /// Scale, then rotate by the quaternion x, y, z, w, then translate.
    pub fn from_trs(t: [f64; 3], q: [f64; 4], s: [f64; 3]) -> Matrix {
        let [x, y, z, w] = q;
        // Written so that the identity comes out exactly, and a quaternion of another length than 1 still rotates.
        let norm = x * x + y * y + z * z + w * w;
        let k = if norm > 0.0 { 2.0 / norm } else { 0.0 };
        let columns = [
            [1.0 - k * (y * y + z * z), k * (x * y + w * z), k * (x * z - w * y)],
            [k * (x * y - w * z), 1.0 - k * (x * x + z * z), k * (y * z + w * x)],
            [k * (x * z + w * y), k * (y * z - w * x), 1.0 - k * (x * x + y * y)],
        ];
        let [a, b, c] = columns.map(DVec3::from);
        Matrix(DAffine3::from_cols(a * s[0], b * s[1], c * s[2], t.into()))
    }

    fn of_node(node: &Value) -> Result<Matrix, Kind> {
        if let Some(m) = numbers::<16>(node, "matrix")? {
            return Ok(Matrix(DAffine3::from_mat4(DMat4::from_cols_array(&m))));
        }
        let t = numbers(node, "translation")?.unwrap_or([0.0; 3]);
        let q = numbers(node, "rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let s = numbers(node, "scale")?.unwrap_or([1.0; 3]);
        Ok(Matrix::from_trs(t, q, s))
    }
}

/// `v` with length 1; `otherwise` where it has none.
fn unit(v: DVec3, otherwise: [f64; 3]) -> [f64; 3] {
    let length = v.length();
    if length > 0.0 && length.is_finite() { (v / length).to_array() } else { otherwise }
}

/// A mesh in its place.
pub(super) struct Instance {
    pub mesh: usize,
    pub matrix: Matrix,
}

/// The meshes of the default scene in their places, depth first.
///
/// Without a default scene the first one is taken; without scenes all nodes that are no children, and without nodes
/// every mesh once.
pub(super) fn instances(doc: &mut Document<'_>, b: &mut Builder) -> Result<Vec<Instance>, Fail> {
    let json = doc.json;
    let nodes = list(json, "nodes").at(top)?;
    let meshes = list(json, "meshes").at(top)?.len();
    if nodes.is_empty() {
        return Ok((0..meshes).map(|mesh| Instance { mesh, matrix: Matrix::IDENTITY }).collect());
    }
    let mut out = Vec::new();
    let mut seen = vec![false; nodes.len()];
    let mut stack: Vec<(usize, Matrix)> =
        roots(json, nodes)?.into_iter().rev().map(|n| (n, Matrix::IDENTITY)).collect();
    let mut skins = 0;
    while let Some((n, parent)) = stack.pop() {
        let at = || Place::Item(format!("nodes[{n}]"));
        if std::mem::replace(&mut seen[n], true) {
            let twice = "the node hangs on two others or on itself; mend the document".to_string();
            return Err(ReadErrorKind::Syntax(twice)).at(at);
        }
        let node = &nodes[n];
        let matrix = parent.times(&Matrix::of_node(node).at(at)?);
        if let Some(mesh) = index(node, "mesh", meshes, "meshes").at(at)? {
            let skinned = node.get("skin").is_some();
            skins += u64::from(skinned);
            // The place of a skinned mesh is that of its joints; its node's does not count.
            let matrix = if skinned { Matrix::IDENTITY } else { matrix };
            match node.pointer("/extensions/EXT_mesh_gpu_instancing") {
                Some(instancing) => {
                    for local in gpu_instances(doc, instancing, b, n)? {
                        out.push(Instance { mesh, matrix: matrix.times(&local) });
                    }
                }
                None => out.push(Instance { mesh, matrix }),
            }
        }
        for child in list(node, "children").at(at)?.iter().rev() {
            stack.push((node_number(child, nodes.len()).at(at)?, matrix));
        }
    }
    b.tally.drop_layer(Layer::Skins, skins);
    Ok(out)
}

fn node_number(value: &Value, count: usize) -> Result<usize, Kind> {
    let number = as_uint(value).ok_or_else(|| {
        ReadErrorKind::Syntax("a node number is not a whole number from 0; mend the document".to_string())
    })?;
    in_range(number, count, "nodes")
}

fn roots(json: &Value, nodes: &[Value]) -> Result<Vec<usize>, Fail> {
    let scenes = list(json, "scenes").at(top)?;
    if !scenes.is_empty() {
        let chosen = index(json, "scene", scenes.len(), "scenes").at(top)?.unwrap_or(0);
        let at = || Place::Item(format!("scenes[{chosen}]"));
        let roots = list(&scenes[chosen], "nodes").at(at)?;
        return roots.iter().map(|n| node_number(n, nodes.len()).at(at)).collect();
    }
    let mut child = vec![false; nodes.len()];
    for (n, node) in nodes.iter().enumerate() {
        let at = || Place::Item(format!("nodes[{n}]"));
        for c in list(node, "children").at(at)? {
            child[node_number(c, nodes.len()).at(at)?] = true;
        }
    }
    Ok((0..nodes.len()).filter(|&n| !child[n]).collect())
}

/// `EXT_mesh_gpu_instancing`: translations, rotations and scales of copies below the node.
fn gpu_instances(doc: &mut Document<'_>, instancing: &Value, b: &mut Builder, n: usize) -> Result<Vec<Matrix>, Fail> {
    let at = || Place::Item(format!("nodes[{n}].extensions.EXT_mesh_gpu_instancing"));
    let attributes = instancing.get("attributes").unwrap_or(&Value::Null);
    let mut count = None;
    let mut accessor = |key: &str, width: usize, doc: &mut Document<'_>| -> Result<Option<Accessor>, Fail> {
        let Some(value) = attributes.get(key) else { return Ok(None) };
        let wrong = || ReadErrorKind::Syntax(format!("`{key}` is not an accessor; mend the document"));
        let number = as_uint(value).ok_or_else(wrong).at(at)?;
        let a = if width == 3 {
            Accessor::new::<3>(doc, number, &mut b.budget)?
        } else {
            Accessor::new::<4>(doc, number, &mut b.budget)?
        };
        if *count.get_or_insert(a.count) != a.count {
            let differ = "its attributes differ in their counts; mend the document".to_string();
            return Err(ReadErrorKind::Syntax(differ)).at(at);
        }
        Ok(Some(a))
    };
    let translation = accessor("TRANSLATION", 3, doc)?;
    let rotation = accessor("ROTATION", 4, doc)?;
    let scale = accessor("SCALE", 3, doc)?;
    let count = count.unwrap_or(1);
    let (mut t, mut q, mut s) = (Vec::new(), Vec::new(), Vec::new());
    b.budget.take(count as u64 * size_of::<[f64; 22]>() as u64).at(at)?;
    if let Some(a) = translation {
        a.each(doc, |v| {
            t.push(v);
            Ok(())
        })?;
    }
    if let Some(a) = rotation {
        a.each(doc, |v| {
            q.push(v);
            Ok(())
        })?;
    }
    if let Some(a) = scale {
        a.each(doc, |v| {
            s.push(v);
            Ok(())
        })?;
    }
    let or = |v: Option<&[f64; 3]>, default: f64| v.copied().unwrap_or([default; 3]);
    let rotation = |i: usize| q.get(i).copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
    Ok((0..count).map(|i| Matrix::from_trs(or(t.get(i), 0.0), rotation(i), or(s.get(i), 1.0))).collect())
}
