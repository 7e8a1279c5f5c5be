//! Displacements of seams on a device; twin of [`seam_displacement`](crate::encode::cost::seam_displacement).
//!
//! The simplification does not use it: few edges touch seams, and reading their patches, which the processor does, takes longer than
//! measuring them. It is here for patches that are read already, and so that the twins stay comparable.

use super::buffers::{Growing, INPUT, Results, UNIFORM};
use super::device::Device;
use super::error::DeviceError;
use super::shader::Kernel;
use crate::encode::cost::SeamPatch;

/// The displacement of each patch, in lattice steps. Everything is uploaded at once.
///
/// # Errors
/// [`DeviceError`]; among them [`DeviceError::TooSmall`] when an array exceeds what a kernel sees.
pub fn seam_displacements(device: &Device, patches: &[SeamPatch]) -> Result<Vec<f32>, DeviceError> {
    if patches.is_empty() {
        return Ok(Vec::new());
    }
    let (mut heads, mut start, mut points) = (Vec::new(), vec![0u32], Vec::new());
    for p in patches {
        heads.extend(p.half.map(f32::to_bits));
        heads.push(u32::from(p.torn) | u32::from(p.on_seam) << 1);
        points.extend(p.ring.iter().flatten().map(|c| c.to_bits()));
        start.push((points.len() / 3) as u32);
    }
    let largest = heads.len().max(points.len()).max(start.len()) as u64 * 4;
    let limit = device.info.binding_bytes.min(device.budget() / 4);
    if largest > limit {
        let device = device.info.name.clone();
        return Err(DeviceError::TooSmall { device, what: "the size of a bound buffer", has: limit, needs: largest });
    }
    let kernel = Kernel::new(device, "seam_displacement", 3)?;
    let mut params = Growing::new(device, UNIFORM);
    params.put(device, &[patches.len() as u32, 0, 0, 0]);
    let mut inputs: [Growing; 3] = std::array::from_fn(|_| Growing::new(device, INPUT));
    inputs[0].put(device, &heads);
    inputs[1].put(device, &start);
    inputs[2].put(device, &points);
    let mut bindings = vec![params.binding(0)];
    bindings.extend((1..).zip(&inputs).map(|(i, b)| b.binding(i)));
    let mut results = Results::new(device);
    results.dispatch(device, &kernel, &bindings, patches.len(), 2)?;
    Ok(results.wait(device)?.into_iter().map(|[d, _]| f32::from_bits(d)).collect())
}
