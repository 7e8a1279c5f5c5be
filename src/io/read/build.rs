//! Where all readers meet: vertices, faces and edges go in as a file has them, a [`Mesh`] and its warnings come out.
//!
//! Corners name *records* (vertices in the order of the file) until [`Builder::finish`] maps them to welded
//! vertices; so forward references need no care. Attributes of records name their values by the same numbers, so
//! welding leaves them where they belong: on corners. Nothing grows past the memory limit or past 32-bit counts.

use std::collections::BTreeMap;

use super::attribute::Attribute;
use super::error::ReadErrorKind;
use super::warning::{Layer, Warning};
use super::weld::Welder;
use super::{DropSet, Invalid, ReadMesh, ReadOptions};
use crate::mesh::{Appearance, Mesh, NO_VALUE};

pub(super) use super::budget::{Budget, MAX};
pub(super) use super::error::ReadErrorKind as Kind;

/// Counts that become warnings.
#[derive(Default)]
pub(super) struct Tally {
    small_faces: u64,
    empty_faces: u64,
    point_edges: u64,
    pub strip_connectors: u64,
    layers: BTreeMap<Layer, u64>,
    /// Warnings of one format, in the order in which they came up.
    pub others: Vec<Warning>,
}

impl Tally {
    /// `count` records of a layer were left out.
    pub fn drop_layer(&mut self, layer: Layer, count: u64) {
        if count > 0 {
            *self.layers.entry(layer).or_default() += count;
        }
    }

    fn warnings(self) -> Vec<Warning> {
        let mut list = Vec::new();
        let mut add = |count: u64, warning: fn(u64) -> Warning| {
            if count > 0 {
                list.push(warning(count));
            }
        };
        add(self.small_faces, |count| Warning::SmallFaces { count });
        add(self.empty_faces, |count| Warning::EmptyFaces { count });
        add(self.point_edges, |count| Warning::PointEdges { count });
        add(self.strip_connectors, |count| Warning::StripConnectors { count });
        list.extend(self.layers.into_iter().map(|(layer, count)| Warning::NotCarried { layer, count }));
        list.extend(self.others);
        list
    }
}

/// A mesh under construction.
pub(super) struct Builder {
    positions: Vec<[f64; 3]>,
    face_start: Vec<u32>,
    pub(super) corners: Vec<u32>,
    /// Where the open face begins in `corners`.
    open: usize,
    welder: Option<Welder>,
    /// Record → vertex, while welding.
    map: Vec<u32>,
    pub budget: Budget,
    pub tally: Tally,
    /// What the caller does not want.
    pub drop: DropSet,
    allow_empty: bool,
    invalid: Invalid,
    /// Records with a coordinate that is no finite number, in order.
    invalid_records: Vec<u32>,
    /// Layers so far.
    pub layers: Vec<Attribute>,
    /// From which face on which material holds, in order.
    materials: Vec<[u32; 2]>,
    pub appearance: Appearance,
}

impl Builder {
    /// `weld_default`: what the format does when the options leave it open. `held`: bytes of input in memory.
    pub fn new(options: &ReadOptions, weld_default: bool, held: usize) -> Self {
        let welder = options.weld.unwrap_or(weld_default).then(Welder::new);
        let budget = Budget::new(held as u64, options.memory_limit);
        let (positions, face_start, corners, map, layers, materials, invalid_records) = Default::default();
        let (drop, tally, appearance) = (options.drop, Tally::default(), Appearance::default());
        Builder {
            positions,
            face_start,
            corners,
            open: 0,
            welder,
            map,
            budget,
            tally,
            drop,
            allow_empty: options.allow_empty,
            invalid: options.invalid,
            invalid_records,
            layers,
            materials,
            appearance,
        }
    }

    /// Number of corners so far, those of the open face included.
    #[inline]
    pub fn corner_count(&self) -> usize {
        self.corners.len()
    }

    /// Elements from here on have this material, or [`NO_VALUE`].
    pub fn use_material(&mut self, material: u32) -> Result<(), Kind> {
        let face = self.face_start.len().saturating_sub(1) as u32;
        match self.materials.last_mut() {
            Some(last) if last[1] == material => return Ok(()),
            Some(last) if last[0] == face => {
                last[1] = material;
                return Ok(());
            }
            None if material == NO_VALUE => return Ok(()),
            _ => {}
        }
        if self.materials.len() == self.materials.capacity() {
            self.budget.grow(&mut self.materials, 1, "changes of the material")?;
        }
        self.materials.push([face, material]);
        Ok(())
    }

    /// Number of vertex records so far.
    #[inline]
    pub fn records(&self) -> usize {
        if self.welder.is_some() { self.map.len() } else { self.positions.len() }
    }

    /// Room for `count` more vertex records; call only with counts that the input's size justifies.
    pub fn expect_records(&mut self, count: usize) -> Result<(), Kind> {
        if self.records().saturating_add(count) > MAX {
            return Err(ReadErrorKind::TooLarge { what: "vertices", limit: MAX as u64 });
        }
        match self.welder {
            Some(_) => self.budget.reserve(&mut self.map, count),
            None => self.budget.reserve(&mut self.positions, count),
        }
    }

    /// Most of the `count` vertex records to come are at places of their own; call only with counts that the input's
    /// size justifies.
    pub fn expect_distinct(&mut self, count: usize) {
        if let Some(welder) = &mut self.welder {
            welder.expect(count.min(MAX), &self.positions, &mut self.budget);
        }
    }

    /// Room for `faces` more faces and `corners` more corners; call only with counts that the input's size justifies.
    pub fn expect_faces(&mut self, faces: usize, corners: usize) -> Result<(), Kind> {
        if self.corners.len().saturating_add(corners) > MAX {
            return Err(ReadErrorKind::TooLarge { what: "corners", limit: MAX as u64 });
        }
        self.budget.reserve(&mut self.face_start, faces.saturating_add(1))?;
        self.budget.reserve(&mut self.corners, corners)
    }

    /// The next vertex record.
    #[inline]
    pub fn vertex(&mut self, mut p: [f64; 3]) -> Result<(), Kind> {
        // One sum instead of three tests: it is finite for all but absurd coordinates, and those are looked at again.
        if !(p[0] + p[1] + p[2]).is_finite() && !self.check_finite(p)? {
            if self.welder.is_some() {
                if self.map.len() == self.map.capacity() {
                    self.budget.grow(&mut self.map, 1, "vertices")?;
                }
                self.map.push(NO_VALUE);
                return Ok(());
            }
            // It keeps its place until all is read.
            p = [0.0; 3];
        }
        match &mut self.welder {
            None => {
                if self.positions.len() == self.positions.capacity() {
                    self.budget.grow(&mut self.positions, 1, "vertices")?;
                }
                self.positions.push(p);
            }
            Some(welder) => {
                let v = welder.insert(&mut self.positions, p, &mut self.budget)?;
                if self.map.len() == self.map.capacity() {
                    self.budget.grow(&mut self.map, 1, "vertices")?;
                }
                self.map.push(v);
            }
        }
        Ok(())
    }

    /// The next vertex records, all at once: welding them so is faster than one by one.
    pub fn vertices(&mut self, block: &[[f64; 3]]) -> Result<(), Kind> {
        match &mut self.welder {
            Some(welder) if block.iter().all(|p| (p[0] + p[1] + p[2]).is_finite()) => {
                if self.map.capacity() - self.map.len() < block.len() {
                    self.budget.grow(&mut self.map, block.len(), "vertices")?;
                }
                welder.insert_all(&mut self.positions, block, &mut self.map, &mut self.budget)
            }
            _ => block.iter().try_for_each(|&p| self.vertex(p)),
        }
    }

    /// Whether a vertex has a place; without one it is an error, or noted as one to leave out.
    #[cold]
    fn check_finite(&mut self, p: [f64; 3]) -> Result<bool, Kind> {
        let Some(value) = p.into_iter().find(|c| !c.is_finite()) else { return Ok(true) };
        if self.invalid == Invalid::Error {
            return Err(ReadErrorKind::NotFinite { vertex: self.records() as u64, value });
        }
        if self.invalid_records.len() == self.invalid_records.capacity() {
            self.budget.grow(&mut self.invalid_records, 1, "vertices")?;
        }
        self.invalid_records.push(self.records() as u32);
        Ok(false)
    }

    /// The next corner of the open face: a record that is, or will be, there (the reader checks).
    #[inline]
    pub fn corner(&mut self, record: u32) -> Result<(), Kind> {
        if self.corners.len() == self.corners.capacity() {
            self.budget.grow(&mut self.corners, 1, "corners")?;
        }
        self.corners.push(record);
        Ok(())
    }

    /// Close the open face. Two corners make an edge, one a point, with a count.
    #[inline]
    pub fn end_face(&mut self) -> Result<(), Kind> {
        if self.corners.len() - self.open < 3 {
            return self.end_small_face();
        }
        self.end_element()
    }

    #[cold]
    fn end_small_face(&mut self) -> Result<(), Kind> {
        match self.corners[self.open..] {
            [] => self.tally.empty_faces += 1,
            [a, b] if a != b => {
                self.tally.small_faces += 1;
                return self.end_element();
            }
            [_, _] => {
                self.tally.point_edges += 1;
                self.corners.truncate(self.open);
            }
            _ => {
                self.tally.small_faces += 1;
                self.corners.truncate(self.open);
            }
        }
        Ok(())
    }

    #[inline]
    fn end_element(&mut self) -> Result<(), Kind> {
        if self.face_start.len() + 1 >= self.face_start.capacity() {
            self.budget.grow(&mut self.face_start, 2, "faces")?;
        }
        if self.face_start.is_empty() {
            self.face_start.push(0);
        }
        self.open = self.corners.len();
        self.face_start.push(self.open as u32);
        Ok(())
    }

    /// A dangling edge.
    pub fn edge(&mut self, a: u32, b: u32) -> Result<(), Kind> {
        if a == b {
            self.tally.point_edges += 1;
            return Ok(());
        }
        self.corner(a)?;
        self.corner(b)?;
        self.end_element()
    }

    /// A triangle of a strip: one that repeats a vertex only joins the strip's parts.
    #[inline]
    pub fn strip_triangle(&mut self, t: [u32; 3]) -> Result<(), Kind> {
        if t[0] == t[1] || t[1] == t[2] || t[0] == t[2] {
            self.tally.strip_connectors += 1;
            return Ok(());
        }
        self.triangle(t)
    }

    /// A triangle.
    #[inline]
    pub fn triangle(&mut self, t: [u32; 3]) -> Result<(), Kind> {
        if self.corners.capacity() - self.corners.len() < 3 {
            self.budget.grow(&mut self.corners, 3, "corners")?;
        }
        self.corners.extend_from_slice(&t);
        self.end_element()
    }

    /// The mesh, with corners mapped to welded vertices. Every corner must name a record that is there.
    pub fn finish(mut self) -> Result<ReadMesh, Kind> {
        for (what, count) in
            [("vertices", self.records()), ("corners", self.corners.len()), ("faces", self.face_start.len())]
        {
            if count > MAX {
                return Err(ReadErrorKind::TooLarge { what, limit: MAX as u64 });
            }
        }
        let mut material = self.face_materials()?;
        let mut layers = Vec::new();
        let mut attributes = std::mem::take(&mut self.layers);
        for attribute in &mut attributes {
            layers.push(attribute.resolve(&self.corners, &self.face_start, &mut self.budget, &mut self.tally)?);
        }
        self.drop_faces_of_invalid(&mut layers, &mut material)?;
        let map = if let Some(welder) = self.welder.take() {
            self.budget.release(welder.bytes());
            drop(welder);
            for c in &mut self.corners {
                *c = self.map[*c as usize];
            }
            let mut on_corners: Vec<&mut Vec<u32>> = layers.iter_mut().collect();
            self.drop_closed_edges(&mut on_corners, &mut material);
            std::mem::take(&mut self.map)
        } else {
            let mut map = Vec::new();
            self.budget.reserve(&mut map, self.positions.len())?;
            map.extend(0..self.positions.len() as u32);
            self.drop_invalid(&mut map);
            map
        };
        if self.positions.is_empty() && !self.allow_empty {
            return Err(ReadErrorKind::Empty);
        }
        let alone = if attributes.is_empty() { Vec::new() } else { self.alone(&map)? };
        let layers = attributes.into_iter().zip(layers);
        let layers =
            layers.filter_map(|(attribute, corners)| attribute.finish(corners, &alone, &mut self.tally)).collect();
        let Builder { positions, face_start, corners, appearance, .. } = self;
        let mesh = Mesh { positions, face_start, corners, layers, material, appearance };
        debug_assert_eq!(mesh.validate(), Ok(()));
        Ok(ReadMesh { mesh, map, warnings: self.tally.warnings() })
    }

    /// The material of each face, none where no face has one.
    fn face_materials(&mut self) -> Result<Vec<u32>, Kind> {
        let faces = self.face_start.len().saturating_sub(1);
        let mut material = Vec::new();
        if self.materials.iter().any(|m| m[1] != NO_VALUE && (m[0] as usize) < faces) {
            self.budget.reserve(&mut material, faces)?;
            for (i, &[first, m]) in self.materials.iter().enumerate() {
                material.resize((first as usize).min(faces), NO_VALUE);
                let end = self.materials.get(i + 1).map_or(faces, |next| next[0] as usize);
                material.resize(end.min(faces), m);
            }
        }
        Ok(material)
    }

    /// Vertices that no element names, each with the records that have become it, in order.
    fn alone(&self, map: &[u32]) -> Result<Vec<[u32; 2]>, Kind> {
        let mut used = vec![false; self.positions.len()];
        self.corners.iter().for_each(|&v| used[v as usize] = true);
        let mut alone: Vec<[u32; 2]> = (0..)
            .zip(map)
            .filter(|(_, v)| **v != NO_VALUE && !used[**v as usize])
            .map(|(record, &v)| [v, record])
            .collect();
        alone.sort_unstable();
        Ok(alone)
    }

    /// Faces with a vertex that has no place go.
    fn drop_faces_of_invalid(&mut self, layers: &mut [Vec<u32>], material: &mut Vec<u32>) -> Result<(), Kind> {
        if self.invalid_records.is_empty() {
            return Ok(());
        }
        self.budget.take(self.records() as u64)?;
        let mut invalid = vec![false; self.records()];
        self.invalid_records.iter().for_each(|&r| invalid[r as usize] = true);
        let mut on_corners: Vec<&mut Vec<u32>> = layers.iter_mut().collect();
        let faces = self.drop_elements(|own| own.iter().any(|&r| invalid[r as usize]), &mut on_corners, material);
        let count = self.invalid_records.len() as u64;
        self.tally.others.push(Warning::InvalidVertices { count, faces });
        Ok(())
    }

    /// Vertices without a place go, where none were welded; `map` and corners get the new numbers.
    fn drop_invalid(&mut self, map: &mut [u32]) {
        if self.invalid_records.is_empty() {
            return;
        }
        let (mut invalid, mut next) = (self.invalid_records.iter().copied().peekable(), 0);
        for (record, number) in map.iter_mut().enumerate() {
            if invalid.next_if_eq(&(record as u32)).is_some() {
                *number = NO_VALUE;
                continue;
            }
            self.positions[next as usize] = self.positions[record];
            *number = next;
            next += 1;
        }
        self.positions.truncate(next as usize);
        self.corners.iter_mut().for_each(|c| *c = map[*c as usize]);
    }

    /// Edges whose ends have become one vertex go.
    fn drop_closed_edges(&mut self, on_corners: &mut [&mut Vec<u32>], on_faces: &mut Vec<u32>) {
        let closed = self.drop_elements(|own| own.len() == 2 && own[0] == own[1], on_corners, on_faces);
        self.tally.point_edges += closed;
    }

    /// Elements go, and with them what is kept for each corner and each face; how many.
    fn drop_elements(
        &mut self,
        gone: impl Fn(&[u32]) -> bool,
        on_corners: &mut [&mut Vec<u32>],
        on_faces: &mut Vec<u32>,
    ) -> u64 {
        let (corners, starts) = (&mut self.corners, &mut self.face_start);
        if !starts.windows(2).any(|w| gone(&corners[w[0] as usize..w[1] as usize])) {
            return 0;
        }
        let (mut kept, mut to, mut from, mut count) = (0, 0, 0, 0);
        for f in 1..starts.len() {
            let end = starts[f];
            let own = from as usize..end as usize;
            if gone(&corners[own.clone()]) {
                count += 1;
            } else {
                for list in on_corners.iter_mut() {
                    list.copy_within(own.clone(), to);
                }
                if let Some(&m) = on_faces.get(f - 1) {
                    on_faces[kept] = m;
                }
                corners.copy_within(own, to);
                to += (end - from) as usize;
                kept += 1;
                starts[kept] = to as u32;
            }
            from = end;
        }
        starts.truncate(kept + 1);
        if kept == 0 {
            starts.clear();
        }
        corners.truncate(to);
        on_corners.iter_mut().for_each(|list| list.truncate(to));
        on_faces.truncate(kept);
        count
    }
}

/// A vertex number of a file that counts from 0, as a record below `vertices`.
#[inline]
pub(super) fn index_from_zero(index: i64, vertices: u64, what: &'static str) -> Result<u32, Kind> {
    if index < 0 || index as u64 >= vertices {
        return Err(ReadErrorKind::IndexOutOfRange { what, index, vertices, first: 0 });
    }
    Ok(index as u32)
}
