//! One device for the jobs of a run.
//!
//! Each job has buffers of its own, so that its level stays on the device; the kernels are compiled once. A token goes from job
//! to job, and who has it weighs one level: so jobs neither fill the queue of the device before others, nor compete for its
//! threads, while those that wait collapse. When the device fails one job it has failed all, at once.

use std::sync::{Arc, Mutex};

use crossbeam_channel::{Receiver, Sender, bounded};

use super::device::Device;
use super::error::DeviceError;
use super::weights::{GpuWeights, Kernels};
use crate::encode::cost::{EvaluateError, Evaluator, Fixed, Task};

/// How many deadlines a job waits for its turn.
const PATIENCE: u32 = 10;

/// A device that several jobs weigh on.
#[derive(Clone, Debug)]
pub struct SharedGpu {
    device: Device,
    kernels: Arc<Kernels>,
    turn: (Sender<()>, Receiver<()>),
    failure: Arc<Mutex<Option<DeviceError>>>,
}

impl SharedGpu {
    /// Compile the kernels on `device`; so many jobs share its memory.
    ///
    /// # Errors
    /// [`DeviceError`] when a shader is refused or memory runs out.
    pub fn new(mut device: Device, jobs: usize) -> Result<Self, DeviceError> {
        let kernels = Arc::new(Kernels::new(&device)?);
        device.options.memory = device.options.memory.map(|m| m / jobs.max(1) as u64);
        let turn = bounded(1);
        // The channel is empty and has room for one.
        let _ = turn.0.try_send(());
        Ok(SharedGpu { device, kernels, turn, failure: Arc::default() })
    }

    /// The evaluator of one job.
    ///
    /// # Errors
    /// [`DeviceError`] when memory runs out, or the device has failed a job before.
    pub fn evaluator(&self) -> Result<Box<dyn Evaluator>, DeviceError> {
        self.check()?;
        let weights = GpuWeights::on(self.device.clone(), self.kernels.clone())?;
        Ok(Box::new(InTurn { weights, shared: self.clone() }))
    }

    /// As if a job had been failed.
    #[cfg(test)]
    pub(super) fn fail_for_a_test(&self) {
        *self.failure.lock().unwrap() = Some(self.device.late());
    }

    fn check(&self) -> Result<(), DeviceError> {
        self.failure.lock().map_or(Ok(()), |failure| failure.clone().map_or(Ok(()), Err))
    }
}

/// Weighs when its turn has come.
#[derive(Debug)]
struct InTurn {
    weights: GpuWeights,
    shared: SharedGpu,
}

/// The token, given back when dropped.
struct Token<'a>(&'a Sender<()>);

impl Drop for Token<'_> {
    fn drop(&mut self) {
        let _ = self.0.try_send(());
    }
}

impl InTurn {
    fn weigh_in_turn(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, DeviceError> {
        let device = &self.shared.device;
        let deadline = device.options.deadline.saturating_mul(PATIENCE);
        self.shared.turn.1.recv_timeout(deadline).map_err(|_| device.late())?;
        let _token = Token(&self.shared.turn.0);
        self.shared.check()?;
        self.weights.weigh_all(task, out)
    }
}

impl Evaluator for InTurn {
    fn name(&self) -> String {
        self.weights.name()
    }

    fn beside(&self) -> bool {
        true
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        self.weigh_in_turn(task, out).map_err(|error| {
            if let Ok(mut failure) = self.shared.failure.lock() {
                failure.get_or_insert_with(|| error.clone());
            }
            EvaluateError(Box::new(error))
        })
    }
}
