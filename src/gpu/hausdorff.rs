//! Distances of points to their candidate triangles: the inner loop of a Hausdorff estimate between two meshes. The
//! caller chooses candidates (from a grid or tree); this finds the nearest of them, on a device or on the processor.

use rayon::prelude::*;

use super::buffers::{Growing, INPUT, Results, UNIFORM};
use super::device::Device;
use super::error::DeviceError;
use super::shader::Kernel;
use crate::encode::cost::triangle_distance2;

/// Points, triangles, and which triangles each point is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Distances<'a> {
    /// The points.
    pub points: &'a [[f32; 3]],
    /// Point `i` looks at `candidates[start[i] .. start[i + 1]]`.
    pub start: &'a [u32],
    /// Numbers of triangles.
    pub candidates: &'a [u32],
    /// Corners of each triangle.
    pub triangles: &'a [[[f32; 3]; 3]],
}

impl Distances<'_> {
    /// For each point the squared distance to the nearest of its triangles, and which that is (of equals the first); `(f32::INFINITY,
    /// u32::MAX)` for a point without any. All threads of the current pool.
    pub fn on_cpu(&self) -> Vec<(f32, u32)> {
        self.points
            .par_iter()
            .zip(self.start.par_windows(2))
            .with_min_len(64)
            .map(|(&x, range)| {
                let mut best = (f32::INFINITY, u32::MAX);
                for &t in self.candidates.get(range[0] as usize..range[1] as usize).unwrap_or(&[]) {
                    let Some(&[c, p, q]) = self.triangles.get(t as usize) else { continue };
                    let d = triangle_distance2(x, c, p, q);
                    if d < best.0 {
                        best = (d, t);
                    }
                }
                best
            })
            .collect()
    }
}

/// The same on a device. Everything is uploaded at once.
///
/// # Errors
/// [`DeviceError`]; among them [`DeviceError::TooSmall`] when an array exceeds what a kernel sees.
pub fn distances(device: &Device, input: &Distances) -> Result<Vec<(f32, u32)>, DeviceError> {
    let bytes =
        [input.points.len() * 12, input.start.len() * 4, input.candidates.len() * 4, input.triangles.len() * 36];
    let largest = bytes.into_iter().max().unwrap_or(0) as u64;
    let limit = device.info.binding_bytes.min(device.budget() / 4);
    if largest > limit {
        let device = device.info.name.clone();
        return Err(DeviceError::TooSmall { device, what: "the size of a bound buffer", has: limit, needs: largest });
    }
    if input.points.is_empty() {
        return Ok(Vec::new());
    }
    let kernel = Kernel::new(device, "hausdorff", 4)?;
    let mut params = Growing::new(device, UNIFORM);
    params.put(device, &[input.points.len() as u32, 0, 0, 0]);
    let mut inputs: [Growing; 4] = std::array::from_fn(|_| Growing::new(device, INPUT));
    inputs[0].put(device, bytemuck::cast_slice(input.points));
    inputs[1].put(device, input.start);
    inputs[2].put(device, input.candidates);
    inputs[3].put(device, bytemuck::cast_slice(input.triangles));
    let mut bindings = vec![params.binding(0)];
    bindings.extend((1..).zip(&inputs).map(|(i, b)| b.binding(i)));
    let mut results = Results::new(device);
    results.dispatch(device, &kernel, &bindings, input.points.len(), 2)?;
    let nearest = results.wait(device)?;
    Ok(nearest
        .into_iter()
        .map(|[d, t]| if t == u32::MAX { (f32::INFINITY, t) } else { (f32::from_bits(d), t) })
        .collect())
}
