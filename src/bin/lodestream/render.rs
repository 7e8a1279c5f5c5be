//! `lodestream render`: a picture of a mesh or of a level.

use crate::Outcome;
use crate::decode::Choice;
use crate::model;
use crate::output::Outputs;
use crate::progress::Bars;
use crate::shared::{self, Machine};
use anyhow::{Result, bail};
use clap::ValueEnum;
use lodestream::mesh::Mesh;
use lodestream::quality::picture::{Scene, Shading, View, draw};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream render scan.ply -o scan.png
  lodestream render scan.lods -o coarse.png --level 20 --shading wire
  lodestream render house.glb -o house.png --view 30,20 --up z --perspective 40 --size 1600x900")]
pub struct Args {
    /// A mesh or a .lods file
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The picture: .png
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    #[command(flatten)]
    choice: Choice,
    /// From where: front, back, left, right, top, bottom, or YAW,PITCH in degrees
    #[arg(long, value_name = "VIEW", default_value = "25,20", value_parser = parse_view, allow_hyphen_values = true)]
    view: [f64; 2],
    /// The axis that is upright
    #[arg(long, value_enum, default_value = "y")]
    up: Up,
    /// The field of view in degrees [default: parallel rays]
    #[arg(long, value_name = "DEGREES", value_parser = parse_field)]
    perspective: Option<f64>,
    /// How faces are shaded
    #[arg(long, value_enum, default_value = "smooth")]
    shading: Look,
    /// Pixels, as in 512 or 800x600
    #[arg(long, value_name = "SIZE", default_value = "800", value_parser = parse_size)]
    size: [u32; 2],
    #[command(flatten)]
    machine: Machine,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Up {
    /// As in glTF
    Y,
    /// As in most scans
    Z,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Look {
    /// Normals of the file, or smooth ones
    Smooth,
    /// One brightness per face
    Flat,
    /// Flat, with edges
    Wire,
}

impl Look {
    pub fn shading(self) -> Shading {
        match self {
            Look::Smooth => Shading::Smooth,
            Look::Flat => Shading::Flat,
            Look::Wire => Shading::Wire,
        }
    }
}

fn parse_view(text: &str) -> Result<[f64; 2], String> {
    match text {
        "front" => return Ok([0.0, 0.0]),
        "back" => return Ok([180.0, 0.0]),
        "right" => return Ok([90.0, 0.0]),
        "left" => return Ok([-90.0, 0.0]),
        "top" => return Ok([0.0, 90.0]),
        "bottom" => return Ok([0.0, -90.0]),
        _ => {}
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[yaw, pitch]) if yaw.abs() <= 360.0 && pitch.abs() <= 90.0 => Ok([yaw, pitch]),
        _ => Err("a view is front, back, left, right, top, bottom, or YAW,PITCH in degrees, as in 30,20".into()),
    }
}

fn parse_field(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(degrees) if (1.0..=120.0).contains(&degrees) => Ok(degrees),
        _ => Err("a field of view is 1 to 120 degrees".into()),
    }
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let sides: Option<Vec<u32>> =
        text.split('x').map(|n| n.trim().parse().ok().filter(|n| (8..=8192).contains(n))).collect();
    match sides.as_deref() {
        Some(&[side]) => Ok([side, side]),
        Some(&[width, height]) => Ok([width, height]),
        _ => Err("a size is a number of pixels from 8 to 8192, or two as in 800x600".into()),
    }
}

/// A view of `mesh` by angles in degrees: yaw to the right of the front, pitch upwards.
pub fn view(mesh: &Mesh, [yaw, pitch]: [f64; 2], up: Up) -> View {
    let (yaw, pitch) = (-yaw.to_radians(), pitch.to_radians());
    match up {
        Up::Y => View::from_angles(mesh, yaw, pitch),
        Up::Z => View::z_up(mesh, yaw, pitch),
    }
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    if !args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        bail!("{}: pictures are written as .png", args.output.display());
    }
    args.machine.run(|_| {
        let output = Outputs::of([(args.input.as_path(), None)]).create(&args.output)?;
        let model = model::load(&args.input, &args.choice, &args.machine, &Bars::new(true))?;
        let scene = Scene::new(&model.mesh, args.shading.shading());
        scene.warnings().iter().for_each(|w| shared::warn(format!("{}: {w}", shared::name(&args.input))));
        let mut view = view(&model.mesh, args.view, args.up);
        if let Some(degrees) = args.perspective {
            view = view.perspective(degrees);
        }
        let picture = draw(&scene, &view, args.size[0], args.size[1]);
        output.write(|out| picture.write_png(out))?;
        output.commit()?;
        shared::print(&shared::table(&[
            ("vertices", shared::thousands(model.mesh.vertex_count() as u64)),
            ("faces", shared::thousands(model.mesh.face_count() as u64)),
            ("picture", format!("{}, {} by {} pixels", args.output.display(), args.size[0], args.size[1])),
            ("seconds", format!("{:.2}", shared::seconds(start))),
        ]))?;
        Ok(Outcome::Done)
    })
}
