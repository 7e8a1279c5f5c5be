//! `lodestream report`: what each prefix of a file costs and is worth, on one page that opens anywhere.

mod measure;
mod page;

use crate::Outcome;
use crate::compare::{Looks, Sampling};
use crate::encode::ImageArgs;
use crate::output::Outputs;
use crate::progress::Bars;
use crate::shared::{self, Machine};
use anyhow::{Context, Result};
use measure::Subject;
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lodestream report scan.ply -o report
  lodestream report horse.ply bunny.ply -o curves --levels 20 --views 0
  lodestream report old.lods new.lods -o versions
  lodestream report helmet.glb -o helmet --schedule quality

Writes report.html, a page without anything outside it, and report.json with the same numbers. A mesh is encoded first, with its
images as the options say; a .lods file is measured against all of itself.")]
pub struct Args {
    /// Meshes and .lods files; their curves are drawn over each other
    #[arg(value_name = "IN", required = true)]
    inputs: Vec<PathBuf>,
    /// The folder to write to; made where it is missing
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Prefixes to measure, spread evenly over the orders of size; each ends with a level or with a piece of an image
    #[arg(long, value_name = "N", default_value_t = 14, value_parser = clap::value_parser!(u16).range(2..))]
    levels: u16,
    /// Bits per coordinate for meshes, 1 to 21
    #[arg(long, value_name = "BITS", default_value_t = 12, value_parser = clap::value_parser!(u8).range(1..=21))]
    position_bits: u8,
    #[command(flatten)]
    images: ImageArgs,
    #[command(flatten)]
    sampling: Sampling,
    #[command(flatten)]
    looks: Looks,
    #[command(flatten)]
    machine: Machine,
    /// Print the JSON object too
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let start = Instant::now();
    args.machine.run(|threads| {
        std::fs::create_dir_all(&args.output).with_context(|| format!("{}: cannot be made", args.output.display()))?;
        let [page, data] = ["report.html", "report.json"].map(|name| args.output.join(name));
        let mut outputs = Outputs::of(args.inputs.iter().map(|path| (path.as_path(), None)));
        let (page_file, data_file) = (outputs.create(&page)?, outputs.create(&data)?);
        let bars = Bars::new(!args.json);
        let mut subjects: Vec<Subject> = Vec::new();
        for path in &args.inputs {
            subjects.push(measure::measure(path, args, &bars)?);
        }
        bars.finish();
        let json = measure::json(&subjects, args, threads);
        let text = serde_json::to_string_pretty(&json)?;
        data_file.write(|out| out.write_all(text.as_bytes()))?;
        let html = page::html(&subjects, args)?;
        page_file.write(|out| out.write_all(html.as_bytes()))?;
        data_file.commit()?;
        page_file.commit()?;
        if args.json {
            shared::print_json(&json)?;
        } else {
            let levels: usize = subjects.iter().map(|s| s.levels.len()).sum();
            shared::print(&shared::table(&[
                ("page", page.display().to_string()),
                ("data", data.display().to_string()),
                ("prefixes", format!("{levels} of {} files", subjects.len())),
                ("seconds", format!("{:.1}", shared::seconds(start))),
            ]))?;
        }
        Ok(Outcome::Done)
    })
}
