//! Welding: records of vertices at one position become one vertex.
//!
//! Formats that repeat a vertex for its attributes (glTF), or for each corner (STL), lose the connectivity that
//! was meant; equal positions give it back. Positions are equal when all three coordinates are the same numbers
//! (`-0.0` equals `0.0`; beyond that, bit for bit: no tolerance). Vertices keep the order of their first record.

use std::hash::{BuildHasher, RandomState};

use super::build::{Budget, Kind, MAX};

const EMPTY: u32 = u32::MAX;

/// So many positions are looked up together.
const BLOCK: usize = 64;

/// A growing set of positions: open addressing over vertex numbers, each with some bits of its hash, so that a look at
/// another vertex's slot does not cost a look at its position.
pub(super) struct Welder {
    table: Vec<[u32; 2]>,
    /// Unpredictable per run, so that no file can be made to collide; the result does not depend on them.
    seeds: [u64; 2],
}

impl Welder {
    pub fn new() -> Self {
        let state = RandomState::new();
        Welder { table: Vec::new(), seeds: [state.hash_one(1u8) | 1, state.hash_one(2u8) | 1] }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        8 * self.table.capacity() as u64
    }

    /// Make room for `count` vertices, as far as the budget goes: growing later costs as much as inserting.
    pub fn expect(&mut self, count: usize, positions: &[[f64; 3]], budget: &mut Budget) {
        let size = (positions.len().saturating_add(count).saturating_add(BLOCK).saturating_mul(8) / 5 + 1)
            .checked_next_power_of_two();
        if let Some(size) = size.filter(|s| *s > self.table.len() && *s <= MAX) {
            // Without that room it grows as it needs to, and fails then if it must.
            let _ = self.resize(size, positions, budget);
        }
    }

    #[inline]
    fn hash(&self, p: &[f64; 3]) -> u64 {
        let fold = |a: u64, b: u64| {
            let product = u128::from(a) * u128::from(b);
            product as u64 ^ (product >> 64) as u64
        };
        // Adding zero turns -0.0 into 0.0.
        let bits = |c: f64| (c + 0.0).to_bits();
        let h = fold(bits(p[0]) ^ self.seeds[0], bits(p[1]).rotate_left(32) ^ self.seeds[1]);
        fold(h ^ bits(p[2]), self.seeds[0] ^ self.seeds[1].rotate_left(17) | 1)
    }

    /// The vertex at `p`; a new one is appended to `positions`.
    #[inline]
    pub fn insert(&mut self, positions: &mut Vec<[f64; 3]>, p: [f64; 3], budget: &mut Budget) -> Result<u32, Kind> {
        if 8 * positions.len() >= 5 * self.table.len() {
            self.grow(positions, budget)?;
        }
        let hash = self.hash(&p);
        self.place(positions, p, hash, budget)
    }

    /// The vertices at `points`, appended to `map`; new ones are appended to `positions`.
    ///
    /// The slots of a block are looked at before they are needed, all of them in a row: so their cache misses overlap,
    /// where each would hold up the decision that hangs on it.
    pub fn insert_all(
        &mut self,
        positions: &mut Vec<[f64; 3]>,
        points: &[[f64; 3]],
        map: &mut Vec<u32>,
        budget: &mut Budget,
    ) -> Result<(), Kind> {
        let mut hashes = [0; BLOCK];
        for block in points.chunks(BLOCK) {
            while 8 * (positions.len() + block.len()) >= 5 * self.table.len() {
                self.grow(positions, budget)?;
            }
            let mask = self.table.len() - 1;
            let mut seen = 0;
            for (hash, p) in hashes.iter_mut().zip(block) {
                *hash = self.hash(p);
                seen ^= self.table[*hash as usize & mask][0];
            }
            std::hint::black_box(seen);
            for (&hash, &p) in hashes.iter().zip(block) {
                map.push(self.place(positions, p, hash, budget)?);
            }
        }
        Ok(())
    }

    /// The vertex at `p`, of that hash; there is a free slot.
    #[inline]
    fn place(
        &mut self,
        positions: &mut Vec<[f64; 3]>,
        p: [f64; 3],
        hash: u64,
        budget: &mut Budget,
    ) -> Result<u32, Kind> {
        let mask = self.table.len() - 1;
        let tag = (hash >> 32) as u32;
        let mut slot = hash as usize & mask;
        loop {
            match self.table[slot] {
                [EMPTY, _] => break,
                // Comparing as numbers, so that both zeros are equal; none is NaN.
                [v, t] if t == tag && positions[v as usize] == p => return Ok(v),
                _ => slot = (slot + 1) & mask,
            }
        }
        if positions.len() == positions.capacity() {
            budget.grow(positions, 1, "vertices")?;
        }
        let v = positions.len() as u32;
        self.table[slot] = [v, tag];
        positions.push(p);
        Ok(v)
    }

    #[cold]
    fn grow(&mut self, positions: &[[f64; 3]], budget: &mut Budget) -> Result<(), Kind> {
        if positions.len() >= MAX {
            return Err(Kind::TooLarge { what: "vertices", limit: MAX as u64 });
        }
        self.resize((2 * self.table.len()).max(64), positions, budget)
    }

    fn resize(&mut self, size: usize, positions: &[[f64; 3]], budget: &mut Budget) -> Result<(), Kind> {
        let mut table = Vec::new();
        budget.reserve(&mut table, size)?;
        budget.release(self.bytes());
        table.resize(size, [EMPTY, 0]);
        for (v, p) in positions.iter().enumerate() {
            let hash = self.hash(p);
            let mut slot = hash as usize & (size - 1);
            while table[slot][0] != EMPTY {
                slot = (slot + 1) & (size - 1);
            }
            table[slot] = [v as u32, (hash >> 32) as u32];
        }
        self.table = table;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_positions_become_one_vertex_in_order_of_first_record() {
        let (mut welder, mut positions, mut budget) = (Welder::new(), Vec::new(), Budget::new(0, None));
        let mut put = |p| welder.insert(&mut positions, p, &mut budget).unwrap();
        assert_eq!(put([1.0, 2.0, 3.0]), 0);
        assert_eq!(put([0.0, 0.0, 0.0]), 1);
        assert_eq!(put([1.0, 2.0, 3.0]), 0);
        assert_eq!(put([-0.0, 0.0, -0.0]), 1);
        assert_eq!(put([f64::from_bits(1.0f64.to_bits() + 1), 2.0, 3.0]), 2);
        for i in 0..5000 {
            assert_eq!(put([f64::from(i), 7.5, 0.0]), 3 + i as u32);
        }
        for i in 0..5000 {
            assert_eq!(put([f64::from(i), 7.5, 0.0]), 3 + i as u32);
        }
    }

    #[test]
    fn blocks_of_any_length_give_what_one_by_one_gives() {
        let mut budget = Budget::new(0, None);
        let points: Vec<[f64; 3]> = (0..3000).map(|i| [f64::from(i % 1789), f64::from(i % 3), 7.5]).collect();
        let (mut single, mut at) = (Welder::new(), Vec::new());
        let known: Vec<u32> = points.iter().map(|&p| single.insert(&mut at, p, &mut budget).unwrap()).collect();
        for length in [1, 63, 64, 65, 1000] {
            let (mut welder, mut places, mut map) = (Welder::new(), Vec::new(), Vec::new());
            for block in points.chunks(length) {
                welder.insert_all(&mut places, block, &mut map, &mut budget).unwrap();
            }
            assert_eq!((&places, &map), (&at, &known));
        }
    }

    #[test]
    fn the_memory_limit_holds() {
        let (mut welder, mut positions, mut budget) = (Welder::new(), Vec::new(), Budget::new(0, Some(10_000)));
        let full = (0..10_000).find_map(|i| welder.insert(&mut positions, [f64::from(i); 3], &mut budget).err());
        assert!(matches!(full, Some(Kind::Memory { limit: Some(10_000), .. })));
        assert!(positions.len() < 1000);
    }
}
