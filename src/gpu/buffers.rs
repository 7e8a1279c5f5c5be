//! Memory on the device, and dispatches whose results come back by deadline.

use super::device::Device;
use super::error::DeviceError;
use super::shader::{GROUP, Kernel};

/// A buffer that grows when more has to go in.
#[derive(Debug)]
pub struct Growing {
    buffer: wgpu::Buffer,
    usage: wgpu::BufferUsages,
}

/// What a kernel reads.
pub const INPUT: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
/// The first binding.
pub const UNIFORM: wgpu::BufferUsages = wgpu::BufferUsages::UNIFORM.union(wgpu::BufferUsages::COPY_DST);
/// What a kernel writes.
const OUTPUT: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC);
/// What comes back.
const READBACK: wgpu::BufferUsages = wgpu::BufferUsages::MAP_READ.union(wgpu::BufferUsages::COPY_DST);

impl Growing {
    pub fn new(device: &Device, usage: wgpu::BufferUsages) -> Self {
        Growing { buffer: create(device, usage, 16), usage }
    }

    /// Make room for so many bytes; what it held is lost where it grows.
    pub fn reserve(&mut self, device: &Device, bytes: u64) {
        if self.buffer.size() < bytes {
            self.buffer.destroy();
            self.buffer = create(device, self.usage, bytes.next_multiple_of(16));
        }
    }

    /// Put words at its beginning.
    pub fn put(&mut self, device: &Device, words: &[u32]) {
        self.reserve(device, words.len() as u64 * 4);
        device.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(words));
    }

    /// Put bytes at an offset, where there is room for them.
    pub fn put_at(&mut self, device: &Device, offset: u64, bytes: &[u8]) {
        device.queue.write_buffer(&self.buffer, offset, bytes);
    }

    /// Bytes that fit.
    pub fn size(&self) -> u64 {
        self.buffer.size()
    }

    pub fn binding(&self, binding: u32) -> wgpu::BindGroupEntry<'_> {
        wgpu::BindGroupEntry { binding, resource: self.buffer.as_entire_binding() }
    }
}

fn create(device: &Device, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
    device.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

/// Workgroups for so many items.
fn groups(device: &Device, count: usize) -> Result<u32, DeviceError> {
    let groups = (count as u32).div_ceil(GROUP);
    let most = device.device.limits().max_compute_workgroups_per_dimension;
    if groups > most {
        return Err(DeviceError::TooSmall {
            device: device.info.name.clone(),
            what: "the number of workgroups",
            has: most.into(),
            needs: groups.into(),
        });
    }
    Ok(groups)
}

fn pass(
    device: &Device,
    encoder: &mut wgpu::CommandEncoder,
    kernel: &Kernel,
    entries: &[wgpu::BindGroupEntry],
    groups: u32,
) {
    let group =
        device.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &kernel.layout, entries });
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(&kernel.pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups(groups, 1, 1);
}

/// Dispatch `kernel` over `count` items; what it writes stays on the device.
pub fn change(
    device: &Device,
    kernel: &Kernel,
    entries: &[wgpu::BindGroupEntry],
    count: usize,
) -> Result<(), DeviceError> {
    let groups = groups(device, count)?;
    let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    pass(device, &mut encoder, kernel, entries, groups);
    device.queue.submit([encoder.finish()]);
    device.check()
}

/// Where the results of one dispatch go, and what tells when they are there.
#[derive(Debug)]
pub struct Results {
    output: Growing,
    readback: Growing,
    bytes: u64,
    submission: Option<wgpu::SubmissionIndex>,
    mapped: Option<crossbeam_channel::Receiver<Result<(), wgpu::BufferAsyncError>>>,
}

impl Results {
    pub fn new(device: &Device) -> Self {
        Results {
            output: Growing::new(device, OUTPUT),
            readback: Growing::new(device, READBACK),
            bytes: 0,
            submission: None,
            mapped: None,
        }
    }

    /// Dispatch `kernel` over `count` items of `words` results each; `inputs` are its bindings but the last.
    pub fn dispatch(
        &mut self,
        device: &Device,
        kernel: &Kernel,
        inputs: &[wgpu::BindGroupEntry],
        count: usize,
        words: usize,
    ) -> Result<(), DeviceError> {
        let groups = groups(device, count)?;
        let mut entries = inputs.to_vec();
        let output = self.output(device, (count * words * 4) as u64)?;
        entries.push(output.binding(inputs.len() as u32));
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        pass(device, &mut encoder, kernel, &entries, groups);
        self.submit(device, encoder)
    }

    /// Where so many bytes of results go.
    pub fn output(&mut self, device: &Device, bytes: u64) -> Result<&Growing, DeviceError> {
        self.bytes = bytes;
        self.output.reserve(device, bytes);
        self.readback.reserve(device, bytes);
        device.check()?;
        Ok(&self.output)
    }

    /// Submit what writes to [`output`](Self::output); [`wait`](Self::wait) hands it over.
    pub fn submit(&mut self, device: &Device, mut encoder: wgpu::CommandEncoder) -> Result<(), DeviceError> {
        encoder.copy_buffer_to_buffer(&self.output.buffer, 0, &self.readback.buffer, 0, self.bytes);
        self.submission = Some(device.queue.submit([encoder.finish()]));
        device.check()?;
        let (sender, receiver) = crossbeam_channel::bounded(1);
        self.readback.buffer.map_async(wgpu::MapMode::Read, 0..self.bytes, move |result| {
            let _ = sender.send(result);
        });
        self.mapped = Some(receiver);
        Ok(())
    }

    /// Wait for what was dispatched, at most until the deadline.
    pub fn wait(&mut self, device: &Device) -> Result<Vec<[u32; 2]>, DeviceError> {
        self.wait_for(device)
    }

    /// The same for results of another kind.
    pub fn wait_for<T: bytemuck::Pod>(&mut self, device: &Device) -> Result<Vec<T>, DeviceError> {
        let (Some(submission), Some(mapped)) = (self.submission.take(), self.mapped.take()) else {
            return Err(device.failed("nothing was dispatched"));
        };
        settle(device, submission)?;
        match mapped.recv_timeout(device.options.deadline) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(device.failed(&error.to_string())),
            Err(_) => return Err(device.late()),
        }
        let view =
            self.readback.buffer.get_mapped_range(0..self.bytes).map_err(|error| device.failed(&error.to_string()))?;
        // The driver's memory may lie at any address.
        let words = bytemuck::pod_collect_to_vec(&view[..]);
        drop(view);
        self.readback.buffer.unmap();
        device.check()?;
        Ok(words)
    }
}

/// Wait until a submission is done, at most until the deadline.
pub fn settle(device: &Device, submission: wgpu::SubmissionIndex) -> Result<(), DeviceError> {
    let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(device.options.deadline) };
    match device.device.poll(wait) {
        Ok(_) => device.check(),
        Err(wgpu::PollError::Timeout) => Err(device.late()),
        Err(error) => Err(device.failed(&error.to_string())),
    }
}
