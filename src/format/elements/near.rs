//! The vertices near a place, by a grid kept as a sorted list.

/// Vertices of one row of three cells that are looked at, at most.
const ROW: usize = 12;

/// Vertices sorted by grid cell.
#[derive(Debug)]
pub(super) struct Near<'a> {
    positions: &'a [[i32; 3]],
    shift: u32,
    cells: Vec<([i32; 3], u32)>,
}

impl<'a> Near<'a> {
    /// A grid of cells of side `2^shift`.
    pub(super) fn new(positions: &'a [[i32; 3]], shift: u32) -> Self {
        let mut cells: Vec<_> = positions.iter().zip(0u32..).map(|(p, v)| (p.map(|c| c >> shift), v)).collect();
        cells.sort_unstable();
        Near { positions, shift, cells }
    }

    /// Number of vertices.
    pub(super) fn vertices(&self) -> u32 {
        self.positions.len() as u32
    }

    /// The vertices in the 27 cells around `place` to which `late` gives an answer: those first that are not late,
    /// then nearest first.
    pub(super) fn around(&self, place: [i64; 3], late: impl Fn(u32) -> Option<bool>) -> Vec<u32> {
        let cell = place.map(|c| (c >> self.shift).clamp(-(1 << 30), 1 << 30) as i32);
        let mut found: Vec<(bool, u64, u32)> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                let row = [cell[0] + dx, cell[1] + dy];
                let from = self.cells.partition_point(|(c, _)| *c < [row[0], row[1], cell[2] - 1]);
                for &(c, v) in self.cells[from..].iter().take(ROW) {
                    if c[..2] != row || c[2] > cell[2] + 1 {
                        break;
                    }
                    let Some(late) = late(v) else { continue };
                    let p = self.positions[v as usize];
                    let distance = (0..3).map(|k| (p[k] as i64 - place[k]).unsigned_abs().pow(2)).sum();
                    found.push((late, distance, v));
                }
            }
        }
        found.sort_unstable();
        found.into_iter().map(|(_, _, v)| v).collect()
    }
}
