//! `--device` of the commands that draw.
//!
//! A GPU draws where one is asked for, or where `auto` expects that to be sooner done. Whatever goes wrong with it is said once on standard
//! error, and the processor draws: same exit code. Scores never compare pictures of one with those of the other. A build without the feature
//! `gpu` takes the same options, and says that it has none.

use crate::shared;
use lodestream::encode::cost::DeviceChoice;
use lodestream::mesh::Mesh;
use lodestream::quality::picture::{Cpu, Renderer};
use lodestream::quality::{Appearance, Snapshots, SsimError, ViewOptions};

#[cfg(feature = "gpu")]
use lodestream::gpu::{Device, DeviceError, DeviceOptions, GpuRenderer};

/// `auto` leaves less to the processor: samples and triangles of all pictures, for each of its threads. It is what one thread draws in
/// the second that finding a device and compiling its passes may take.
const WORTH: u64 = 14_000_000;

/// Options of the device that draws.
#[derive(Clone, clap::Args)]
pub struct DrawArgs {
    /// Where pictures are drawn: auto (a GPU if that is worth it), cpu, gpu, or gpu:NAME as `lodestream devices` lists
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: DeviceChoice,
    /// The most memory of the GPU to use, as in 2GiB; larger meshes are drawn in windows
    #[arg(long, value_name = "SIZE", value_parser = shared::parse_size)]
    gpu_memory: Option<u64>,
}

/// How much there is to draw.
pub struct Work {
    pub pictures: usize,
    /// Of one picture.
    pub pixels: u64,
    /// Faces of one picture.
    pub faces: usize,
}

/// What draws.
pub struct Pen {
    #[cfg(feature = "gpu")]
    gpu: Option<GpuRenderer>,
}

impl DrawArgs {
    /// What is to draw so much; says so if that is not what was asked for.
    pub fn pen(&self, work: &Work, threads: usize) -> Pen {
        let each = work.pixels.saturating_mul(4).saturating_add(work.faces as u64);
        let small = each.saturating_mul(work.pictures as u64) < WORTH.saturating_mul(threads as u64);
        let none = work.pictures == 0;
        if none || self.device == DeviceChoice::Cpu || self.device == DeviceChoice::Auto && small {
            return Pen::cpu();
        }
        Pen::open(&self.device, self.gpu_memory).unwrap_or_else(|why| {
            if let Some(why) = why {
                fell_back(&why);
            }
            Pen::cpu()
        })
    }
}

fn fell_back(why: &str) {
    shared::warn(format!("{why}; the processor draws instead"));
}

#[cfg(feature = "gpu")]
impl Pen {
    fn cpu() -> Self {
        Pen { gpu: None }
    }

    /// The device that is meant; or why there is none, if that is worth saying.
    fn open(choice: &DeviceChoice, memory: Option<u64>) -> Result<Self, Option<String>> {
        let options = DeviceOptions { memory, ..DeviceOptions::default() };
        match Device::open(choice, options).and_then(GpuRenderer::new) {
            Ok(mut gpu) => {
                // With LODESTREAM_LOSE_DEVICE=N in the environment it is lost after N pictures, for tests.
                if let Some(n) = std::env::var("LODESTREAM_LOSE_DEVICE").ok().and_then(|n| n.parse().ok()) {
                    gpu.lose_after(n);
                }
                Ok(Pen { gpu: Some(gpu) })
            }
            Err(DeviceError::None { .. }) if !choice.insists() => Err(None),
            Err(error) => Err(Some(error.to_string())),
        }
    }

    pub fn renderer(&self) -> &dyn Renderer {
        self.gpu.as_ref().map_or(&Cpu, |gpu| gpu)
    }

    /// Why the processor draws after all.
    fn failure(&self) -> Option<String> {
        self.gpu.as_ref().and_then(GpuRenderer::failure).map(|error| error.to_string())
    }
}

#[cfg(not(feature = "gpu"))]
impl Pen {
    fn cpu() -> Self {
        Pen {}
    }

    fn open(choice: &DeviceChoice, _memory: Option<u64>) -> Result<Self, Option<String>> {
        Err(choice.insists().then(|| "this program was built without GPU support".to_string()))
    }

    pub fn renderer(&self) -> &dyn Renderer {
        &Cpu
    }

    fn failure(&self) -> Option<String> {
        None
    }
}

impl Pen {
    /// The device that drew; says once if that is not the one that began.
    pub fn put_down(self) -> String {
        if let Some(why) = self.failure() {
            fell_back(&why);
        }
        self.renderer().name()
    }
}

/// Pictures of a mesh that others are compared with, all by the same device.
pub struct Looks<'a> {
    source: &'a Mesh,
    pen: &'a Pen,
    options: ViewOptions,
    snapshots: Snapshots,
    /// By the processor, since the device failed.
    again: bool,
}

impl<'a> Looks<'a> {
    pub fn new(source: &'a Mesh, pen: &'a Pen, options: ViewOptions) -> Result<Self, SsimError> {
        let snapshots = Snapshots::new(source, pen.renderer(), &options)?;
        let mut looks = Looks { source, pen, options, snapshots, again: false };
        looks.check()?;
        Ok(looks)
    }

    /// Draw the pictures again if the device failed on the way; whether it did.
    fn check(&mut self) -> Result<bool, SsimError> {
        if self.again || self.pen.failure().is_none() {
            return Ok(false);
        }
        self.again = true;
        self.snapshots = Snapshots::new(self.source, &Cpu, &self.options)?;
        Ok(true)
    }

    pub fn warnings(&self) -> &[String] {
        self.snapshots.warnings()
    }

    pub fn compare(&mut self, mesh: &Mesh) -> Result<Appearance, SsimError> {
        let look = self.snapshots.compare(mesh, self.pen.renderer())?;
        if self.check()? { self.snapshots.compare(mesh, &Cpu) } else { Ok(look) }
    }
}
