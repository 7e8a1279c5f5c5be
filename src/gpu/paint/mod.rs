//! Pictures on a device; twin of [`picture::Cpu`](crate::quality::picture::Cpu).
//!
//! The device's rasterizer finds the nearest triangle at each sample, a kernel lights what is seen, another makes pixels of it: the steps of
//! the twin in its order, with its formulas (`shaders/scene.wgsl`). Points are projected by the processor, for both. What can differ is
//! rounding: `f32` for `f64` in weights of corners and in depths, `log2` in the choice of a texture's size, whose error is the driver's.
//!
//! Images lie in one texture, texel after texel, so that none is too large for the device; pictures are drawn in tiles and meshes in
//! windows (`upload`, `canvas`).

mod canvas;
mod pipelines;
mod upload;

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

use super::device::Device;
use super::error::DeviceError;
use crate::parallel;
use crate::quality::picture::{Cpu, Picture, Renderer, Scene, View};
use canvas::Canvas;
use pipelines::Pipelines;

/// Pictures that are handed over while the next ones are drawn.
const BATCH: usize = 8;

/// The renderer on a device. Whatever goes wrong with it, the processor draws the pictures that are left, and
/// [`failure`](Self::failure) says why.
#[derive(Debug)]
pub struct GpuRenderer {
    device: Device,
    pipelines: Pipelines,
    failure: Mutex<Option<DeviceError>>,
    /// Pictures until it counts as lost.
    left: AtomicU32,
}

impl GpuRenderer {
    /// Compile the passes on `device`.
    ///
    /// # Errors
    /// [`DeviceError`] when a shader is refused, memory runs out, or the device sees too few buffers at once.
    pub fn new(device: Device) -> Result<Self, DeviceError> {
        let (has, needs) = (device.info().bindings, pipelines::BUFFERS);
        if has < needs {
            let what = "the number of buffers a kernel sees";
            let device = device.info().name.clone();
            return Err(DeviceError::TooSmall { device, what, has: has.into(), needs: needs.into() });
        }
        let pipelines = Pipelines::new(&device)?;
        Ok(GpuRenderer { device, pipelines, failure: Mutex::new(None), left: AtomicU32::new(u32::MAX) })
    }

    /// Why the processor draws instead, if it does.
    pub fn failure(&self) -> Option<DeviceError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Count as lost after so many pictures: for tests of what then happens.
    #[doc(hidden)]
    pub fn lose_after(&mut self, pictures: u32) {
        self.left = AtomicU32::new(pictures);
    }

    fn draw_one(&self, canvas: &mut Canvas<'_>, view: &View) -> Result<Picture, DeviceError> {
        let counted = self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| match n {
            u32::MAX => Some(n),
            _ => n.checked_sub(1),
        });
        if counted.is_err() {
            let reason = "LODESTREAM_LOSE_DEVICE says so".to_string();
            return Err(DeviceError::Lost { device: self.device.info().name.clone(), reason });
        }
        canvas.draw(view)
    }

    /// Draw on the device as long as it lasts; how many pictures were handed over.
    fn on_device(
        &self,
        scene: &Scene,
        views: &[View],
        size: [u32; 2],
        each: &(dyn Fn(usize, Picture) + Sync),
    ) -> (usize, Result<(), DeviceError>) {
        let mut canvas = match Canvas::new(&self.device, &self.pipelines, scene, size) {
            Ok(canvas) => canvas,
            Err(error) => return (0, Err(error)),
        };
        let hand_over = |ready: Vec<(usize, Picture)>| {
            parallel::map(ready, |(i, picture)| each(i, picture));
        };
        let mut ready: Vec<(usize, Picture)> = Vec::new();
        for range in batches(views.len()) {
            let start = range.start;
            let last = std::mem::take(&mut ready);
            // What is drawn already is looked at while the device draws on.
            let (drawn, ()) = parallel::join(
                || range.map(|i| Ok((i, self.draw_one(&mut canvas, &views[i])?))).collect::<Result<Vec<_>, _>>(),
                || hand_over(last),
            );
            match drawn {
                Ok(drawn) => ready = drawn,
                Err(error) => return (start, Err(error)),
            }
        }
        hand_over(ready);
        (views.len(), Ok(()))
    }
}

/// Ranges of so many views.
fn batches(views: usize) -> impl Iterator<Item = Range<usize>> {
    (0..views).step_by(BATCH).map(move |first| first..views.min(first + BATCH))
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        if self.failure().is_some() { Cpu.name() } else { self.device.info().name.clone() }
    }

    fn draw(&self, scene: &Scene, view: &View, width: u32, height: u32) -> Picture {
        let picture = Mutex::new(None);
        self.draw_each(scene, std::slice::from_ref(view), width, height, &|_, drawn| {
            *picture.lock().unwrap_or_else(PoisonError::into_inner) = Some(drawn);
        });
        let drawn = picture.into_inner().unwrap_or_else(PoisonError::into_inner);
        drawn.unwrap_or_else(|| Cpu.draw(scene, view, width, height))
    }

    fn draw_each(
        &self,
        scene: &Scene,
        views: &[View],
        width: u32,
        height: u32,
        each: &(dyn Fn(usize, Picture) + Sync),
    ) {
        let mut done = 0;
        if self.failure().is_none() && width > 0 && height > 0 {
            let (handed, result) = self.on_device(scene, views, [width, height], each);
            done = handed;
            if let Err(error) = result {
                self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            }
        }
        Cpu.draw_each(scene, &views[done..], width, height, &|i, picture| each(done + i, picture));
    }
}

#[cfg(all(test, feature = "samples"))]
mod tests;
