//! `lodestream demo`: the whole round with no data file at hand: a mesh made by rule, encoded, decoded level by level, drawn.

use crate::Outcome;
use crate::encode::{bits_per_vertex, stage_name};
use crate::output::Outputs;
use crate::progress::Bars;
use crate::shared::{self, Machine};
use crate::stream::Stream;
use anyhow::{Context, Result, bail};
use lodestream::encode::cost::Engine;
use lodestream::encode::{self, Control, EncodeOptions, Progress};
use lodestream::io::read::Format;
use lodestream::mesh::Mesh;
use lodestream::quality::exact;
use lodestream::quality::picture::{self, Picture, Shading, Tile, View};
use lodestream::samples;
use std::fmt::Write as _;
use std::io::{self, Cursor, IsTerminal};
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream demo
  lodestream demo --vertices 500000 --output demo")]
pub struct Args {
    /// The folder for the mesh, the .lods file and the pictures; made where it is missing
    #[arg(short, long, value_name = "FOLDER", default_value = "lodestream-demo")]
    output: PathBuf,
    /// About how many vertices the mesh has
    #[arg(long, value_name = "N", default_value_t = 60_000, value_parser = clap::value_parser!(u32).range(100..=20_000_000))]
    vertices: u32,
    /// Another number makes another mesh
    #[arg(long, value_name = "N", default_value_t = 5)]
    seed: u32,
    #[command(flatten)]
    machine: Machine,
}

/// Pictures on the sheet, at most.
const PICTURES: u32 = 6;
/// Pixels of a picture's side.
const SIDE: u32 = 400;

pub fn run(args: &Args) -> Result<Outcome> {
    args.machine.run(|threads| {
        let folder = &args.output;
        std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let [source, file, sheet] = ["asteroid.ply", "asteroid.lods", "levels.png"].map(|name| folder.join(name));

        // Four fifths of the vertices in one closed surface, the rest in crumbs of a bit less than three each.
        let frequency = (f64::from(args.vertices) * 0.08).sqrt().max(1.0) as u32;
        let mesh = samples::ringed_asteroid(frequency, args.vertices / 14, u64::from(args.seed));
        let mut outputs = Outputs::of([]);
        let mut output = outputs.create(&source)?;
        output.write_mesh(Format::Ply, &mesh, None)?;
        output.commit()?;
        shared::print(&format!(
            "made     {}: {} vertices, {} faces, an asteroid in a ring of {} loose pieces\n",
            source.display(),
            shared::thousands(mesh.vertex_count() as u64),
            shared::thousands(mesh.face_count() as u64),
            shared::thousands(u64::from(args.vertices / 14)),
        ))?;

        let bars = Bars::new(true);
        let start = Instant::now();
        let progress = |p: Progress| bars.show(stage_name(p.stage), p.done, p.total);
        let encoded = encode::encode_with(
            &mesh,
            &EncodeOptions::default(),
            Engine::default(),
            Control::new().progress(&progress),
        )?;
        bars.finish();
        let encode_seconds = start.elapsed().as_secs_f64();
        let output = outputs.create(&file)?;
        output.write(|out| out.write_all(&encoded.bytes))?;
        output.commit()?;
        let bytes = encoded.bytes.len() as u64;
        shared::print(&format!(
            "encoded  {}: {}, {:.2} bits per vertex, {} levels, {encode_seconds:.2} s on {threads} threads\n",
            file.display(),
            shared::human_bytes(bytes),
            bits_per_vertex(bytes, mesh.vertex_count()).unwrap_or(0.0),
            encoded.report.levels,
        ))?;

        let start = Instant::now();
        let (tiles, decoded, lattice) = decode_and_draw(&file, encoded.bytes, &mesh, &bars)?;
        if let Err(difference) = exact::by_map(&mesh, &decoded, &lattice, &encoded.map) {
            bail!("the decoded mesh differs from the source: {difference}; please report this");
        }
        let title = format!("lodestream: one file of {}, {} of its levels", shared::human_bytes(bytes), tiles.len());
        let picture = picture::contact_sheet(&title, &tiles, 3);
        let output = outputs.create(&sheet)?;
        output.write(|out| picture.write_png(out))?;
        output.commit()?;
        if io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none() {
            shared::print(&preview(&picture, 96))?;
        }
        let seconds = start.elapsed().as_secs_f64();
        shared::print(&format!(
            "decoded  every level, drew {} of them in {seconds:.2} s; the full one equals the quantized source, vertex by vertex\n\
             pictures {}\n\
             next     lodestream info {}\n",
            tiles.len(),
            sheet.display(),
            file.display()
        ))?;
        Ok(Outcome::Done)
    })
}

/// Decode the file level by level and draw some of them; also the full level and its lattice.
fn decode_and_draw(
    file: &std::path::Path,
    bytes: Vec<u8>,
    source: &Mesh,
    bars: &Bars,
) -> Result<(Vec<Tile>, Mesh, lodestream::mesh::lattice::Lattice)> {
    let view = View::z_up(source, -0.5, 0.35);
    let mut stream = Stream::new(file.display().to_string(), Box::new(Cursor::new(bytes)), u64::MAX)?;
    let front = stream.front().clone();
    let full = front.full_level();
    // The levels nearest to 2/5 of the vertices, 2/5 of those, and so on.
    let vertices: Vec<u64> = (0..=full).map(|level| stream.vertices(level)).collect();
    let wanted = (0..PICTURES).rev().map(|k| stream.vertices(full) * (1 << k) / 5u64.pow(k));
    let mut shown: Vec<u32> =
        wanted.filter_map(|n| (0..=full).min_by_key(|&level| vertices[level as usize].abs_diff(n))).collect();
    shown.dedup();
    let mut tiles = Vec::new();
    let reached = stream.decode(full, Default::default(), bars, |level, decoder| {
        if shown.contains(&level) {
            let prefix = front.prefix_bytes(level).unwrap_or(0);
            let rate = bits_per_vertex(prefix, source.vertex_count()).unwrap_or(0.0);
            tiles.push(Tile {
                picture: picture::render(&decoder.to_mesh(), &view, Shading::Flat, SIDE, SIDE),
                caption: vec![
                    format!("level {level}: {} vertices", shared::thousands(vertices[level as usize])),
                    format!("{}, {rate:.2} bits per vertex", shared::human_bytes(prefix)),
                ],
            });
        }
        Ok(())
    })?;
    if let Some(cut) = reached.cut {
        return Err(cut.into());
    }
    Ok((tiles, reached.decoder.to_mesh(), front.header().lattice))
}

/// A picture for the terminal: two pixels a character, by an upper half block in two colours.
fn preview(picture: &Picture, columns: u32) -> String {
    let columns = columns.min(picture.width).max(1);
    let scale = picture.width as f64 / f64::from(columns);
    let rows = (f64::from(picture.height) / scale) as u32 / 2;
    let mean = |column: u32, row: u32| -> [u32; 3] {
        let span = |i: u32, limit: u32| {
            let from = ((f64::from(i) * scale) as u32).min(limit - 1);
            from..((f64::from(i + 1) * scale) as u32).clamp(from + 1, limit)
        };
        let (mut sum, mut count) = ([0u32; 3], 0);
        for y in span(row, picture.height) {
            for x in span(column, picture.width) {
                let pixel = picture.pixel(x, y);
                (0..3).for_each(|k| sum[k] += u32::from(pixel[k]));
                count += 1;
            }
        }
        sum.map(|c| c / count.max(1))
    };
    let mut out = String::new();
    for row in 0..rows {
        for column in 0..columns {
            let ([r, g, b], [s, h, c]) = (mean(column, 2 * row), mean(column, 2 * row + 1));
            // Writing into a string cannot fail.
            let _ = write!(out, "\x1b[38;2;{r};{g};{b};48;2;{s};{h};{c}m\u{2580}");
        }
        out.push_str("\x1b[0m\n");
    }
    out
}
