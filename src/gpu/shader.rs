//! The shaders: their texts, how they are put together, and the layout that Rust assumes of them.
//!
//! WGSL has no includes. A line `//#include "name.wgsl"` stands for the text of that file, once: a second include of the
//! same file is empty. Nothing else is added; what comes out is plain WGSL, which a test validates with naga.

use super::device::Device;
use super::error::DeviceError;
pub use super::layout::*;

/// All files, by name.
pub const FILES: [(&str, &str); 7] = [
    ("triangle.wgsl", include_str!("../../shaders/triangle.wgsl")),
    ("level.wgsl", include_str!("../../shaders/level.wgsl")),
    ("apply.wgsl", include_str!("../../shaders/apply.wgsl")),
    ("patch.wgsl", include_str!("../../shaders/patch.wgsl")),
    ("edge_weight.wgsl", include_str!("../../shaders/edge_weight.wgsl")),
    ("seam_displacement.wgsl", include_str!("../../shaders/seam_displacement.wgsl")),
    ("hausdorff.wgsl", include_str!("../../shaders/hausdorff.wgsl")),
];

/// The text of a file with its includes in place; an unknown name is empty, and so refused by any validator.
pub fn compose(name: &str) -> String {
    let mut out = String::new();
    append(name, &mut Vec::new(), &mut out);
    out
}

fn append<'a>(name: &'a str, seen: &mut Vec<&'a str>, out: &mut String) {
    let Some(&(_, text)) = FILES.iter().find(|(known, _)| *known == name) else { return };
    if seen.contains(&name) {
        return;
    }
    seen.push(name);
    for line in text.lines() {
        match line.strip_prefix("//#include \"").and_then(|rest| rest.strip_suffix('"')) {
            Some(part) => append(part, seen, out),
            None => {
                out.push_str(line);
                out.push('\n');
            }
        }
    }
}

/// A kernel, ready to be dispatched.
#[derive(Debug)]
pub struct Kernel {
    pub pipeline: wgpu::ComputePipeline,
    pub layout: wgpu::BindGroupLayout,
}

impl Kernel {
    /// Compile `NAME.wgsl`, entry point `NAME`, for binding 0 a uniform, then `inputs` buffers to read and one to write.
    pub fn new(device: &Device, name: &str, inputs: u32) -> Result<Kernel, DeviceError> {
        device.check()?;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let mut entries = vec![entry(0, wgpu::BufferBindingType::Uniform)];
        for i in 1..=inputs + 1 {
            entries.push(entry(i, wgpu::BufferBindingType::Storage { read_only: i <= inputs }));
        }
        let gpu = &device.device;
        let text = compose(&format!("{name}.wgsl"));
        let module = gpu.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(text.into()),
        });
        let layout =
            gpu.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries });
        let pipeline_layout = gpu.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(name),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        device.check().map_err(|e| match e {
            DeviceError::Failed { device, reason } => DeviceError::Shader { device, reason },
            other => other,
        })?;
        Ok(Kernel { pipeline, layout })
    }
}
