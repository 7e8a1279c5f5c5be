//! The level that lies on the device, and how it follows the loop.
//!
//! A vertex keeps its place on the device, its *slot*, as long as it lives; a merged one inherits that of a child. So a
//! batch changes the records and stars of the vertices near it, and of no other: their new stars go behind those that are there
//! already, their records are put to their slots by the kernel `apply`. When the room behind is used up, or the level has
//! nothing to do with the one before, it is sent whole, and slots count from 0 again.

use rayon::prelude::*;
use std::sync::Arc;

use super::buffers::{Growing, INPUT, UNIFORM, change};
use super::device::Device;
use super::error::DeviceError;
use super::shader::Kernel;
use super::stars::{MOST_VERTICES, Stars, bytes_of};
use crate::encode::cost::{Side, Task};

/// Vertices that go to the device at a time.
const BLOCK: usize = 1 << 17;
/// Vertices of a block that one thread reads.
const PART: usize = 1 << 11;

/// Buffers of a level, and what is known of what they hold.
#[derive(Debug)]
pub struct Resident {
    vertices: Growing,
    stars: Growing,
    params: Growing,
    records: Growing,
    changed: Growing,
    /// The slot of each vertex of the level; `None` where the buffers hold no level.
    slots: Option<Arc<[u32]>>,
    /// Words of stars that are in use, counted from the beginning.
    used: u64,
}

impl Resident {
    pub fn new(device: &Device) -> Self {
        let [vertices, stars, records, changed] = std::array::from_fn(|_| Growing::new(device, INPUT));
        Resident { vertices, stars, params: Growing::new(device, UNIFORM), records, changed, slots: None, used: 0 }
    }

    /// Bring the level of the task to the device and tell its vertices' slots; `None` if that takes more than `most` bytes.
    pub fn follow(
        &mut self,
        device: &Device,
        apply: &Kernel,
        task: &Task,
        most: u64,
    ) -> Result<Option<Arc<[u32]>>, DeviceError> {
        let old = self.slots.take();
        if task.level.positions.len() > MOST_VERTICES {
            return Ok(None);
        }
        if let (Some(old), Some(c)) = (old, task.carried)
            && old.len() == task.old.0.vertices()
        {
            let slots: Option<Arc<[u32]>> = c.old_of_new.iter().map(|&v| old.get(v as usize).copied()).collect();
            if let Some(slots) = slots
                && self.send_changes(device, apply, task, c.dirty, &slots)?
            {
                self.slots = Some(slots.clone());
                return Ok(Some(slots));
            }
        }
        if !self.send_all(device, task, most)? {
            return Ok(None);
        }
        let slots: Arc<[u32]> = (0..task.level.positions.len() as u32).collect();
        self.slots = Some(slots.clone());
        Ok(Some(slots))
    }

    /// What is sent without slots: a window. No level lies on the device afterwards.
    pub fn put_window(&mut self, device: &Device, window: &Stars) {
        self.slots = None;
        self.vertices.put(device, window.records.as_flattened());
        self.stars.put(device, window.words.as_flattened());
    }

    /// Bindings of the level, from `first` on.
    pub fn bindings(&self, first: u32) -> [wgpu::BindGroupEntry<'_>; 2] {
        [self.vertices.binding(first), self.stars.binding(first + 1)]
    }

    /// False if there is no room.
    fn send_changes(
        &mut self,
        device: &Device,
        apply: &Kernel,
        task: &Task,
        dirty: &[bool],
        slots: &[u32],
    ) -> Result<bool, DeviceError> {
        let mut span = task.trace.span("device: upload", "upload changes");
        let changed: Vec<u32> = (0..slots.len() as u32).filter(|&v| dirty.get(v as usize) != Some(&false)).collect();
        let mut bytes = 0;
        for block in changed.chunks(BLOCK) {
            let Some(stars) = self.append(device, task, block, |v| slots[v as usize]) else { return Ok(false) };
            bytes += stars.bytes().1 + 4 * block.len() as u64;
            self.params.put(device, &[block.len() as u32, 0, 0, 0]);
            self.records.put(device, stars.records.as_flattened());
            let places: Vec<u32> = block.iter().map(|&v| slots[v as usize]).collect();
            self.changed.put(device, &places);
            let bindings =
                [self.params.binding(0), self.records.binding(1), self.changed.binding(2), self.vertices.binding(3)];
            change(device, apply, &bindings, block.len())?;
        }
        span.items(bytes);
        Ok(true)
    }

    /// False if there is not so much room.
    fn send_all(&mut self, device: &Device, task: &Task, most: u64) -> Result<bool, DeviceError> {
        let (records, least) = bytes_of(&task.level);
        let bound = device.info.binding_bytes.min(device.info.buffer_bytes);
        let limit = bound.min(most.saturating_sub(records));
        if records > bound || least > limit {
            return Ok(false);
        }
        let mut span = task.trace.span("device: upload", "upload level");
        self.vertices.reserve(device, records);
        // Twice the room, for what changes.
        let mut room = (2 * least).min(limit);
        loop {
            self.stars.reserve(device, room);
            device.check()?;
            self.used = 0;
            let mut done = true;
            for from in (0..task.level.positions.len()).step_by(BLOCK) {
                let to = (from + BLOCK).min(task.level.positions.len());
                let block: Vec<u32> = (from as u32..to as u32).collect();
                let Some(stars) = self.append(device, task, &block, |v| v) else {
                    done = false;
                    break;
                };
                self.vertices.put_at(device, from as u64 * 16, bytemuck::cast_slice(&stars.records));
                // What was written waits in the program's memory for a submission.
                device.queue.submit([]);
                device.check()?;
            }
            if done {
                span.items(records + 8 * self.used);
                return Ok(true);
            }
            // Elements that share few vertices take more than was reckoned with.
            if self.stars.size() >= limit {
                return Ok(false);
            }
            room = (2 * self.stars.size()).min(limit);
        }
    }

    /// Put the stars of `block` behind those that are there; their records, with places as they are now. `None` if there
    /// is no room.
    fn append(
        &mut self,
        device: &Device,
        task: &Task,
        block: &[u32],
        number: impl Fn(u32) -> u32 + Sync,
    ) -> Option<Stars> {
        let parts: Vec<Stars> = block
            .par_chunks(PART)
            .map_init(Side::default, |side, part| {
                let mut stars = Stars::default();
                part.iter().for_each(|&v| stars.push(&task.level, v, side, &number));
                stars
            })
            .collect();
        let mut all = Stars::default();
        for mut part in parts {
            let from = self.used + all.words.len() as u64;
            part.records.iter_mut().for_each(|r| r[3] += from as u32);
            all.records.append(&mut part.records);
            all.words.append(&mut part.words);
        }
        let after = self.used + all.words.len() as u64;
        if after * 8 > self.stars.size() || after > u64::from(u32::MAX) {
            return None;
        }
        self.stars.put_at(device, self.used * 8, bytemuck::cast_slice(&all.words));
        self.used = after;
        Some(all)
    }
}
