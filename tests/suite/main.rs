//! Every test of the whole that needs no process of its own, by what it proves.

mod common;

mod appearance;
mod attributes;
mod bad_input;
mod cases;
mod command_line;
mod command_line_images;
mod command_line_looks;
mod datasets;
mod formats;
mod fuzz_findings;
mod golden;
mod hardening;
mod hostile_files;
mod ingest;
mod ingest_store;
mod levels;
mod library;
mod limits;
mod outliers;
mod outputs;
mod pictures;
mod reference;
mod rooms;
mod round_trip;
mod schedule;
mod soups;
mod special_files;
mod stopped;
mod textures;
mod threads;
mod validator;
mod wedges;
