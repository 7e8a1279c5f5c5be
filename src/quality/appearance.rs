//! How alike two meshes look: pictures from all sides, compared pair by pair (Caillaud et al. 2016, section 6, after Lavoué et al. 2016).
//!
//! Forty-two cameras stand on the corners of an icosahedron and the middles of its edges (one dyadic split), look at the middle of the first
//! mesh's bounding box in perspective and see the sphere around it. The score is the mean MS-SSIM of the pairs of pictures.

use super::ssim::{MIN_SIDE, SsimError, ms_ssim};
use crate::mesh::Mesh;
use crate::parallel;
use crate::quality::picture::{Picture, Scene, Shading, View, draw};

/// Cameras, at most.
pub const MAX_VIEWS: usize = 42;

/// The field of view in degrees.
const FIELD: f64 = 30.0;

/// How meshes are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewOptions {
    /// Cameras, 1 to [`MAX_VIEWS`]: the corners first, then the middles of edges.
    pub views: usize,
    /// Pixels of a picture's side, at least [`MIN_SIDE`].
    pub size: u32,
    /// How faces are shaded.
    pub shading: Shading,
}

impl Default for ViewOptions {
    fn default() -> Self {
        ViewOptions { views: MAX_VIEWS, size: 512, shading: Shading::Smooth }
    }
}

/// How alike two meshes look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Appearance {
    /// The mean MS-SSIM, 1 for equal pictures.
    pub ms_ssim: f64,
    /// Each camera's.
    pub views: Vec<f64>,
}

/// Where the cameras stand, as directions from the middle: the corners of an icosahedron, then the middles of its edges.
pub fn directions() -> Vec<[f64; 3]> {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let mut all: Vec<[f64; 3]> = Vec::with_capacity(MAX_VIEWS);
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        all.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    for i in 0..12 {
        for j in i + 1..12 {
            let d: [f64; 3] = std::array::from_fn(|k| all[i][k] - all[j][k]);
            // The edges have length 2.
            if d.iter().map(|c| c * c).sum::<f64>() < 5.0 {
                all.push(std::array::from_fn(|k| 0.5 * (all[i][k] + all[j][k])));
            }
        }
    }
    all.iter().map(|d| d.map(|c| c / d.iter().map(|c| c * c).sum::<f64>().sqrt())).collect()
}

/// Pictures of the mesh that others are compared with.
pub struct Snapshots {
    views: Vec<View>,
    pictures: Vec<Picture>,
    options: ViewOptions,
    warnings: Vec<String>,
}

impl Snapshots {
    /// Draw a valid mesh from all cameras.
    ///
    /// # Errors
    /// [`SsimError::Small`] where pictures of that size cannot be compared.
    pub fn new(mesh: &Mesh, options: &ViewOptions) -> Result<Self, SsimError> {
        let scene = Scene::new(mesh, options.shading);
        Snapshots::of(&scene, mesh, options)
    }

    /// The same of a scene that was made of the mesh before.
    ///
    /// # Errors
    /// As [`Snapshots::new`].
    pub fn of(scene: &Scene, mesh: &Mesh, options: &ViewOptions) -> Result<Self, SsimError> {
        if options.size < MIN_SIDE {
            return Err(SsimError::Small(options.size, options.size));
        }
        let count = options.views.clamp(1, MAX_VIEWS);
        let views: Vec<View> =
            directions()[..count].iter().map(|&d| View::around(mesh, d).perspective(FIELD)).collect();
        let pictures = parallel::map(views.iter().collect(), |view| draw(scene, view, options.size, options.size));
        Ok(Snapshots { warnings: scene.warnings().to_vec(), views, pictures, options: *options })
    }

    /// The pictures, camera by camera.
    pub fn pictures(&self) -> &[Picture] {
        &self.pictures
    }

    /// What could not be drawn as the mesh says, one line each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Draw another valid mesh from the same cameras and compare.
    ///
    /// # Errors
    /// None that a snapshot of a sufficient size leaves.
    pub fn compare(&self, mesh: &Mesh) -> Result<Appearance, SsimError> {
        self.compare_scene(&Scene::new(mesh, self.options.shading))
    }

    /// The same of a scene that was made of the other mesh before.
    ///
    /// # Errors
    /// As [`Snapshots::compare`].
    pub fn compare_scene(&self, scene: &Scene) -> Result<Appearance, SsimError> {
        let size = self.options.size;
        let pairs = self.views.iter().zip(&self.pictures).collect();
        let scores: Vec<_> = parallel::map(pairs, |(view, own)| ms_ssim(own, &draw(scene, view, size, size)));
        let views: Vec<f64> = scores.into_iter().collect::<Result<_, _>>()?;
        Ok(Appearance { ms_ssim: views.iter().sum::<f64>() / views.len().max(1) as f64, views })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn forty_two_directions_all_around() {
        let all = directions();
        assert_eq!(all.len(), MAX_VIEWS);
        for k in 0..3 {
            assert!(all.iter().map(|d| d[k]).sum::<f64>().abs() < 1e-9);
            assert!((all.iter().map(|d| d[k] * d[k]).sum::<f64>() - 14.0).abs() < 1e-9);
        }
        for (i, a) in all.iter().enumerate() {
            let nearest = all[..i].iter().map(|b| (0..3).map(|k| a[k] * b[k]).sum::<f64>()).fold(-1.0, f64::max);
            assert!(nearest < 0.86, "directions {i} and another are less than 30 degrees apart");
        }
    }

    #[test]
    fn coarser_is_less_alike() {
        let fine = samples::asteroid(16, 4);
        let options = ViewOptions { views: 6, size: 176, shading: Shading::Smooth };
        let snapshots = Snapshots::new(&fine, &options).unwrap();
        assert_eq!(snapshots.compare(&fine).unwrap().ms_ssim, 1.0);
        let scores = [12, 6, 2].map(|n| snapshots.compare(&samples::asteroid(n, 4)).unwrap().ms_ssim);
        assert!(scores[0] < 1.0 && scores[0] > scores[1] && scores[1] > scores[2] && scores[2] > 0.2, "{scores:?}");
        assert!(Snapshots::new(&fine, &ViewOptions { size: 100, ..options }).is_err());
    }
}
