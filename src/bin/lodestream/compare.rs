//! `lodestream compare`: how far two models are from each other, and how alike they look.

use crate::Outcome;
use crate::model;
use crate::output::Output;
use crate::progress::Bars;
use crate::shared::{self, Machine};
use anyhow::{Result, bail};
use clap::ValueEnum;
use lodestream::quality::{self, Directed, Geometry, SampleOptions, Sampled, Weights};
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
directions. Pictures from 42 sides are compared by MS-SSIM: 1 means that they are equal.")]
pub struct Args {
    /// The reference: a mesh or a .lods file
    #[arg(value_name = "A")]
    a: PathBuf,
    /// What is compared with it: a mesh or a .lods file
    #[arg(value_name = "B")]
    b: PathBuf,
    /// The level of B, where that is a .lods file [default: the full one]
    #[arg(long, value_name = "N")]
    level: Option<u32>,
    #[command(flatten)]
    sampling: Sampling,
    /// Write A with its distances to B as colours: .ply
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
    let heatmap = args.heatmap.as_deref().map(Heatmap::new).transpose()?;
    args.machine.run(|threads| {
        let bars = Bars::new(!args.json);
        if args.level.is_some() && !model::is_lods(&args.b) {
            bail!("{}: levels are in .lods files; leave --level out", args.b.display());
        }
        let a = model::load(&args.a, None, &args.machine, &bars)?;
        let b = model::load(&args.b, args.level, &args.machine, &bars)?;
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
                "seconds": { "read": read, "prepare": prepare, "distances": distances, "total": total, "cpu": shared::cpu_seconds() },
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
            shared::print(&shared::table(&[
                ("A", model(&a)),
                ("B", model(&b)),
                ("diagonal", format!("{:.6} (of A's bounding box)", geometry.diagonal)),
                ("A to B", line(&geometry.forward, geometry.diagonal)),
                ("B to A", line(&geometry.backward, geometry.diagonal)),
                ("seconds", format!("{total:.2} (read {read:.2}, distances {:.2})", prepare + distances)),
            ]))?;
        }
        Ok(Outcome::Done)
    })
}

fn line(d: &Directed, diagonal: f64) -> String {
    let relative = |x: f64| if diagonal > 0.0 { format!(" ({:.3e} of the diagonal)", x / diagonal) } else { String::new() };
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
struct Heatmap<'a> {
    path: &'a Path,
}

impl<'a> Heatmap<'a> {
    fn new(path: &'a Path) -> Result<Self> {
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) {
            bail!("{}: a heatmap is a .ply file", path.display());
        }
        Output::check(path)?;
        Ok(Heatmap { path })
    }

    fn write(&self, a: &Sampled<'_>, b: &Sampled<'_>, geometry: &Geometry) -> Result<()> {
        let distances = a.vertex_distances(&b.surface);
        let output = Output::create(self.path)?;
        output.write(|out| quality::heat::write_ply(out, a.mesh(), &distances, geometry.forward.max))?;
        output.commit()
    }
}
