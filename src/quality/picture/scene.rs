//! A mesh as triangles that can be drawn: corners with normals, colours and texture coordinates, materials with decoded images.
//!
//! A polygon of more than three corners is drawn as the triangles between its edges and the mean of its corners, as it is measured.

use super::Shading;
use super::material::Material;
use super::texture::{self, Texture, to_linear};
use super::textures::Textures;
use super::vector::unit;
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE, Stored};
use glam::DVec3;

/// No normal, colour or texture coordinate of one's own.
pub(super) const NONE: u32 = u32::MAX;

/// Isolated vertices and dangling edges without a colour, in linear light.
pub(super) const LOOSE: [f32; 3] = [0.83, 0.4, 0.06];

/// A mesh, ready to be drawn from any side.
pub struct Scene {
    pub(super) points: Vec<[f64; 3]>,
    pub(super) triangles: Vec<Triangle>,
    pub(super) normals: Vec<[f32; 3]>,
    /// Linear light, and alpha.
    pub(super) colours: Vec<[f32; 4]>,
    /// v downwards.
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) materials: Vec<Paint>,
    /// Dangling edges.
    pub(super) dangling: Vec<[u32; 2]>,
    /// Edges of faces, for [`Shading::Wire`] only.
    pub(super) wires: Vec<[u32; 2]>,
    /// Isolated vertices and their colours.
    pub(super) isolated: Vec<(u32, [f32; 3])>,
    warnings: Vec<String>,
}

/// A triangle: numbers into the scene's lists.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    pub(super) points: [u32; 3],
    pub(super) normals: [u32; 3],
    pub(super) colours: [u32; 3],
    pub(super) uvs: [u32; 3],
    pub(super) material: u32,
}

/// The values at the corners of a triangle, before anything is seen of it.
pub(super) struct Surface {
    pub(super) normals: [[f32; 3]; 3],
    pub(super) colours: Option<[[f32; 4]; 3]>,
    pub(super) uvs: Option<[[f32; 2]; 3]>,
    /// Texels of the full image in twice the triangle; 0 without one.
    pub(super) texels: f64,
}

/// What a face is painted with.
pub(super) struct Paint {
    pub(super) factor: [f32; 4],
    pub(super) cutoff: Option<f32>,
    pub(super) texture: Option<(usize, [texture::Wrap; 2])>,
    /// From texture coordinates to the image, where that is not the identity.
    pub(super) transform: Option<[[f32; 2]; 3]>,
    /// The image's texels in the unit square of texture coordinates.
    pub(super) texels: f64,
    pub(super) images: Textures,
    /// Without a material or colours: back faces show by their tint.
    pub(super) plain: bool,
}

impl Scene {
    /// Prepare a valid mesh ([`Mesh::validate`]). With [`Shading::Smooth`] normals of the file are used where there are some.
    pub fn new(mesh: &Mesh, shading: Shading) -> Self {
        Scene::with_textures(mesh, shading, &Textures::new(&mesh.appearance))
    }

    /// The same with images that are decoded already.
    pub fn with_textures(mesh: &Mesh, shading: Shading, textures: &Textures) -> Self {
        let mut scene = Builder::new(mesh, shading, textures).run();
        scene.collect_lines(mesh, shading);
        scene
    }

    /// Paint with other images, the mesh being the same.
    pub fn repaint(&mut self, mesh: &Mesh, textures: &Textures) {
        let coloured = self.materials.first().is_some_and(|bare| !bare.plain);
        self.materials = materials(mesh, coloured, textures).0;
        self.warnings = textures.warnings().to_vec();
    }

    /// What could not be drawn as the mesh says, one line each: images that are missing or in other formats.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// The values at the corners of a triangle.
    pub(super) fn surface(&self, triangle: &Triangle) -> Surface {
        let paint = &self.materials[triangle.material as usize];
        let normals = if triangle.normals[0] == NONE {
            let [a, b, c] = triangle.points.map(|p| DVec3::from(self.points[p as usize]));
            [unit((b - a).cross(c - a)).as_vec3().to_array(); 3]
        } else {
            triangle.normals.map(|n| self.normals[n as usize])
        };
        let colours = (triangle.colours[0] != NONE).then(|| triangle.colours.map(|c| self.colours[c as usize]));
        let mut uvs = (triangle.uvs[0] != NONE).then(|| triangle.uvs.map(|t| self.uvs[t as usize]));
        if let (Some(uvs), Some([u, v, offset])) = (&mut uvs, paint.transform) {
            *uvs = uvs.map(|t| std::array::from_fn(|k| u[k] * t[0] + v[k] * t[1] + offset[k]));
        }
        let texels = uvs.filter(|_| paint.texels > 0.0).map_or(0.0, |[a, b, c]| {
            // The transformation is in the coordinates already.
            let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
            f64::from(area) * paint.texels
        });
        Surface { normals, colours, uvs, texels }
    }

    fn collect_lines(&mut self, mesh: &Mesh, shading: Shading) {
        let mut used = vec![false; mesh.positions.len()];
        mesh.corners.iter().for_each(|&v| used[v as usize] = true);
        // Of a colour that shows on the background and on faces, where they have none of their own.
        self.isolated = (0..used.len() as u32).filter(|&v| !used[v as usize]).map(|v| (v, LOOSE)).collect();
        let colours = mesh.layers.iter().find(|l| l.kind == LayerKind::Color && l.width >= 3);
        for &[v, value] in colours.map_or(&[][..], |l| &l.isolated) {
            let place = self.isolated.binary_search_by_key(&v, |&(v, _)| v);
            if let (Ok(i), Some(c)) = (place, self.colours.get(value as usize)) {
                self.isolated[i].1 = [c[0], c[1], c[2]];
            }
        }
        for face in mesh.faces() {
            if let [a, b] = *face {
                self.dangling.push([a, b]);
            } else if shading == Shading::Wire {
                self.wires.extend((0..face.len()).map(|i| [face[i], face[(i + 1) % face.len()]]));
            }
        }
    }
}

/// The layers that are drawn, and the scene as far as it is.
struct Builder<'a> {
    mesh: &'a Mesh,
    normal: Option<&'a Layer>,
    colour: Option<&'a Layer>,
    uvs: Vec<&'a Layer>,
    /// Where the values of each layer of texture coordinates begin.
    uv_start: Vec<u32>,
    /// For each material the layer of its texture.
    uv_layers: Vec<Option<usize>>,
    smooth: bool,
    scene: Scene,
}

impl<'a> Builder<'a> {
    fn new(mesh: &'a Mesh, shading: Shading, textures: &Textures) -> Self {
        let of = |kind: LayerKind, width: std::ops::RangeInclusive<u8>| {
            mesh.layers.iter().filter(move |l| l.kind == kind && width.contains(&l.width))
        };
        let smooth = shading == Shading::Smooth;
        let normal = of(LayerKind::Normal, 3..=3).next().filter(|_| smooth);
        let colour = of(LayerKind::Color, 3..=4).next();
        let uvs: Vec<&Layer> = of(LayerKind::Uv, 2..=4).collect();
        let (materials, uv_layers) = materials(mesh, colour.is_some(), textures);
        // Colours of scans are sRGB as images are; glTF's, which come with materials, are linear.
        let coded = mesh.appearance.materials.is_empty()
            || colour.is_some_and(|l| l.stored == Stored::U8 && mesh.material.is_empty());
        let colours = colour.map_or_else(Vec::new, |layer| {
            let linear = |c: f64| if coded { to_linear(c.clamp(0.0, 1.0) as f32) } else { c.clamp(0.0, 1.0) as f32 };
            let value = |i: u32| {
                let v = layer.value(i);
                [linear(v[0]), linear(v[1]), linear(v[2]), v.get(3).map_or(1.0, |a| a.clamp(0.0, 1.0) as f32)]
            };
            (0..layer.len() as u32).map(value).collect()
        });
        let mut uv_start = Vec::new();
        let mut uv_values = Vec::new();
        for layer in &uvs {
            uv_start.push(uv_values.len() as u32);
            let value = |i: u32| [layer.value(i)[0] as f32, (1.0 - layer.value(i)[1]) as f32];
            uv_values.extend((0..layer.len() as u32).map(value));
        }
        let normals = normal.map_or_else(Vec::new, |layer| {
            (0..layer.len() as u32).map(|i| [0, 1, 2].map(|k| layer.value(i)[k] as f32)).collect()
        });
        let scene = Scene {
            points: mesh.positions.clone(),
            triangles: Vec::with_capacity(mesh.face_count()),
            normals,
            colours,
            uvs: uv_values,
            materials,
            dangling: Vec::new(),
            wires: Vec::new(),
            isolated: Vec::new(),
            warnings: textures.warnings().to_vec(),
        };
        Builder { mesh, normal, colour, uvs, uv_start, uv_layers, smooth, scene }
    }

    fn run(mut self) -> Scene {
        // Where normals of vertices begin, when there are none in the file.
        let computed = self.scene.normals.len() as u32;
        let face_normals: Vec<DVec3> = self.mesh.faces().map(|face| self.newell(face)).collect();
        if self.smooth && self.normal.is_none() {
            let mut sums = vec![DVec3::ZERO; self.mesh.positions.len()];
            for (face, &n) in self.mesh.faces().zip(&face_normals) {
                face.iter().for_each(|&v| sums[v as usize] += n);
            }
            self.scene.normals.extend(sums.into_iter().map(|n| unit(n).as_vec3().to_array()));
        }
        for (f, &face_normal) in face_normals.iter().enumerate() {
            let face = self.mesh.face(f);
            if face.len() < 3 {
                continue;
            }
            let first = self.mesh.face_start[f] as usize;
            let own = self.mesh.material.get(f).copied().filter(|&m| m != NO_VALUE);
            // Number 0 is what faces without a material have.
            let material = own.map_or(0, |m| m + 1);
            let layer = own.and_then(|m| self.uv_layers[m as usize]).filter(|&l| l < self.uvs.len());
            let flat = if self.smooth && self.normal.is_none() {
                NONE
            } else {
                self.scene.normals.push(unit(face_normal).as_vec3().to_array());
                self.scene.normals.len() as u32 - 1
            };
            let corner = |i: usize| {
                let at = first + i;
                let value = |layer: &Layer| layer.corners.get(at).copied().filter(|&v| v != NO_VALUE);
                Corner {
                    point: face[i],
                    normal: match self.normal {
                        Some(layer) => value(layer).unwrap_or(flat),
                        None if self.smooth => computed + face[i],
                        None => flat,
                    },
                    colour: self.colour.and_then(value).unwrap_or(NONE),
                    uv: layer.and_then(|l| Some(value(self.uvs[l])? + self.uv_start[l])).unwrap_or(NONE),
                }
            };
            let corners: Vec<Corner> = (0..face.len()).map(corner).collect();
            if let [a, b, c] = corners[..] {
                self.push([a, b, c], material);
                continue;
            }
            let middle = self.middle(&corners);
            for i in 0..corners.len() {
                self.push([corners[i], corners[(i + 1) % corners.len()], middle], material);
            }
        }
        self.scene
    }

    fn push(&mut self, corners: [Corner; 3], material: u32) {
        let numbers = |f: fn(&Corner) -> u32| {
            let all = corners.each_ref().map(f);
            if all.contains(&NONE) { [NONE; 3] } else { all }
        };
        self.scene.triangles.push(Triangle {
            points: numbers(|c| c.point),
            normals: numbers(|c| c.normal),
            colours: numbers(|c| c.colour),
            uvs: numbers(|c| c.uv),
            material,
        });
    }

    /// A corner in the middle of a polygon.
    fn middle(&mut self, corners: &[Corner]) -> Corner {
        let mean = |values: Vec<Vec<f64>>| -> Vec<f64> {
            let n = values.len() as f64;
            (0..values[0].len()).map(|k| values.iter().map(|v| v[k]).sum::<f64>() / n).collect()
        };
        fn wide<const N: usize>(v: [f32; N]) -> Vec<f64> {
            v.iter().map(|&c| f64::from(c)).collect()
        }
        let all = |f: fn(&Corner) -> u32| -> Option<Vec<usize>> {
            corners.iter().map(|c| (f(c) != NONE).then(|| f(c) as usize)).collect()
        };
        let scene = &mut self.scene;
        let mut middle = Corner { point: scene.points.len() as u32, normal: NONE, colour: NONE, uv: NONE };
        let p = mean(corners.iter().map(|c| scene.points[c.point as usize].to_vec()).collect());
        scene.points.push([p[0], p[1], p[2]]);
        if let Some(all) = all(|c| c.normal) {
            let n = mean(all.iter().map(|&i| wide(scene.normals[i])).collect());
            middle.normal = scene.normals.len() as u32;
            scene.normals.push(unit(DVec3::new(n[0], n[1], n[2])).as_vec3().to_array());
        }
        if let Some(all) = all(|c| c.colour) {
            let c = mean(all.iter().map(|&i| wide(scene.colours[i])).collect());
            middle.colour = scene.colours.len() as u32;
            scene.colours.push([0, 1, 2, 3].map(|k| c[k] as f32));
        }
        if let Some(all) = all(|c| c.uv) {
            let t = mean(all.iter().map(|&i| wide(scene.uvs[i])).collect());
            middle.uv = scene.uvs.len() as u32;
            scene.uvs.push([t[0] as f32, t[1] as f32]);
        }
        middle
    }

    /// Twice the area vector of a polygon.
    fn newell(&self, face: &[u32]) -> DVec3 {
        let p = |i: usize| DVec3::from(self.mesh.positions[face[i] as usize]);
        (1..face.len().saturating_sub(1)).map(|i| (p(i) - p(0)).cross(p(i + 1) - p(0))).sum()
    }
}

#[derive(Clone, Copy)]
struct Corner {
    point: u32,
    normal: u32,
    colour: u32,
    uv: u32,
}

/// What faces are painted with (first those without a material), and the layer of each material's texture.
fn materials(mesh: &Mesh, coloured: bool, textures: &Textures) -> (Vec<Paint>, Vec<Option<usize>>) {
    let appearance = &mesh.appearance;
    let materials: Vec<Material> = (0..appearance.materials.len()).map(|i| Material::new(appearance, i)).collect();
    let bare = Paint {
        factor: [1.0; 4],
        cutoff: None,
        texture: None,
        transform: None,
        texels: 0.0,
        images: textures.clone(),
        plain: !coloured,
    };
    let layers = materials.iter().map(|m| m.texture.as_ref().map(|t| t.layer)).collect();
    let paint = |m: Material| {
        let texture = m.texture.filter(|t| textures.get(t.image).is_some());
        let texels = texture.as_ref().and_then(|t| textures.get(t.image)).map_or(0.0, Texture::texels);
        Paint {
            factor: m.factor,
            cutoff: m.cutoff,
            texels,
            transform: texture.as_ref().and_then(|t| t.transform),
            texture: texture.map(|t| (t.image, t.wrap)),
            images: textures.clone(),
            plain: false,
        }
    };
    (std::iter::once(bare).chain(materials.into_iter().map(paint)).collect(), layers)
}

impl Paint {
    /// The decoded image and what lies beyond its edges.
    pub(super) fn texture(&self) -> Option<(&Texture, [texture::Wrap; 2])> {
        let (image, wrap) = self.texture?;
        Some((self.images.get(image)?, wrap))
    }
}
