//! One scene on the device, drawn view by view.
//!
//! A picture is drawn in tiles, so that its size is no matter of the device's; a mesh in windows. On each tile all windows are drawn with one
//! depth test, then each lights the samples that show it, then light becomes pixels.

use crate::gpu::buffers::{Growing, INPUT, Results, UNIFORM, settle};
use crate::gpu::device::Device;
use crate::gpu::error::DeviceError;
use crate::quality::picture::scene::{NONE, Scene};
use crate::quality::picture::screen::{EMPTY, SAMPLES, Screen, codes, plain_lights};
use crate::quality::picture::texture::Texture;
use crate::quality::picture::{Picture, View};

use super::pipelines::{DEPTH, GROUP, IDS, Pipelines};
use super::upload::{Depths, FRAME, Images, Slot, Window, paints, windows};

/// Pixels of a tile's side, at most.
const TILE: u32 = 1024;
/// Bytes that a pixel takes: number and depth of each sample, its light, its colour there and back.
const PIXEL: u64 = (SAMPLES * SAMPLES * 8 + 16 + 4 + 4) as u64;
/// Samples of lines and points that go to the device at a time.
const PLOTS: usize = 1 << 18;
/// Words of a `Plot`.
const PLOT: usize = 3;

/// Where samples are drawn to.
#[derive(Debug)]
struct Target {
    ids: wgpu::TextureView,
    depth: wgpu::TextureView,
    light: Growing,
    tile: Growing,
    plots: Growing,
    results: Results,
}

/// A part of a picture, in samples.
#[derive(Clone, Copy)]
struct Tile {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
}

/// A scene on the device.
pub struct Canvas<'a> {
    device: &'a Device,
    pipelines: &'a Pipelines,
    scene: &'a Scene,
    /// Pixels.
    size: [u32; 2],
    side: u32,
    windows: Vec<Window>,
    /// Where windows take turns.
    spare: Slot,
    /// Room for the number that each point has in a window.
    numbers: Vec<u32>,
    paints: Growing,
    images: Images,
    cut: bool,
    others: Growing,
    codes: Growing,
    target: Target,
}

impl Target {
    fn new(device: &Device, width: u32, height: u32) -> Self {
        let texture = |format, other| {
            let texture = device.device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width: width * SAMPLES as u32,
                    height: height * SAMPLES as u32,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | other,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let mut target = Target {
            ids: texture(IDS, wgpu::TextureUsages::TEXTURE_BINDING),
            depth: texture(DEPTH, wgpu::TextureUsages::empty()),
            light: Growing::new(device, INPUT),
            tile: Growing::new(device, UNIFORM),
            plots: Growing::new(device, INPUT),
            results: Results::new(device),
        };
        target.light.reserve(device, u64::from(width) * u64::from(height) * 16);
        target
    }
}

impl<'a> Canvas<'a> {
    /// Send what does not change from view to view.
    pub fn new(
        device: &'a Device,
        pipelines: &'a Pipelines,
        scene: &'a Scene,
        size: [u32; 2],
    ) -> Result<Self, DeviceError> {
        let fitting = (device.budget() / 4 / PIXEL).isqrt().clamp(64, TILE.into()) as u32;
        let side = fitting.min(device.device.limits().max_texture_dimension_2d / SAMPLES as u32);
        let images: Vec<Option<&Texture>> = scene.materials.first().map_or_else(Vec::new, |p| p.images.all().collect());
        let images = Images::new(device, &images)?;
        let mut numbers = vec![NONE; scene.points.len()];
        let windows = windows(device, scene, &mut numbers)?;
        let lights = plain_lights().into_iter().chain(scene.isolated.iter().map(|(_, light)| *light));
        let lights: Vec<[f32; 4]> = lights.map(|[r, g, b]| [r, g, b, 0.0]).collect();
        let bytes = lights.len() as u64 * 16;
        if bytes > device.info.binding_bytes.min(device.budget() / 8) {
            return Err(DeviceError::TooSmall {
                device: device.info.name.clone(),
                what: "the size of a bound buffer",
                has: device.info.binding_bytes.min(device.budget() / 8),
                needs: bytes,
            });
        }
        let mut others = Growing::new(device, INPUT);
        others.put(device, bytemuck::cast_slice(&lights));
        let mut table = Growing::new(device, INPUT);
        table.put(device, &codes().into_iter().map(u32::from).collect::<Vec<u32>>());
        let canvas = Canvas {
            paints: paints(device, scene, &images),
            images,
            spare: Slot::new(device),
            cut: scene.materials.iter().any(|m| m.cutoff.is_some()),
            target: Target::new(device, size[0].min(side), size[1].min(side)),
            device,
            pipelines,
            scene,
            size,
            side,
            windows,
            numbers,
            others,
            codes: table,
        };
        device.check()?;
        Ok(canvas)
    }

    /// Draw the scene from a view.
    pub fn draw(&mut self, view: &View) -> Result<Picture, DeviceError> {
        let [width, height] = self.size;
        let screen = Screen::new(self.scene, view, width as usize * SAMPLES, height as usize * SAMPLES);
        let depths = Depths::new(&screen);
        for window in &mut self.windows {
            let points = window.points().to_vec();
            if let Some(slot) = &mut window.slot {
                slot.put_points(self.device, &points, &screen, depths);
            }
        }
        let mut picture = Picture::new(width, height, [0; 3]);
        let samples = SAMPLES as u32;
        for top in (0..height).step_by(self.side as usize) {
            for left in (0..width).step_by(self.side as usize) {
                let (wide, high) = (self.side.min(width - left), self.side.min(height - top));
                let tile =
                    Tile { left: left * samples, top: top * samples, width: wide * samples, height: high * samples };
                let pixels = self.draw_tile(&screen, depths, tile)?;
                for (row, pixels) in (top as usize..).zip(pixels.chunks_exact(wide as usize)) {
                    let start = 3 * (row * width as usize + left as usize);
                    let places = picture.rgb[start..].as_chunks_mut::<3>().0;
                    for (place, pixel) in places.iter_mut().zip(pixels) {
                        let [r, g, b, _] = pixel.to_le_bytes();
                        *place = [r, g, b];
                    }
                }
            }
        }
        Ok(picture)
    }

    fn draw_tile(&mut self, screen: &Screen, depths: Depths, tile: Tile) -> Result<Vec<u32>, DeviceError> {
        let device = self.device;
        for i in 0..self.windows.len() {
            let group = self.window(i, screen, depths, tile)?;
            let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = self.target.pass(&mut encoder, tile, i == 0);
            pass.set_pipeline(if self.cut { &self.pipelines.cut } else { &self.pipelines.solid });
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3 * self.windows[i].count, 0..1);
            drop(pass);
            self.submit(encoder, i)?;
        }
        self.draw_plots(screen, depths, tile)?;
        let light = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipelines.light,
            entries: &[self.target.ids_binding(0), self.target.light.binding(1)],
        });
        let [across, down] = [tile.width, tile.height].map(|n| (n / SAMPLES as u32).div_ceil(GROUP));
        for i in 0..self.windows.len() {
            let group = self.window(i, screen, depths, tile)?;
            let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            if i == 0 {
                self.target.light.clear(&mut encoder);
            }
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipelines.shade);
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(1, &light, &[]);
            pass.dispatch_workgroups(across, down, 1);
            drop(pass);
            self.submit(encoder, i)?;
        }
        self.target.tile.put(device, &[tile.width, tile.height, self.scene.triangles.len() as u32, 0]);
        let bytes = u64::from(tile.width) * u64::from(tile.height) / (SAMPLES * SAMPLES) as u64 * 4;
        let Target { ids, light, tile, results, .. } = &mut self.target;
        let pixels = results.output(device, bytes)?;
        let group = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipelines.finish,
            entries: &[
                tile.binding(0),
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(ids) },
                light.binding(2),
                self.others.binding(3),
                self.codes.binding(4),
                pixels.binding(5),
            ],
        });
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipelines.pixels);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(across, down, 1);
        drop(pass);
        results.submit(device, encoder)?;
        results.wait_for(device)
    }

    /// Bring a window to the device, if it is not there, and say which tile is drawn.
    fn window(
        &mut self,
        i: usize,
        screen: &Screen,
        depths: Depths,
        tile: Tile,
    ) -> Result<wgpu::BindGroup, DeviceError> {
        let (device, window) = (self.device, &mut self.windows[i]);
        let mut frame = [0; FRAME];
        frame[..7].copy_from_slice(&[
            tile.left,
            tile.top,
            tile.width,
            tile.height,
            window.first,
            window.count,
            self.scene.triangles.len() as u32,
        ]);
        frame[8..11].copy_from_slice(&screen.lamp.map(f32::to_bits));
        if window.slot.is_none() {
            self.spare.put_points(device, window.points(), screen, depths);
            window.send(device, self.scene, &mut self.spare, &mut self.numbers);
        }
        let slot = window.slot.as_mut().unwrap_or(&mut self.spare);
        slot.put_frame(device, &frame);
        device.check()?;
        Ok(slot.group(device, self.pipelines, &self.paints, &self.images))
    }

    /// Submit the work on a window; one that takes turns with others is waited for, as so much memory is written for each.
    fn submit(&self, encoder: wgpu::CommandEncoder, i: usize) -> Result<(), DeviceError> {
        let submission = self.device.queue.submit([encoder.finish()]);
        if self.windows[i].slot.is_none() {
            return settle(self.device, submission);
        }
        self.device.check()
    }

    /// Draw lines and lone points: the processor says which samples they are, as for the twin.
    fn draw_plots(&mut self, screen: &Screen, depths: Depths, tile: Tile) -> Result<(), DeviceError> {
        let scene = self.scene;
        if scene.wires.is_empty() && scene.dangling.is_empty() && scene.isolated.is_empty() {
            return Ok(());
        }
        let group = self.window(0, screen, depths, tile)?;
        let mut plots: Vec<[u32; PLOT]> = Vec::new();
        let mut result = Ok(());
        let rows = tile.top as usize..(tile.top + tile.height) as usize;
        let [columns, lines] = [(tile.left, tile.width), (tile.top, tile.height)].map(|(at, n)| {
            let at = i64::from(at);
            at..at + i64::from(n)
        });
        screen.lines_and_points(scene, rows, |x, y, depth, id| {
            if columns.contains(&x) && lines.contains(&y) && result.is_ok() {
                plots.push([x as u32 | (y as u32) << 16, depths.z(depth).to_bits(), id]);
                if plots.len() == PLOTS {
                    result = self.send_plots(&group, tile, &plots);
                    plots.clear();
                }
            }
        });
        result?;
        if plots.is_empty() { Ok(()) } else { self.send_plots(&group, tile, &plots) }
    }

    fn send_plots(&mut self, group: &wgpu::BindGroup, tile: Tile, plots: &[[u32; PLOT]]) -> Result<(), DeviceError> {
        let device = self.device;
        self.target.plots.put(device, plots.as_flattened());
        let own = device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipelines.plots,
            entries: &[self.target.plots.binding(0)],
        });
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = self.target.pass(&mut encoder, tile, false);
        pass.set_pipeline(&self.pipelines.plot);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, &own, &[]);
        pass.draw(0..plots.len() as u32, 0..1);
        drop(pass);
        let submission = device.queue.submit([encoder.finish()]);
        settle(device, submission)
    }
}

impl Target {
    fn ids_binding(&self, binding: u32) -> wgpu::BindGroupEntry<'_> {
        wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(&self.ids) }
    }

    /// Draw into the samples of a tile, the first time or above what is there.
    fn pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, tile: Tile, first: bool) -> wgpu::RenderPass<'e> {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.ids,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: if first {
                        wgpu::LoadOp::Clear(wgpu::Color { r: EMPTY.into(), g: 0.0, b: 0.0, a: 0.0 })
                    } else {
                        wgpu::LoadOp::Load
                    },
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations {
                    load: if first { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load },
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_viewport(0.0, 0.0, tile.width as f32, tile.height as f32, 0.0, 1.0);
        pass
    }
}
