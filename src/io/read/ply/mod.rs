//! PLY, ASCII and binary: `vertex`, `face` of any degree, `tristrips` (−1 restarts) and `edge` as dangling edges.
//!
//! Elements come in the order of the header, which may put faces before vertices: vertex numbers are held against
//! the announced count. Every count is held against the bytes that are left before anything is made for it.
//! Vertices with texture coordinates repeat along seams, so such files are welded by default.
//!
//! Properties of vertices become layers (`attributes`), texture coordinates listed at faces one on corners; images
//! stand in comments `TextureFile`, and `texnumber` of a face counts them.

mod attributes;
mod fast;
mod header;
mod source;
#[cfg(test)]
mod tests;

use serde_json::json;

use super::appearance::Files;
use super::attribute::Wedges;
use super::build::{Builder, Kind, MAX, index_from_zero};
use super::error::{At, Fail, Place, ReadErrorKind};
use super::text::Cursor;
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};
use crate::io::beside::Folder;
use crate::mesh::{LayerKind, NO_VALUE};
use attributes::{Columns, FacePlan, VertexPlan};
use fast::{fast_faces, fast_vertices};
use header::{Element, Encoding, Header, Scalar};
use source::{Ascii, Binary, Source};

const LIST_NAMES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// What programs call the ends of an edge.
const EDGE_NAMES: [[&str; 2]; 9] = [
    ["vertex1", "vertex2"],
    ["vertex_1", "vertex_2"],
    ["vertex0", "vertex1"],
    ["vertex_0", "vertex_1"],
    ["v0", "v1"],
    ["v1", "v2"],
    ["vertex_a", "vertex_b"],
    ["start", "end"],
    ["source", "target"],
];

/// What an element means.
enum Role {
    Vertices(VertexPlan),
    Faces(FacePlan),
    /// The list of vertices.
    Strips(usize),
    /// The properties vertex1, vertex2.
    Edges([usize; 2]),
    Other,
}

pub(super) fn read(bytes: &[u8], folder: Option<&Folder>, options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut c = Cursor::new(bytes);
    let header = header::read(&mut c, bytes)?;
    let vertex = header.elements.iter().find(|e| e.name == "vertex");
    let weld = header.repeats.unwrap_or_else(|| vertex.is_some_and(attributes::has_texture_coordinates));
    let mut b = Builder::new(options, weld, bytes.len());
    textures(&mut b, folder, &header.textures)?;
    match header.encoding {
        Encoding::Ascii => {
            let mut source = Ascii(c);
            for element in &header.elements {
                read_element(&mut b, &mut source, &header, element, |_, _, _| Ok(false))?;
            }
            source.0.skip_space();
            trailing(&mut b, source.remaining());
        }
        Encoding::Little => read_binary::<false>(&mut b, bytes, c.offset(), &header)?,
        Encoding::Big => read_binary::<true>(&mut b, bytes, c.offset(), &header)?,
    }
    Ok(b.finish()?)
}

/// A material for each texture that the header names.
fn textures(b: &mut Builder, folder: Option<&Folder>, names: &[String]) -> Result<(), Kind> {
    if b.drop.materials {
        return Ok(());
    }
    let mut files = Files::new(folder);
    for (number, name) in names.iter().enumerate() {
        let image = files.image(b, name)?;
        let material = json!({
            "name": format!("material_{number}"),
            "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorTexture": {"index": number}, "metallicFactor": 0.0},
        })
        .to_string();
        b.budget.take(2 * material.len() as u64)?;
        b.appearance.materials.push(material);
        b.appearance.textures.push(json!({ "source": image }).to_string());
    }
    files.report(b);
    Ok(())
}

/// What the header of a PLY file tells of its size.
pub(super) struct HeaderCounts {
    pub vertices: u64,
    /// Faces, or the corners of strips.
    pub faces: u64,
    /// Edges, as an element of their own.
    pub edges: u64,
    pub ascii: bool,
    /// The first byte of the body.
    pub body: usize,
    /// Records, one a line, before those of the faces.
    pub lines_before_faces: u64,
    /// Kind and width of the layers of vertices, and of those of corners.
    pub layers: Vec<(LayerKind, u64)>,
    pub face_layers: Vec<(LayerKind, u64)>,
    /// Bytes of all binary records without the items of face lists, and bytes of an item.
    fixed: Option<(u64, u64)>,
}

impl HeaderCounts {
    /// Corners of all faces of a binary file of `size` bytes; `None` where other lists blur it.
    pub fn binary_corners(&self, size: u64) -> Option<u64> {
        let (fixed, item) = self.fixed?;
        Some(size.saturating_sub(self.body as u64).saturating_sub(fixed) / item.max(1))
    }
}

/// Look at the first bytes of a PLY file; `None` where they are no whole, sound header.
pub(super) fn survey_header(head: &[u8]) -> Option<HeaderCounts> {
    let mut c = Cursor::new(head);
    let header = header::read(&mut c, head).ok()?;
    let ascii = header.encoding == Encoding::Ascii;
    let mut counts = HeaderCounts {
        vertices: 0,
        faces: 0,
        edges: 0,
        ascii,
        body: c.offset(),
        lines_before_faces: 0,
        layers: Vec::new(),
        face_layers: Vec::new(),
        fixed: Some((0, 4)),
    };
    // What finds the layers for reading finds them here.
    let mut b = Builder::new(&ReadOptions::default(), false, 0);
    let kinds = |b: &mut Builder| b.layers.drain(..).map(|l| (l.kind, u64::from(l.width))).collect::<Vec<_>>();
    for element in &header.elements {
        let count = element.count;
        match element.name {
            "vertex" => {
                counts.vertices = count;
                if let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| element.scalar(name)) {
                    VertexPlan::new(&mut b, element, [x, y, z]);
                    counts.layers = kinds(&mut b);
                }
            }
            "face" | "tristrips" => {
                counts.faces = count;
                if let ("face", Some(list)) = (element.name, element.list(&LIST_NAMES)) {
                    FacePlan::new(&mut b, element, list);
                    counts.face_layers = kinds(&mut b);
                }
            }
            "edge" => counts.edges = count,
            _ => {}
        }
        if counts.faces == 0 {
            counts.lines_before_faces = counts.lines_before_faces.saturating_add(count);
        }
        let lists: Vec<_> = element.properties.iter().filter(|p| p.list.is_some()).collect();
        let mine = matches!(element.name, "face" | "tristrips") && lists.len() == 1;
        counts.fixed = match (counts.fixed, lists.as_slice()) {
            (Some((fixed, item)), []) => {
                Some((fixed.saturating_add(count.saturating_mul(element.least_bytes(header.encoding))), item))
            }
            (Some((fixed, _)), [list]) if mine => {
                let fixed = fixed.saturating_add(count.saturating_mul(element.least_bytes(header.encoding)));
                Some((fixed, list.scalar.size() as u64))
            }
            _ => None,
        };
    }
    if ascii {
        counts.fixed = None;
    }
    Some(counts)
}

fn read_binary<const BIG: bool>(b: &mut Builder, bytes: &[u8], pos: usize, header: &Header<'_>) -> Result<(), Fail> {
    let mut source = Binary::<BIG> { bytes, pos };
    for element in &header.elements {
        read_element(b, &mut source, header, element, |b, source, job| match job.role {
            Role::Vertices(plan) => fast_vertices(b, source, job.element, plan),
            Role::Faces(plan) if plan.bare() => fast_faces(b, source, job.element, plan.list, job.vertices),
            _ => Ok(false),
        })?;
    }
    trailing(b, source.remaining());
    Ok(())
}

fn trailing(b: &mut Builder, count: u64) {
    if count > 0 {
        b.tally.others.push(Warning::TrailingBytes { count });
    }
}

/// What an element holds, and which part of it means something.
fn role(b: &mut Builder, element: &Element<'_>) -> Result<Role, Kind> {
    let missing = |property: &str| {
        let name = element.name;
        ReadErrorKind::Syntax(format!("the element `{name}` has no {property}; add it to the header and the data"))
    };
    let scalar = |name: &str| element.scalar(name).ok_or_else(|| missing(&format!("property `{name}`")));
    let list = || element.list(&LIST_NAMES).ok_or_else(|| missing("list property `vertex_indices`"));
    Ok(match element.name {
        _ if element.count == 0 => Role::Other,
        "vertex" => Role::Vertices(VertexPlan::new(b, element, [scalar("x")?, scalar("y")?, scalar("z")?])),
        "face" => Role::Faces(FacePlan::new(b, element, list()?)),
        "tristrips" => Role::Strips(list()?),
        "edge" => match EDGE_NAMES.iter().find_map(|[a, b]| Some([element.scalar(a)?, element.scalar(b)?])) {
            Some(ends) => Role::Edges(ends),
            None => Role::Other,
        },
        _ => Role::Other,
    })
}

/// An element and what to do with it.
struct Job<'a> {
    element: &'a Element<'a>,
    role: &'a Role,
    /// The announced number of vertices.
    vertices: u64,
}

/// Read one element; `fast` may take it over by returning true.
fn read_element<S: Source>(
    b: &mut Builder,
    source: &mut S,
    header: &Header<'_>,
    element: &Element<'_>,
    fast: impl FnOnce(&mut Builder, &mut S, &Job<'_>) -> Result<bool, Fail>,
) -> Result<(), Fail> {
    let in_header = || Place::Line(element.line);
    let role = role(b, element).at(in_header)?;
    let least = element.least_bytes(header.encoding);
    // The last number of an ASCII file needs nothing behind it.
    let left = source.remaining() + u64::from(header.encoding == Encoding::Ascii);
    if element.count.saturating_mul(least) > left {
        let (what, count, bytes) = (format!("elements `{}`", element.name), element.count, source.remaining());
        return Err(ReadErrorKind::Count { what, count, bytes }).at(in_header);
    }
    if least == 0 {
        return Ok(());
    }
    let count = element.count as usize;
    let vertices = header.vertices;
    match role {
        Role::Vertices(_) => b.expect_records(count).at(in_header)?,
        Role::Faces(_) if element.count > MAX as u64 => {
            return Err(ReadErrorKind::TooLarge { what: "faces", limit: MAX as u64 }).at(in_header);
        }
        Role::Faces(_) => b.expect_faces(count, 0).at(in_header)?,
        _ => {}
    }
    // Without numbers of textures, there is one for all faces.
    let one = element.name != "edge" && !b.appearance.materials.is_empty();
    b.use_material(if one { 0 } else { NO_VALUE }).at(in_header)?;
    report(b, element, &role);
    if fast(b, source, &Job { element, role: &role, vertices })? {
        return Ok(());
    }
    match role {
        Role::Vertices(plan) => read_vertices(b, source, element, &plan),
        Role::Faces(plan) => read_faces(b, source, element, &plan, vertices),
        Role::Strips(list) => read_strips(b, source, element, list, vertices),
        Role::Edges(ends) => read_edges(b, source, element, ends, vertices),
        Role::Other => {
            for _ in 0..element.count {
                skip_properties(source, &element.properties)?;
            }
            Ok(())
        }
    }
}

fn skip_properties<S: Source>(source: &mut S, properties: &[header::Property<'_>]) -> Result<(), Fail> {
    for p in properties {
        let place = source.place();
        match p.list {
            None => source.skip(p.scalar, 1),
            Some(count) => list_length(source, count).and_then(|n| source.skip(p.scalar, n)),
        }
        .at(|| place)?;
    }
    Ok(())
}

#[inline]
fn list_length<S: Source>(source: &mut S, scalar: Scalar) -> Result<u64, Kind> {
    let n = source.whole(scalar)?;
    u64::try_from(n).map_err(|_| ReadErrorKind::Syntax(format!("a list of {n} items; mend the count")))
}

fn read_vertices<S: Source>(b: &mut Builder, source: &mut S, e: &Element<'_>, plan: &VertexPlan) -> Result<(), Fail> {
    let mut row = vec![0.0; e.properties.len()];
    for _ in 0..e.count {
        let place = source.place();
        for ((property, x), &used) in e.properties.iter().zip(&mut row).zip(&plan.used) {
            if used {
                *x = source.float(property.scalar).at(|| source.place())?;
            } else {
                skip_properties(source, std::slice::from_ref(property))?;
            }
        }
        b.vertex(plan.xyz.map(|k| row[k]))
            .at(|| if matches!(place, Place::Line(_)) { source.place() } else { place })?;
        for Columns { layer, properties } in &plan.columns {
            for &k in properties {
                b.value(*layer, row[k]).at(|| source.place())?;
            }
        }
    }
    plan.finish(b, e);
    Ok(())
}

/// Faces with all that they may have.
fn read_faces<S: Source>(
    b: &mut Builder,
    source: &mut S,
    e: &Element<'_>,
    plan: &FacePlan,
    vertices: u64,
) -> Result<(), Fail> {
    let mut wedges: Vec<Wedges> = plan.uvs.iter().map(|_| Wedges::default()).collect();
    let mut uvs: Vec<Vec<f64>> = plan.uvs.iter().map(|_| Vec::new()).collect();
    let mut partial = 0u64;
    for _ in 0..e.count {
        let first = b.corner_count();
        for (i, property) in e.properties.iter().enumerate() {
            if i == plan.list {
                let n = list_length(source, property.list.unwrap_or(Scalar::U8)).at(|| source.place())?;
                for _ in 0..n {
                    let index = source.whole(property.scalar).at(|| source.place())?;
                    let v = index_from_zero(index, vertices, "a face").at(|| source.place())?;
                    b.corner(v).at(|| source.place())?;
                }
            } else if let Some(k) = plan.uvs.iter().position(|uv| uv.0 == i) {
                let n = list_length(source, property.list.unwrap_or(Scalar::U8)).at(|| source.place())?;
                uvs[k].clear();
                source.floats(property.scalar, n, &mut uvs[k]).at(|| source.place())?;
            } else if plan.texture == Some(i) {
                let number = source.float(property.scalar).at(|| source.place())?;
                let known = number >= 0.0 && number < b.appearance.materials.len() as f64;
                b.use_material(if known { number as u32 } else { NO_VALUE }).at(|| source.place())?;
            } else {
                skip_properties(source, std::slice::from_ref(property))?;
            }
        }
        b.end_face().at(|| source.place())?;
        let corners = b.corner_count() - first;
        for (((_, layer), uvs), wedges) in plan.uvs.iter().zip(&uvs).zip(&mut wedges) {
            if uvs.len() == 2 * corners {
                b.wedges(*layer, first, uvs, wedges).at(|| source.place())?;
            } else {
                partial += u64::from(!uvs.is_empty() && corners > 0);
            }
        }
    }
    if partial > 0 {
        b.tally.others.push(Warning::PartialFaces { layer: "uv".to_string(), count: partial });
    }
    Ok(())
}

/// The strips of a `tristrips` element.
fn read_strips<S: Source>(
    b: &mut Builder,
    source: &mut S,
    e: &Element<'_>,
    list: usize,
    vertices: u64,
) -> Result<(), Fail> {
    let property = &e.properties[list];
    let count = property.list.unwrap_or(Scalar::U8);
    for _ in 0..e.count {
        skip_properties(source, &e.properties[..list])?;
        let n = list_length(source, count).at(|| source.place())?;
        read_strip(b, source, property.scalar, n, vertices)?;
        skip_properties(source, &e.properties[list + 1..])?;
    }
    Ok(())
}

/// Each vertex makes a triangle with the two before it, every other one turned round; −1 begins a new strip.
fn read_strip<S: Source>(b: &mut Builder, source: &mut S, item: Scalar, n: u64, vertices: u64) -> Result<(), Fail> {
    let (mut last, mut length) = ([0; 2], 0u64);
    for _ in 0..n {
        let index = source.whole(item).at(|| source.place())?;
        if index == -1 {
            length = 0;
            continue;
        }
        let v = index_from_zero(index, vertices, "a strip").at(|| source.place())?;
        if length >= 2 {
            let [u, w] = last;
            let triangle = if length % 2 == 0 { [u, w, v] } else { [w, u, v] };
            b.strip_triangle(triangle).at(|| source.place())?;
        }
        last = [last[1], v];
        length += 1;
    }
    Ok(())
}

fn read_edges<S: Source>(
    b: &mut Builder,
    source: &mut S,
    e: &Element<'_>,
    ends: [usize; 2],
    vertices: u64,
) -> Result<(), Fail> {
    for _ in 0..e.count {
        let mut edge = [0; 2];
        for (i, property) in e.properties.iter().enumerate() {
            match ends.iter().position(|&k| k == i) {
                Some(end) => {
                    let index = source.whole(property.scalar).at(|| source.place())?;
                    edge[end] = index_from_zero(index, vertices, "an edge").at(|| source.place())?;
                }
                None => skip_properties(source, std::slice::from_ref(property))?,
            }
        }
        b.edge(edge[0], edge[1]).at(|| source.place())?;
    }
    Ok(())
}

/// Name what an element has beside what is read.
fn report(b: &mut Builder, e: &Element<'_>, role: &Role) {
    let unknown: Vec<String> = match role {
        Role::Vertices(plan) => plan.unknown.clone(),
        Role::Faces(plan) => plan.unknown.clone(),
        Role::Strips(_) => names(e, &LIST_NAMES),
        Role::Edges(ends) => names(e, &ends.map(|k| e.properties[k].name)),
        Role::Other => {
            if e.count > 0 {
                let element = e.name.to_string();
                b.tally.others.push(Warning::SkippedElements { element, count: e.count });
            }
            return;
        }
    };
    if !unknown.is_empty() {
        let element = e.name.to_string();
        b.tally.others.push(Warning::SkippedProperties { element, names: unknown, count: e.count });
    }
    if let Role::Faces(FacePlan { texture: Some(_), .. }) = role
        && b.appearance.materials.is_empty()
        && !b.drop.materials
    {
        b.tally.drop_layer(Layer::Materials, e.count);
    }
}

/// Names of properties other than those that are used.
fn names(e: &Element<'_>, used: &[&str]) -> Vec<String> {
    e.properties.iter().filter(|p| !used.contains(&p.name)).map(|p| p.name.to_string()).collect()
}
