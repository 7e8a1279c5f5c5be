//! Binary elements in the layouts that nearly all files have, without a look at each property of each record.

use super::super::build::Builder;
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::attributes::{self, Columns, VertexPlan};
use super::header::{Element, Property, Scalar};
use super::source::Binary;

/// Vertices of equal size with float coordinates, without a look at each property.
pub(super) fn fast_vertices<const BIG: bool>(
    b: &mut Builder,
    source: &mut Binary<'_, BIG>,
    e: &Element<'_>,
    plan: &VertexPlan,
) -> Result<bool, Fail> {
    let Some(stride) = e.stride() else { return Ok(false) };
    let offset = |i: usize| e.properties[..i].iter().map(|p| p.scalar.size()).sum::<usize>();
    let at = plan.xyz.map(offset);
    let start = source.pos;
    match plan.xyz.map(|i| e.properties[i].scalar) {
        [Scalar::F32, Scalar::F32, Scalar::F32] => records(b, source, e.count, stride, |r| {
            at.map(|o| {
                let x = [r[o], r[o + 1], r[o + 2], r[o + 3]];
                f64::from(if BIG { f32::from_be_bytes(x) } else { f32::from_le_bytes(x) })
            })
        })?,
        [Scalar::F64, Scalar::F64, Scalar::F64] => records(b, source, e.count, stride, |r| {
            at.map(|o| {
                let mut x = [0; 8];
                x.copy_from_slice(&r[o..o + 8]);
                if BIG { f64::from_be_bytes(x) } else { f64::from_le_bytes(x) }
            })
        })?,
        _ => return Ok(false),
    }
    let all = &source.bytes[start..source.pos];
    for Columns { layer, properties } in &plan.columns {
        let values = &mut b.layers[*layer].values;
        b.budget.reserve(values, e.count as usize * properties.len()).at(|| Place::Byte(start as u64))?;
        values.resize(e.count as usize * properties.len(), 0.0);
        for (k, &property) in properties.iter().enumerate() {
            let column = values.iter_mut().skip(k).step_by(properties.len());
            attributes::column::<BIG>(column, all, stride, offset(property), e.properties[property].scalar);
        }
    }
    plan.finish(b, e);
    Ok(true)
}

#[inline]
fn records<const BIG: bool>(
    b: &mut Builder,
    source: &mut Binary<'_, BIG>,
    count: u64,
    stride: usize,
    position: impl Fn(&[u8]) -> [f64; 3],
) -> Result<(), Fail> {
    let start = source.pos;
    // The count is known to fit.
    let all = source.take(count as usize * stride).at(|| Place::Byte(start as u64))?;
    for (i, record) in all.chunks_exact(stride).enumerate() {
        b.vertex(position(record)).at(|| Place::Byte((start + i * stride) as u64))?;
    }
    Ok(())
}

/// Faces whose list has byte counts and 32-bit numbers, with scalars before and behind it.
pub(super) fn fast_faces<const BIG: bool>(
    b: &mut Builder,
    source: &mut Binary<'_, BIG>,
    e: &Element<'_>,
    list: usize,
    vertices: u64,
) -> Result<bool, Fail> {
    let property = &e.properties[list];
    let fits = property.list == Some(Scalar::U8) && matches!(property.scalar, Scalar::I32 | Scalar::U32);
    let lists = e.properties.iter().filter(|p| p.list.is_some()).count();
    if !fits || lists != 1 {
        return Ok(false);
    }
    let size = |p: &[Property<'_>]| p.iter().map(|p| p.scalar.size()).sum::<usize>();
    let (head, tail) = (size(&e.properties[..list]), size(&e.properties[list + 1..]));
    let signed = property.scalar == Scalar::I32;
    let limit = vertices.min(1 << 32);
    for _ in 0..e.count {
        let start = source.pos;
        let place = || Place::Byte(start as u64);
        let n = source.take(head + 1).at(place)?[head] as usize;
        let items = source.take(4 * n + tail).at(place)?;
        for (k, x) in items[..4 * n].chunks_exact(4).enumerate() {
            let x = [x[0], x[1], x[2], x[3]];
            let v = if BIG { u32::from_be_bytes(x) } else { u32::from_le_bytes(x) };
            let at = || Place::Byte((start + head + 1 + 4 * k) as u64);
            if u64::from(v) >= limit {
                let index = if signed { i64::from(v as i32) } else { i64::from(v) };
                return Err(ReadErrorKind::IndexOutOfRange { what: "a face", index, vertices, first: 0 }).at(at);
            }
            b.corner(v).at(at)?;
        }
        b.end_face().at(place)?;
    }
    Ok(true)
}
