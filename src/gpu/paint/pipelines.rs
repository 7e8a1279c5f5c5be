//! The passes of the renderer: what each is bound to, and how it is compiled.

use crate::gpu::device::Device;
use crate::gpu::error::DeviceError;
use crate::gpu::shader::compose;

/// Numbers of triangles, one a sample.
pub const IDS: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Depths of samples.
pub const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Texels: 16 bits a channel, as the twin has them; blended by the shader.
pub const TEXELS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Uint;
/// Storage buffers that `shade` sees.
pub const BUFFERS: u32 = 5;
/// Invocations along each side of a workgroup.
pub const GROUP: u32 = 8;

/// All passes.
#[derive(Debug)]
pub struct Pipelines {
    /// `scene.wgsl`: a window of triangles.
    pub scene: wgpu::BindGroupLayout,
    /// Samples of lines and points.
    pub plots: wgpu::BindGroupLayout,
    /// What `shade` reads and writes besides.
    pub light: wgpu::BindGroupLayout,
    /// All that `finish` knows.
    pub finish: wgpu::BindGroupLayout,
    /// Draw triangles.
    pub solid: wgpu::RenderPipeline,
    /// The same where alpha may cut.
    pub cut: wgpu::RenderPipeline,
    /// Draw samples of lines and points.
    pub plot: wgpu::RenderPipeline,
    /// Light what is seen.
    pub shade: wgpu::ComputePipeline,
    /// Make pixels of light.
    pub pixels: wgpu::ComputePipeline,
}

fn buffer(binding: u32, visibility: wgpu::ShaderStages, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    let ty = wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

fn texture(
    binding: u32,
    visibility: wgpu::ShaderStages,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    let ty =
        wgpu::BindingType::Texture { sample_type: wgpu::TextureSampleType::Uint, view_dimension, multisampled: false };
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

const UNIFORM: wgpu::BufferBindingType = wgpu::BufferBindingType::Uniform;
const READ: wgpu::BufferBindingType = wgpu::BufferBindingType::Storage { read_only: true };
const WRITE: wgpu::BufferBindingType = wgpu::BufferBindingType::Storage { read_only: false };

impl Pipelines {
    /// Compile all.
    pub fn new(device: &Device) -> Result<Self, DeviceError> {
        device.check()?;
        let gpu = &device.device;
        let layout = |label: &str, entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let all = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
        let compute = wgpu::ShaderStages::COMPUTE;
        let flat = wgpu::TextureViewDimension::D2;
        let scene = layout(
            "scene",
            &[
                buffer(0, all, UNIFORM),
                buffer(1, all, READ),
                buffer(2, all, READ),
                buffer(3, all, READ),
                buffer(4, all, READ),
                texture(5, all, wgpu::TextureViewDimension::D2Array),
            ],
        );
        let plots = layout("plots", &[buffer(0, wgpu::ShaderStages::VERTEX, READ)]);
        let light = layout("light", &[texture(0, compute, flat), buffer(1, compute, WRITE)]);
        let finish = layout(
            "finish",
            &[
                buffer(0, compute, UNIFORM),
                texture(1, compute, flat),
                buffer(2, compute, READ),
                buffer(3, compute, READ),
                buffer(4, compute, READ),
                buffer(5, compute, WRITE),
            ],
        );
        let module = |name: &str| {
            gpu.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(compose(&format!("{name}.wgsl")).into()),
            })
        };
        let (raster, shading, finishing) = (module("raster"), module("shade"), module("finish"));
        let outline = |groups: &[&wgpu::BindGroupLayout]| {
            let groups: Vec<Option<&wgpu::BindGroupLayout>> = groups.iter().map(|g| Some(*g)).collect();
            gpu.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &groups,
                immediate_size: 0,
            })
        };
        let draw = |groups: &[&wgpu::BindGroupLayout], topology, vertex: &str, fragment: &str| {
            gpu.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(&outline(groups)),
                vertex: wgpu::VertexState {
                    module: &raster,
                    entry_point: Some(vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState { topology, ..wgpu::PrimitiveState::default() },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: wgpu::StencilState::default(),
                    bias: wgpu::DepthBiasState::default(),
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &raster,
                    entry_point: Some(fragment),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: IDS,
                        blend: None,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let work = |groups: &[&wgpu::BindGroupLayout], module: &wgpu::ShaderModule, entry: &str| {
            gpu.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&outline(groups)),
                module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        let triangles = wgpu::PrimitiveTopology::TriangleList;
        let solid = draw(&[&scene], triangles, "corner", "number");
        let cut = draw(&[&scene], triangles, "corner", "number_where_solid");
        let plot = draw(&[&scene, &plots], wgpu::PrimitiveTopology::PointList, "plot", "number");
        let shade = work(&[&scene, &light], &shading, "shade");
        let pixels = work(&[&finish], &finishing, "finish");
        device.check().map_err(|e| match e {
            DeviceError::Failed { device, reason } => DeviceError::Shader { device, reason },
            other => other,
        })?;
        Ok(Pipelines { scene, plots, light, finish, solid, cut, plot, shade, pixels })
    }
}
