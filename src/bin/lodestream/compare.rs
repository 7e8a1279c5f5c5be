//! `lodestream compare`: how far two models are from each other, and how alike they look.

use crate::Outcome;
use crate::decode::Choice;
use crate::model;
use crate::output::{Output, Outputs};
use crate::progress::Bars;
use crate::render::Look;
use crate::shared::{self, Machine};
use anyhow::{Result, bail};
use clap::ValueEnum;
use lodestream::mesh::{Layer, LayerKind, Mesh, Stored};
use lodestream::quality::picture::{Picture, Scene, Shading, View, draw};
use lodestream::quality::{self, Directed, Geometry, SampleOptions, Sampled, Snapshots, ViewOptions, Weights};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream compare scan.ply scan.lods
  lodestream compare scan.ply scan.lods --level 40 --heatmap distances.ply
  lodestream compare a.obj b.obj --samples 1000000 --weigh samples --json

Distances are sampled: at vertices, along edges and on faces of one model, each to the nearest point of the other, in both
directions. A level is one of B. Pictures from 42 sides are compared by MS-SSIM: 1 means that they are equal.")]
pub struct Args {
    /// The reference: a mesh or a .lods file
    #[arg(value_name = "A")]
    a: PathBuf,
    /// What is compared with it: a mesh or a .lods file
    #[arg(value_name = "B")]
    b: PathBuf,
    #[command(flatten)]
    choice: Choice,
    #[command(flatten)]
    sampling: Sampling,
    #[command(flatten)]
    looks: Looks,
    /// Write A with its distances to B as colours: .ply, or a picture of it as .png
    #[arg(long, value_name = "OUT")]
    heatmap: Option<PathBuf>,
    #[command(flatten)]
    machine: Machine,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// How distances are sampled.
#[derive(clap::Args)]
pub struct Sampling {
    /// Samples on faces, as many along edges, and at most as many vertices, in each direction
    #[arg(long, value_name = "N", default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(1..))]
    samples: u32,
    /// What mean and root mean square are taken over
    #[arg(long, value_name = "HOW", value_enum, default_value = "area")]
    weigh: Weigh,
}

/// How pictures are compared.
#[derive(clap::Args)]
pub struct Looks {
    /// Pictures to compare, from as many sides; 0 compares none
    #[arg(long, value_name = "N", default_value_t = 42, value_parser = clap::value_parser!(u8).range(0..=42))]
    pub views: u8,
    /// Pixels of a picture's side
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(161..=4096))]
    pub size: u32,
    /// How faces are shaded in them
    #[arg(long, value_enum, default_value = "smooth")]
    shading: Look,
}

impl Looks {
    pub fn options(&self) -> ViewOptions {
        ViewOptions { views: usize::from(self.views), size: self.size, shading: self.shading.shading() }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Weigh {
    /// Over the surface: samples on faces count, as in METRO
    Area,
    /// Over all samples alike: vertices, edges and faces, as in PyMeshLab
    Samples,
}

impl Sampling {
    pub fn options(&self) -> SampleOptions {
        let weights = match self.weigh {
            Weigh::Area => Weights::Area,
            Weigh::Samples => Weights::Samples,
        };
        SampleOptions { samples: self.samples as usize, weights }
    }
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    let mut outputs = Outputs::of([(args.a.as_path(), None), (args.b.as_path(), None)]);
    let heatmap = args.heatmap.as_deref().map(|path| Heatmap::new(path, &mut outputs)).transpose()?;
    args.machine.run(|threads| {
        let bars = Bars::new(!args.json);
        let a = model::load(&args.a, &Choice::default(), &args.machine, &bars)?;
        let b = model::load(&args.b, &args.choice, &args.machine, &bars)?;
        for (path, model) in [(&args.a, &a), (&args.b, &b)] {
            if model.mesh.vertex_count() == 0 {
                bail!("{}: there is nothing to compare: it has no vertices", path.display());
            }
        }
        let read = shared::seconds(start);
        let clock = Instant::now();
        let options = args.sampling.options();
        let (sampled_a, sampled_b) = rayon::join(|| Sampled::new(&a.mesh), || Sampled::new(&b.mesh));
        let prepare = shared::seconds(clock);
        let clock = Instant::now();
        let geometry = quality::geometry_of(&sampled_a, &sampled_b, &options);
        let distances = shared::seconds(clock);
        let texture = quality::uv_error(&sampled_a, &sampled_b, 0, options.samples);
        let stretch = [&sampled_a, &sampled_b].map(|m| quality::stretch(m, 0));
        let clock = Instant::now();
        let appearance = if args.looks.views > 0 {
            let looks = Snapshots::new(&a.mesh, &args.looks.options())?;
            looks.warnings().iter().for_each(|w| shared::warn(format!("{}: {w}", args.a.display())));
            Some(looks.compare(&b.mesh)?)
        } else {
            None
        };
        let pictures = shared::seconds(clock);
        if let Some(heatmap) = heatmap {
            heatmap.write(&sampled_a, &sampled_b, &geometry)?;
        }
        let total = shared::seconds(start);
        if args.json {
            let model = |path: &Path, model: &model::Model| {
                json!({
                    "name": shared::name(path),
                    "level": model.level,
                    "vertices": model.mesh.vertex_count(),
                    "faces": model.mesh.face_count(),
                })
            };
            shared::print_json(&json!({
                "a": model(&args.a, &a),
                "b": model(&args.b, &b),
                "geometry": geometry_json(&geometry, &options),
                "appearance": appearance.as_ref().map(|look| json!({
                    "ms_ssim": look.ms_ssim,
                    "views": look.views,
                    "size": args.looks.size,
                })),
                "texture_coordinates": texture.map(|error| json!({
                    "rms": error.rms,
                    "rms_99": error.rms_99,
                    "max": error.max,
                    "samples": error.samples,
                    "stretch": stretch.map(|s| s.map(|s| json!({ "l2": s.l2, "max": s.max, "flat": s.flat }))),
                })),
                "seconds": { "read": read, "prepare": prepare, "distances": distances, "pictures": pictures, "total": total, "cpu": shared::cpu_seconds() },
                "peak_memory_bytes": shared::peak_memory(),
                "threads": threads,
            }))?;
        } else {
            let model = |model: &model::Model| {
                format!(
                    "{} vertices, {} faces{}",
                    shared::thousands(model.mesh.vertex_count() as u64),
                    shared::thousands(model.mesh.face_count() as u64),
                    model.level.map_or(String::new(), |level| format!(", level {level}"))
                )
            };
            let mut rows = vec![
                ("A", model(&a)),
                ("B", model(&b)),
                ("diagonal", format!("{:.6} (of A's bounding box)", geometry.diagonal)),
                ("A to B", line(&geometry.forward, geometry.diagonal)),
                ("B to A", line(&geometry.backward, geometry.diagonal)),
            ];
            if let Some(error) = texture {
                let stretch = stretch.map(|s| s.map_or("none".into(), |s| format!("{:.3}", s.l2)));
                let text = format!("rms {:.6}, max {:.6}; stretch {} and {}", error.rms, error.max, stretch[0], stretch[1]);
                rows.push(("textures", text));
            }
            if let Some(look) = &appearance {
                let (least, views) = (look.views.iter().copied().fold(1.0, f64::min), look.views.len());
                rows.push(("MS-SSIM", format!("{:.5} (least {least:.5}, {views} views of {} pixels)", look.ms_ssim, args.looks.size)));
            }
            let parts = format!("read {read:.2}, distances {:.2}, pictures {pictures:.2}", prepare + distances);
            rows.push(("seconds", format!("{total:.2} ({parts})")));
            shared::print(&shared::table(&rows))?;
        }
        Ok(Outcome::Done)
    })
}

fn line(d: &Directed, diagonal: f64) -> String {
    let relative =
        |x: f64| if diagonal > 0.0 { format!(" ({:.3e} of the diagonal)", x / diagonal) } else { String::new() };
    format!("mean {:.6}{}, rms {:.6}, max {:.6}{}", d.mean, relative(d.mean), d.rms, d.max, relative(d.max))
}

/// What `--json` says about distances.
pub fn geometry_json(geometry: &Geometry, options: &SampleOptions) -> Value {
    let relative = |x: f64| if geometry.diagonal > 0.0 { Some(x / geometry.diagonal) } else { None };
    let directed = |d: &Directed| {
        json!({
            "mean": d.mean,
            "rms": d.rms,
            "max": d.max,
            "relative": { "mean": relative(d.mean), "rms": relative(d.rms), "max": relative(d.max) },
            "farthest": d.farthest,
            "samples": { "vertices": d.vertices, "edges": d.edges, "faces": d.faces },
        })
    };
    json!({
        "forward": directed(&geometry.forward),
        "backward": directed(&geometry.backward),
        "diagonal": geometry.diagonal,
        "sampling": {
            "samples": options.samples,
            "weights": match options.weights { Weights::Area => "area", Weights::Samples => "samples" },
            "faces": "equal steps of area, R2 sequence inside a face",
            "edges": "equal steps of length",
            "vertices": "all, or evenly chosen",
        },
    })
}

/// Where the distances go as colours.
struct Heatmap {
    output: Output,
    picture: bool,
}

impl Heatmap {
    fn new(path: &Path, outputs: &mut Outputs) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        if !["ply", "png"].contains(&extension.as_str()) {
            bail!("{}: a heatmap is a .ply file or a .png picture", path.display());
        }
        Ok(Heatmap { output: outputs.create(path)?, picture: extension == "png" })
    }

    fn write(self, a: &Sampled<'_>, b: &Sampled<'_>, geometry: &Geometry) -> Result<()> {
        let distances = a.vertex_distances(&b.surface);
        let most = distances.iter().copied().fold(0.0, f64::max);
        if self.picture {
            let picture = heat_picture(a.mesh(), &distances, most, geometry.diagonal);
            self.output.write(|out| picture.write_png(out))?;
        } else {
            self.output.write(|out| quality::heat::write_ply(out, a.mesh(), &distances, most))?;
        }
        self.output.commit()
    }
}

/// Two sides of a mesh in the colours of its distances, and what the colours mean.
fn heat_picture(mesh: &Mesh, distances: &[f64], most: f64, diagonal: f64) -> Picture {
    const SIDE: u32 = 640;
    const INK: [u8; 3] = [222, 226, 233];
    let colour = |d: &f64| quality::heat::colour(if most > 0.0 { d / most } else { 0.0 });
    let values = distances.iter().flat_map(colour).map(|c| f64::from(c) / 255.0).collect();
    let mut coloured = Mesh {
        positions: mesh.positions.clone(),
        face_start: mesh.face_start.clone(),
        corners: mesh.corners.clone(),
        ..Mesh::default()
    };
    let count = mesh.positions.len();
    let layer = Layer::per_vertex("color", LayerKind::Color, 3, Stored::U8, values, &mesh.corners, count);
    coloured.layers.push(layer);
    let scene = Scene::new(&coloured, Shading::Smooth);
    let mut sheet = Picture::new(2 * SIDE, SIDE + 48, [24, 26, 31]);
    for (x, yaw) in [(0, -0.45), (SIDE, -0.45 + std::f64::consts::PI)] {
        sheet.paste(&draw(&scene, &View::from_angles(mesh, yaw, 0.35), SIDE, SIDE), x, 0);
    }
    for x in 0..256u32 {
        let bar = Picture::new(1, 16, quality::heat::colour(f64::from(x) / 255.0));
        sheet.paste(&bar, 16 + x, SIDE + 16);
    }
    let relative = if diagonal > 0.0 { 100.0 * most / diagonal } else { 0.0 };
    sheet.text(
        288,
        SIDE + 16,
        2,
        INK,
        &format!("distance of a vertex: 0 to {most:.6}, {relative:.4} % of the diagonal"),
    );
    sheet
}
