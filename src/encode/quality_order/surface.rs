//! What every cell is worth, from those that were measured.
//!
//! Pictures cost time, and quality is a gentle function of the cell: the loss that a coarse mesh causes and the one that a blurred image
//! causes nearly add up in logarithms. So the borders of the grid are measured, the inside is blended from them (a Coons patch of
//! logarithms), and what measured cells inside say otherwise is spread around them.

use super::plan::Cell;
use std::collections::BTreeMap;

/// Quality does not go below this in logarithms.
const LEAST: f64 = 1e-3;

/// Qualities of a grid, measured or blended.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// The last cell.
    last: Cell,
    /// The last row of the mesh that is measured: from there on levels look like the full one.
    resolved: usize,
    measured: BTreeMap<Cell, f64>,
    /// Measured cells inside the borders: how much their logarithm exceeds the blend of the borders.
    off: Vec<(Cell, f64)>,
}

impl Surface {
    /// Nothing measured yet; `resolved` is the last row of the mesh that will be.
    pub fn new(last: Cell, resolved: usize) -> Self {
        Surface { last, resolved: resolved.min(last.0), ..Surface::default() }
    }

    /// Whether a cell is measured, or beyond those that are.
    pub fn knows(&self, cell: Cell) -> bool {
        self.measured.contains_key(&self.measurable(cell))
    }

    /// The cell whose measurement stands for this one.
    pub fn measurable(&self, (l, s): Cell) -> Cell {
        (l.min(self.resolved), s)
    }

    /// The cells of all four borders.
    pub fn borders(&self) -> Vec<Cell> {
        let (l, s) = (self.resolved, self.last.1);
        let mut cells: Vec<Cell> = (0..=l).flat_map(|i| [(i, 0), (i, s)]).collect();
        cells.extend((0..=s).flat_map(|i| [(0, i), (l, i)]));
        cells.sort_unstable();
        cells.dedup();
        cells
    }

    /// Note what cells were measured as; the borders come first.
    pub fn add(&mut self, cells: impl IntoIterator<Item = (Cell, f64)>) {
        for (cell, quality) in cells {
            if self.measured.insert(cell, quality).is_none() && self.inside(cell) {
                self.off.push((cell, log(quality) - self.blend(cell)));
            }
        }
    }

    fn inside(&self, (l, s): Cell) -> bool {
        l > 0 && l < self.resolved && s > 0 && s < self.last.1
    }

    /// What a cell is worth.
    pub fn quality(&self, cell: Cell) -> f64 {
        let (l, s) = self.measurable(cell);
        let quality = match self.measured.get(&(l, s)) {
            Some(&quality) => quality,
            None => (self.blend((l, s)) + self.correction((l, s))).exp(),
        };
        if cell.0 <= self.resolved {
            return quality;
        }
        // Finer than what is seen: what is left rises evenly, so that these levels come before steps that are worth less.
        let left = self.measured.get(&(self.resolved, self.last.1)).map_or(0.0, |&q| -log(q));
        let share = (cell.0 - self.resolved) as f64 / (self.last.0 - self.resolved).max(1) as f64;
        quality * (left * share).exp()
    }

    /// Blended from the borders, in logarithms.
    fn blend(&self, (l, s): Cell) -> f64 {
        let (far, end) = (self.resolved, self.last.1);
        let at = |cell: Cell| log(self.measured.get(&cell).copied().unwrap_or(1.0));
        let (u, v) = (l as f64 / far.max(1) as f64, s as f64 / end.max(1) as f64);
        let across = (1.0 - u) * at((0, s)) + u * at((far, s));
        let along = (1.0 - v) * at((l, 0)) + v * at((l, end));
        let corners = (1.0 - u) * ((1.0 - v) * at((0, 0)) + v * at((0, end)))
            + u * ((1.0 - v) * at((far, 0)) + v * at((far, end)));
        across + along - corners
    }

    /// The mean of what measured cells inside say, by inverse squared distance; the borders, where it is 0, have a say too.
    fn correction(&self, (l, s): Cell) -> f64 {
        let border = l.min(self.resolved - l.min(self.resolved)).min(s).min(self.last.1 - s) as f64;
        let (mut sum, mut weight) = (0.0, 1.0 / (border * border).max(1e-9));
        for &((i, j), off) in &self.off {
            let d = l.abs_diff(i).pow(2) + s.abs_diff(j).pow(2);
            let w = 1.0 / (d as f64).max(1e-9);
            sum += w * off;
            weight += w;
        }
        sum / weight
    }
}

fn log(quality: f64) -> f64 {
    quality.max(LEAST).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_that_add_up_are_known_from_the_borders() {
        let truth = |(l, s): Cell| (0.3 + 0.1 * l as f64) * (1.0 - 0.5 / (1 + s * s) as f64);
        let mut surface = Surface::new((7, 5), 7);
        let borders = surface.borders();
        assert_eq!(borders.len(), 2 * (8 + 6) - 4);
        assert!(!surface.knows((0, 0)));
        surface.add(borders.into_iter().map(|c| (c, truth(c))));
        for l in 0..8 {
            for s in 0..6 {
                assert!((surface.quality((l, s)) - truth((l, s))).abs() < 1e-12, "{l} {s}");
            }
        }
        // A measurement moves its neighbours a little, and the borders not at all.
        surface.add([((3, 3), 0.9 * truth((3, 3)))]);
        assert!((surface.quality((3, 3)) / truth((3, 3)) - 0.9).abs() < 1e-12);
        let near = surface.quality((4, 3)) / truth((4, 3));
        assert!(near > 0.91 && near < 0.99, "{near}");
        assert_eq!(surface.quality((0, 3)), truth((0, 3)));
    }

    #[test]
    fn levels_beyond_what_is_seen_rise_evenly() {
        let mut surface = Surface::new((6, 2), 4);
        let quality = |(l, s): Cell| (0.9 + 0.02 * l as f64) * [0.5, 0.9, 1.0][s];
        surface.add(surface.borders().into_iter().map(|c| (c, quality(c))));
        assert!(surface.knows((6, 1)) && surface.knows((5, 0)) && !surface.knows((2, 1)));
        assert_eq!(surface.quality((6, 2)), 1.0);
        assert!(surface.quality((4, 2)) < surface.quality((5, 2)));
        assert!((surface.quality((6, 0)) - 0.5 / 0.98 * 0.98).abs() < 1e-12);
        // A grid without images, and one without a mesh to refine.
        for last in [(3, 0), (0, 3), (0, 0)] {
            let mut surface = Surface::new(last, last.0);
            let borders = surface.borders();
            assert_eq!(borders.len(), (last.0 + 1) * (last.1 + 1));
            surface.add(borders.into_iter().map(|c| (c, 0.5)));
            assert_eq!(surface.quality(last), 0.5);
        }
    }
}
