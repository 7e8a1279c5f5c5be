//! Lines `v`: coordinates, a weight, a colour.

use super::super::attribute::{Attribute, opaque};
use super::super::build::{Builder, Kind};
use super::super::error::{At, Fail};
use super::super::text::Cursor;
use super::super::warning::Layer;
use super::Extras;
use crate::mesh::{LayerKind, Stored};

/// `v x y z [w] [r g b [a]]`
#[inline]
pub(super) fn vertex(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let mut p = [0.0; 3];
    for x in &mut p {
        c.skip_blanks_continued();
        *x = c.float("a coordinate").at(|| c.place())?;
    }
    b.vertex(p).at(|| c.place())?;
    c.skip_blanks_continued();
    if !c.at_line_end() && c.peek() != Some(b'#') {
        extra(b, c, x)?;
    }
    c.skip_line_continued();
    Ok(())
}

/// What follows the three coordinates: one number is a weight, three are a colour, four a colour and one of the two.
fn extra(b: &mut Builder, c: &mut Cursor<'_>, x: &mut Extras) -> Result<(), Fail> {
    let (mut count, mut numbers) = (0, [f64::NAN; 4]);
    while !c.at_line_end() && c.peek() != Some(b'#') {
        let value = c.float("a number or the end of the line").at(|| c.place())?;
        if let Some(place) = numbers.get_mut(count) {
            *place = value;
        }
        count += 1;
        c.skip_blanks_continued();
    }
    match count {
        1 if numbers[0] == 1.0 => {}
        1 => x.layers.add(Layer::VertexWeights),
        3 | 4 if b.drop.colors => {}
        3 | 4 => x.colours.add(b, numbers).at(|| c.place())?,
        _ => x.layers.add(Layer::FurtherNumbers),
    }
    Ok(())
}

/// Colours of vertices.
#[derive(Default)]
pub(super) struct Colours {
    /// Four numbers per record, NaN where there are none; may end early.
    values: Vec<f64>,
    /// How many records have four, of how many of them the first is 1, and of how many the last is what says opaque.
    fours: u64,
    first_one: u64,
    last_full: u64,
}

impl Colours {
    /// The colour of the latest record.
    fn add(&mut self, b: &mut Builder, numbers: [f64; 4]) -> Result<(), Kind> {
        let at = 4 * (b.records() - 1);
        let more = at + 4 - self.values.len();
        if at + 4 > self.values.capacity() {
            b.budget.grow(&mut self.values, more, "colours")?;
        }
        self.values.resize(at, f64::NAN);
        self.values.extend(numbers);
        if !numbers[3].is_nan() {
            self.fours += 1;
            self.first_one += u64::from(numbers[0] == 1.0);
            self.last_full += u64::from(numbers[3] == 1.0 || numbers[3] == 255.0);
        }
        Ok(())
    }

    /// The layer. Of four numbers the first is a weight where it is always 1 and the last is not; else the last is
    /// alpha.
    pub fn finish(self, b: &mut Builder, vertices: usize) -> Result<(), Kind> {
        let Colours { mut values, fours, first_one, last_full } = self;
        if values.is_empty() {
            return Ok(());
        }
        let weights = fours > 0 && first_one == fours && last_full < fours;
        let width = if fours > 0 && !weights { 4 } else { 3 };
        if width == 3 {
            for k in 0..values.len() / 4 {
                let from = 4 * k + usize::from(weights && !values[4 * k + 3].is_nan());
                values.copy_within(from..from + 3, 3 * k);
            }
            values.truncate(values.len() / 4 * 3);
        }
        let more = (width * vertices).saturating_sub(values.len());
        b.budget.reserve(&mut values, more)?;
        values.resize(width * vertices, f64::NAN);
        let mut layer = Attribute::new("color", LayerKind::Color, width as u8, Stored::F32).everywhere();
        (layer.values, layer.gaps) = (values, true);
        opaque(&mut layer);
        layer.scale_colours(&mut b.tally);
        b.layers.push(layer);
        Ok(())
    }
}
