//! A scene as the passes read it: windows of triangles, paints, and all images in one texture.

use std::ops::Range;

use crate::gpu::buffers::{Growing, INPUT, UNIFORM, settle};
use crate::gpu::device::Device;
use crate::gpu::error::DeviceError;
use crate::parallel;
use crate::quality::picture::scene::{NONE, Scene};
use crate::quality::picture::screen::{Screen, Seen};
use crate::quality::picture::texture::{Texture, Wrap};

use super::pipelines::{Pipelines, TEXELS};

/// Words of a `Triangle`.
pub const TRIANGLE: usize = 20;
/// Words of a `Paint`.
pub const PAINT: usize = 12;
/// Words of a `Frame`.
pub const FRAME: usize = 12;
/// In the paint of a triangle: it has texture coordinates.
pub const HAS_UVS: u32 = 1 << 30;
/// In the paint of a triangle: it has colours.
pub const HAS_COLOURS: u32 = 1 << 31;
/// Texels of a row of the texture that holds all images, and rows of a layer.
pub const ROW: u32 = 2048;
/// Layers at most: the numbers of texels are 32 bits.
const LAYERS: u32 = 512;
/// Rows that are sent at a time.
const ROWS: u32 = 256;
/// Bytes of a window of triangles, at most.
const WINDOW: u64 = 128 << 20;
/// Triangles and points that stay on the device from picture to picture, at most; what is beyond it is sent for each.
const RESIDENT: u64 = 1 << 30;
/// Bytes of a triangle with points of its own and colours.
const WHOLE: u64 = 4 * TRIANGLE as u64 + 3 * 16 + 48;

/// The buffers of a window.
#[derive(Debug)]
pub struct Slot {
    frame: Growing,
    seen: Growing,
    triangles: Growing,
    colours: Growing,
}

/// Triangles that the device sees at once.
#[derive(Debug)]
pub struct Window {
    /// Number of the first, and how many.
    pub first: u32,
    pub count: u32,
    /// The scene's points that they touch.
    points: Vec<u32>,
    /// Its own buffers, or none where it takes turns with others.
    pub slot: Option<Slot>,
}

/// How depths become numbers from 0.1 to 0.9, so that no depth is clipped.
#[derive(Clone, Copy, Debug)]
pub struct Depths {
    low: f64,
    scale: f64,
}

impl Depths {
    /// For all points that are there, and what is lifted out of them.
    pub fn new(screen: &Screen) -> Self {
        let all = screen.seen.iter().filter(|p| p.there).map(|p| f64::from(p.depth));
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
        let wide = high + f64::from(screen.lift()) - low;
        if wide.is_finite() && wide > 0.0 { Depths { low, scale: 0.8 / wide } } else { Depths { low: 0.0, scale: 0.0 } }
    }

    pub fn z(self, depth: f32) -> f32 {
        (0.1 + (f64::from(depth) - self.low) * self.scale) as f32
    }

    fn words(self, p: Seen) -> [u32; 4] {
        let z = if p.there { self.z(p.depth) } else { -1.0 };
        [p.x as u32, p.y as u32, z.to_bits(), p.near.to_bits()]
    }
}

impl Slot {
    pub fn new(device: &Device) -> Self {
        let mut slot = Slot {
            frame: Growing::new(device, UNIFORM),
            seen: Growing::new(device, INPUT),
            triangles: Growing::new(device, INPUT),
            colours: Growing::new(device, INPUT),
        };
        slot.frame.reserve(device, 4 * FRAME as u64);
        slot.triangles.reserve(device, 4 * TRIANGLE as u64);
        slot
    }

    /// Where the points of a window are seen.
    pub fn put_points(&mut self, device: &Device, window: &[u32], screen: &Screen, depths: Depths) {
        let words = parallel::map(parallel::ranges(window.len(), 1 << 14), |range| {
            window[range].iter().map(|&p| depths.words(screen.seen[p as usize])).collect::<Vec<[u32; 4]>>()
        });
        self.seen.put(device, words.concat().as_flattened());
    }

    /// Triangles of a window whose points `numbers` counts.
    fn put_triangles(&mut self, device: &Device, scene: &Scene, window: Range<usize>, numbers: &[u32]) {
        let coloured = !scene.colours.is_empty();
        let parts = parallel::map(parallel::ranges(window.len(), 1 << 13), |part| {
            let mut words = Vec::with_capacity(part.len());
            let mut colours = Vec::new();
            for triangle in &scene.triangles[window.start + part.start..window.start + part.end] {
                let values = scene.surface(triangle);
                let mut paint = triangle.material;
                paint |= if values.uvs.is_some() { HAS_UVS } else { 0 };
                paint |= if values.colours.is_some() { HAS_COLOURS } else { 0 };
                let mut word = [0; TRIANGLE];
                triangle.points.iter().zip(&mut word).for_each(|(&p, w)| *w = numbers[p as usize]);
                word[3] = paint;
                let numbers = values.normals.as_flattened().iter();
                let numbers = numbers.chain(values.uvs.as_ref().map_or(&[0.0; 6][..], |t| t.as_flattened()));
                word[4..19].iter_mut().zip(numbers).for_each(|(w, n)| *w = n.to_bits());
                word[19] = (values.texels as f32).to_bits();
                words.push(word);
                if coloured {
                    colours.push(values.colours.unwrap_or_default());
                }
            }
            (words, colours)
        });
        let (words, colours): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        self.triangles.put(device, words.concat().as_flattened());
        if coloured {
            self.colours.put(device, bytemuck::cast_slice(&colours.concat()));
        }
    }

    pub fn put_frame(&mut self, device: &Device, words: &[u32; FRAME]) {
        self.frame.put(device, words);
    }

    /// What the passes see of it.
    pub fn group(&self, device: &Device, pipelines: &Pipelines, paints: &Growing, images: &Images) -> wgpu::BindGroup {
        device.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipelines.scene,
            entries: &[
                self.frame.binding(0),
                self.seen.binding(1),
                self.triangles.binding(2),
                self.colours.binding(3),
                paints.binding(4),
                wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::TextureView(&images.view) },
            ],
        })
    }
}

impl Window {
    /// Send its triangles to buffers.
    pub fn send(&self, device: &Device, scene: &Scene, slot: &mut Slot, numbers: &mut [u32]) {
        self.points.iter().zip(0..).for_each(|(&p, i)| numbers[p as usize] = i);
        slot.put_triangles(device, scene, self.first as usize..(self.first + self.count) as usize, numbers);
    }

    pub fn points(&self) -> &[u32] {
        &self.points
    }
}

/// All triangles in windows, at least one; as many as may stay on the device are there afterwards.
pub fn windows(device: &Device, scene: &Scene, numbers: &mut [u32]) -> Result<Vec<Window>, DeviceError> {
    let limit = device.info.binding_bytes.min(WINDOW).min(device.budget() / 8);
    let most = (limit / (4 * TRIANGLE as u64)).max(64) as usize;
    let resident = RESIDENT.min(device.budget() / 2);
    let count = scene.triangles.len();
    let mut windows = Vec::new();
    let mut sent = 0;
    for first in (0..count.max(1)).step_by(most) {
        let range = first..count.min(first + most);
        let mut points = Vec::new();
        numbers.fill(NONE);
        for &p in scene.triangles[range.clone()].iter().flat_map(|t| &t.points) {
            if numbers[p as usize] == NONE {
                numbers[p as usize] = points.len() as u32;
                points.push(p);
            }
        }
        let mut window = Window { first: first as u32, count: range.len() as u32, points, slot: None };
        let bytes = range.len() as u64 * WHOLE;
        if sent + bytes <= resident {
            sent += bytes;
            let mut slot = Slot::new(device);
            window.send(device, scene, &mut slot, numbers);
            window.slot = Some(slot);
            // What was written waits in the program's memory for a submission.
            device.queue.submit([]);
            device.check()?;
        }
        windows.push(window);
    }
    Ok(windows)
}

/// All images in all sizes, one texel after the other.
#[derive(Debug)]
pub struct Images {
    view: wgpu::TextureView,
    /// For each image its first row, its width and height, and how many sizes there are.
    places: Vec<Option<[u32; 4]>>,
}

impl Images {
    pub fn new(device: &Device, images: &[Option<&Texture>]) -> Result<Self, DeviceError> {
        let mut rows = 0u64;
        let mut places = Vec::new();
        for image in images {
            let Some(image) = image else {
                places.push(None);
                continue;
            };
            let texels: usize = image.sizes.iter().map(|s| s.texels.len()).sum();
            let full = &image.sizes[0];
            // Too many rows are refused below.
            places.push(Some([rows as u32, full.width as u32, full.height as u32, image.sizes.len() as u32]));
            rows += (texels as u64).div_ceil(ROW.into());
        }
        let limits = device.device.limits();
        let most = LAYERS.min(limits.max_texture_array_layers);
        let too_small =
            |what, has, needs| Err(DeviceError::TooSmall { device: device.info.name.clone(), what, has, needs });
        let layers = rows.div_ceil(ROW.into()).max(1);
        if layers > most.into() {
            return too_small("the room for images, in layers of 2048 by 2048,", most.into(), layers);
        }
        let height = if layers > 1 { ROW } else { rows.max(1) as u32 };
        let bytes = layers * u64::from(height) * u64::from(ROW) * 8;
        if bytes > device.budget() / 2 {
            return too_small("the memory for images, in bytes,", device.budget() / 2, bytes);
        }
        let texture = device.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("images"),
            size: wgpu::Extent3d { width: ROW, height, depth_or_array_layers: layers as u32 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TEXELS,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        device.check()?;
        for (image, place) in images.iter().zip(&places) {
            if let (Some(image), Some([row, ..])) = (image, place) {
                send(device, &texture, image, *row)?;
            }
        }
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..wgpu::TextureViewDescriptor::default()
        });
        Ok(Images { view, places })
    }
}

/// Send an image from a row on, a block of rows of one layer at a time.
fn send(device: &Device, texture: &wgpu::Texture, image: &Texture, mut row: u32) -> Result<(), DeviceError> {
    let mut block: Vec<[u16; 4]> = Vec::new();
    let mut sizes = image.sizes.iter();
    let mut rest: &[[u16; 4]] = &[];
    loop {
        let rows = ROWS.min(ROW - row % ROW);
        let room = (rows * ROW) as usize;
        block.clear();
        while block.len() < room {
            if rest.is_empty() {
                let Some(size) = sizes.next() else { break };
                rest = &size.texels;
            }
            let (now, later) = rest.split_at(rest.len().min(room - block.len()));
            block.extend_from_slice(now);
            rest = later;
        }
        if block.is_empty() {
            return Ok(());
        }
        let height = block.len().div_ceil(ROW as usize) as u32;
        block.resize((height * ROW) as usize, [0; 4]);
        device.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: row % ROW, z: row / ROW },
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(&block),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(ROW * 8), rows_per_image: None },
            wgpu::Extent3d { width: ROW, height, depth_or_array_layers: 1 },
        );
        // What was written waits in the program's memory until it has arrived.
        let submission = device.queue.submit([]);
        settle(device, submission)?;
        row += height;
    }
}

/// What triangles are painted with.
pub fn paints(device: &Device, scene: &Scene, images: &Images) -> Growing {
    let wrap = |w: Wrap| match w {
        Wrap::Repeat => 0,
        Wrap::Clamp => 1,
        Wrap::Mirror => 2,
    };
    let words = scene.materials.iter().flat_map(|paint| {
        let place = paint.texture.and_then(|(image, wraps)| Some((images.places.get(image).copied()??, wraps)));
        let mut words = [0u32; PAINT];
        words.iter_mut().zip(paint.factor).for_each(|(w, f)| *w = f.to_bits());
        words[4] = paint.cutoff.unwrap_or(f32::MIN).to_bits();
        words[5] = paint.plain.into();
        if let Some(([row, width, height, levels], wraps)) = place {
            words[6..11].copy_from_slice(&[wrap(wraps[0]) | wrap(wraps[1]) << 2, levels, width, height, row]);
        }
        words
    });
    let mut buffer = Growing::new(device, INPUT);
    buffer.put(device, &words.collect::<Vec<u32>>());
    buffer
}
