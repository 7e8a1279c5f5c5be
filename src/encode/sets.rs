//! Disjoint sets of numbers (union–find with path halving; Tarjan and van Leeuwen 1984). The smallest number of a set stands for it.

/// Sets of the numbers `0..n`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// Begin again with `n` sets of one number each.
    pub(crate) fn reset(&mut self, n: u32) {
        self.parent.clear();
        self.parent.extend(0..n);
    }

    /// The number that stands for the set of `x`.
    #[inline]
    pub(crate) fn find(&mut self, mut x: u32) -> u32 {
        while self.parent[x as usize] != x {
            self.parent[x as usize] = self.parent[self.parent[x as usize] as usize];
            x = self.parent[x as usize];
        }
        x
    }

    /// Make one set of those of `x` and `y`; whether they were two.
    #[inline]
    pub(crate) fn join(&mut self, x: u32, y: u32) -> bool {
        let (x, y) = (self.find(x), self.find(y));
        self.parent[x.max(y) as usize] = x.min(y);
        x != y
    }
}

#[cfg(test)]
mod tests {
    use super::Sets;

    #[test]
    fn the_smallest_stands_for_its_set() {
        let mut sets = Sets::default();
        sets.reset(6);
        assert!(sets.join(4, 2) && sets.join(5, 4) && !sets.join(2, 5));
        assert_eq!([0, 1, 2, 3, 4, 5].map(|x| sets.find(x)), [0, 1, 2, 3, 2, 2]);
        sets.reset(2);
        assert_eq!([0, 1].map(|x| sets.find(x)), [0, 1]);
    }
}
