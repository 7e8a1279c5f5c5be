//! What one layer of a split is worked out in, reused from split to split.

use super::values::Value;
use crate::format::complex::{NONE, Side};

/// The corners of one wedge around the vertex that splits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Group {
    /// The wedge.
    pub(super) w: u32,
    /// The last and the number of the wedges that each child has of it.
    pub(super) last: [u32; 2],
    pub(super) count: [u32; 2],
    /// Which of them is the main one.
    pub(super) main: [u32; 2],
}

impl Group {
    pub(super) fn of(w: u32) -> Self {
        Group { w, last: [NONE; 2], count: [0; 2], main: [NONE; 2] }
    }
}

/// A wedge of a child.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Local {
    pub(super) key: u32,
    /// Its group, or [`NONE`].
    pub(super) group: u32,
    pub(super) child: u8,
    /// The one before it in its group, or [`NONE`].
    pub(super) before: u32,
    /// Its number: of the coarser level, or `NEW | i`.
    pub(super) id: u32,
    pub(super) value: Value,
}

/// A place where a triangle may continue: an element with the apex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) group: u32,
    /// The wedge at the apex.
    pub(super) apex: u32,
    pub(super) side: Side,
}

/// A new wedge at the apex of a triangle that appears.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fresh {
    /// The apex.
    pub(super) x: u32,
    pub(super) key: u32,
    /// Its name, [`UNSETTLED`] until it has a number.
    pub(super) id: u32,
    /// The first triangle that has it.
    pub(super) triangle: u32,
}

/// Marks the name of a new wedge at an apex that has no number yet, together with [`NEW`].
pub(super) const UNSETTLED: u32 = 1 << 30;

#[derive(Clone, Debug, Default)]
pub(super) struct LayerScratch {
    pub(super) groups: Vec<Group>,
    pub(super) locals: Vec<Local>,
    /// For each spoke its group, or [`NONE`] without a value.
    pub(super) group_of: Vec<u32>,
    /// For each element of the star, in order of spokes, the wedges of the children.
    pub(super) star: Vec<[u32; 2]>,
    pub(super) inserted: Vec<[u32; 3]>,
    pub(super) places: Vec<Place>,
    /// New wedges at apexes.
    pub(super) fresh: Vec<Fresh>,
    pub(super) ids: Vec<u32>,
    /// The spokes beside an element that appears, and their corners at its apex.
    pub(super) adjacent: Vec<(u32, u32)>,
    /// The places of the first elements that appear, one list behind the other, and the end of each.
    pub(super) listed: Vec<Place>,
    pub(super) ends: Vec<u32>,
}

/// A further wedge of a child.
pub(super) fn push_local(s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
    let at = s.locals.len() as u32;
    let mut local = Local { key, group, child: child as u8, before: NONE, ..Local::default() };
    if group != NONE {
        let g = &mut s.groups[group as usize];
        local.before = g.last[child];
        g.last[child] = at;
        g.count[child] += 1;
    }
    s.locals.push(local);
    at
}
