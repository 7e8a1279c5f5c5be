//! Attributes of primitives as layers.
//!
//! `TEXCOORD_n`, `NORMAL`, `TANGENT`, `COLOR_n` and `_NAME` of all primitives of one name are one layer. An accessor
//! that several primitives share gives its values once for each place of the mesh. Normals and tangents turn with the
//! node.

use serde_json::Value;

use super::super::attribute::{Attribute, MAX_LAYERS, Place as Values, Span};
use super::super::build::{Builder, Kind};
use super::super::error::{At, Fail, ReadErrorKind};
use super::super::warning::Layer;
use super::Document;
use super::accessor::Accessor;
use super::json::uint;
use super::scene::Matrix;
use crate::mesh::{LayerKind, Stored};

/// An attribute of a primitive.
pub(super) struct Source {
    /// Which of the wanted layers it belongs to.
    layer: usize,
    accessor: Accessor,
    width: u8,
}

/// A layer that some primitive has.
struct Plan {
    name: String,
    kind: LayerKind,
    /// The largest of all primitives.
    width: u8,
    stored: Option<Stored>,
    /// Texture coordinates and colours in the order of their numbers.
    rank: u64,
}

/// All layers that the primitives have.
#[derive(Default)]
pub(super) struct Wanted {
    plans: Vec<Plan>,
    /// The place of each among the layers of the builder.
    at: Vec<usize>,
}

/// What an attribute of that name means: kind, name of the layer, number of the set, components (0: any).
pub(in crate::io::read) fn meaning(name: &str) -> Option<(LayerKind, String, u64, u8)> {
    let numbered = |prefix: &str, plain: &str| {
        let n: u64 = name.strip_prefix(prefix)?.parse().ok()?;
        Some((if n == 0 { plain.to_string() } else { format!("{plain}{n}") }, n))
    };
    if let Some((name, n)) = numbered("TEXCOORD_", "uv") {
        return Some((LayerKind::Uv, name, n, 2));
    }
    if let Some((name, n)) = numbered("COLOR_", "color") {
        return Some((LayerKind::Color, name, n, 0));
    }
    match name {
        "NORMAL" => Some((LayerKind::Normal, "normal".to_string(), 0, 3)),
        "TANGENT" => Some((LayerKind::Tangent, "tangent".to_string(), 0, 4)),
        _ => Some((LayerKind::Scalar, name.strip_prefix('_')?.to_string(), 0, 0)),
    }
}

impl Wanted {
    /// The attributes of a primitive that has so many vertices.
    pub fn sources(
        &mut self,
        doc: &mut Document<'_>,
        attributes: &Value,
        records: usize,
        b: &mut Builder,
    ) -> Result<Vec<Source>, Fail> {
        let mut sources = Vec::new();
        for name in attributes.as_object().into_iter().flat_map(|o| o.keys()) {
            // Joints and weights are counted with the node's skin.
            if name == "POSITION" || name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_") {
                continue;
            }
            let Some((kind, layer_name, rank, components)) = meaning(name) else {
                b.tally.drop_layer(Layer::OtherAttributes, records as u64);
                continue;
            };
            if b.drop.kind(kind) {
                continue;
            }
            let Some(number) = uint(attributes, name).at(super::top)? else { continue };
            let width = if components > 0 { Some(components) } else { Accessor::width(doc, number)? };
            let known = self.plans.iter().position(|p| p.kind == kind && p.name == layer_name);
            let fits = match kind {
                LayerKind::Color => width.is_some_and(|w| w >= 3),
                _ => width.is_some(),
            };
            let (Some(width), true) = (width, fits && (known.is_some() || self.plans.len() < MAX_LAYERS)) else {
                b.tally.drop_layer(Layer::OtherAttributes, records as u64);
                continue;
            };
            let accessor = Accessor::of_width(doc, number, width, &mut b.budget)?;
            if accessor.count != records {
                let differ = format!(
                    "`{name}` has {} items, but there are {records} positions; mend the document",
                    accessor.count
                );
                return Err(ReadErrorKind::Syntax(differ)).at(|| accessor.place());
            }
            let stored = match kind {
                LayerKind::Color => accessor.stored(true),
                LayerKind::Scalar => accessor.stored(false),
                _ => Stored::F32,
            };
            let layer = known.unwrap_or(self.plans.len());
            if known.is_none() {
                self.plans.push(Plan { name: layer_name, kind, width, stored: None, rank });
            }
            let plan = &mut self.plans[layer];
            plan.width = plan.width.max(width);
            let same = plan.stored.is_none_or(|s| s == stored);
            plan.stored = Some(if same { stored } else { Stored::F32 });
            sources.push(Source { layer, accessor, width });
        }
        Ok(sources)
    }

    /// Layers of the builder that a primitive with these attributes does not have.
    pub fn others(&self, sources: &[Source]) -> Vec<usize> {
        let has = |plan: usize| sources.iter().any(|s| s.layer == plan);
        (0..self.plans.len()).filter(|&plan| !has(plan)).map(|plan| self.at[plan]).collect()
    }

    /// Put the layers into the builder, in an order that does not hang on the order of the primitives.
    pub fn prepare(&mut self, b: &mut Builder) {
        let mut order: Vec<usize> = (0..self.plans.len()).collect();
        let place = |kind: LayerKind| match kind {
            LayerKind::Uv => 0,
            LayerKind::Normal => 1,
            LayerKind::Tangent => 2,
            LayerKind::Color => 3,
            LayerKind::Scalar => 4,
        };
        order.sort_by_key(|&i| {
            let plan = &self.plans[i];
            (place(plan.kind), plan.rank, plan.name.clone())
        });
        self.at = vec![0; order.len()];
        for i in order {
            let Plan { name, kind, width, stored, .. } = &self.plans[i];
            self.at[i] = b.layers.len();
            b.layers.push(Attribute::new(name.as_str(), *kind, *width, stored.unwrap_or_default()));
        }
    }
}

/// Which values of a place of a mesh stand in the layers already: layer, accessor, first value.
#[derive(Default)]
pub(super) struct Emitted(Vec<(usize, u64, usize)>);

impl Emitted {
    /// An attribute of a primitive whose corners begin at `corner`; `records`: the first and how many.
    #[allow(clippy::too_many_arguments, reason = "all of one call")]
    pub fn put(
        &mut self,
        doc: &Document<'_>,
        source: &Source,
        matrix: &Matrix,
        wanted: &Wanted,
        [base, count]: [usize; 2],
        corner: usize,
        b: &mut Builder,
    ) -> Result<(), Fail> {
        let at = wanted.at[source.layer];
        let known = self.0.iter().find(|e| e.0 == at && e.1 == source.accessor.identity).map(|e| e.2);
        let first = match known {
            Some(first) => first,
            None => {
                let layer = &b.layers[at];
                let first = layer.values.len() / layer.width as usize;
                values(doc, source, matrix, at, b)?;
                self.0.push((at, source.accessor.identity, first));
                first
            }
        };
        let corners = [corner as u32, b.corner_count() as u32];
        let records = [base as u32, (base + count) as u32];
        let span = Span { corners, records, offset: first as i64 - base as i64 };
        let place = source.accessor.place();
        if let Values::Records(spans) = &mut b.layers[at].place {
            if spans.len() == spans.capacity() {
                b.budget.grow(spans, 1, "parts of an attribute").at(|| place)?;
            }
            spans.push(span);
        }
        Ok(())
    }
}

/// The values of an accessor, as they are in their place, behind those of the layer.
fn values(doc: &Document<'_>, source: &Source, matrix: &Matrix, at: usize, b: &mut Builder) -> Result<(), Fail> {
    let Builder { layers, budget, .. } = b;
    let Attribute { values, kind, width, .. } = &mut layers[at];
    let more = source.accessor.count.saturating_mul(*width as usize);
    let accessor = &source.accessor;
    budget.reserve(values, more).at(|| accessor.place())?;
    let turned = !matrix.keeps_directions();
    let sign = if matrix.mirrors() { -1.0 } else { 1.0 };
    match *kind {
        LayerKind::Uv => accessor.each::<2>(doc, |[u, v]| put(values, &[u, 1.0 - v])),
        LayerKind::Normal if turned => accessor.each::<3>(doc, |v| put(values, &matrix.normal(v))),
        LayerKind::Tangent if turned => accessor.each::<4>(doc, |[x, y, z, w]| {
            let [x, y, z] = matrix.tangent([x, y, z]);
            put(values, &[x, y, z, sign * w])
        }),
        kind => {
            // Colours without alpha among those with it are opaque.
            let fill = if kind == LayerKind::Color { 1.0 } else { 0.0 };
            let missing = [fill; 4];
            accessor.each_of(doc, source.width, |v| {
                put(values, v)?;
                put(values, &missing[..(*width as usize).saturating_sub(v.len())])
            })
        }
    }
}

#[inline]
fn put(values: &mut Vec<f64>, more: &[f64]) -> Result<(), Kind> {
    values.extend_from_slice(more);
    Ok(())
}
