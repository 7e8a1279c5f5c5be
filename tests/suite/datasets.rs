//! `datasets.toml` says what is true: files are there (in CI), are those that are meant, and have the counts that it states.

use crate::common::datasets::{self, Dataset};
use std::collections::HashSet;

#[test]
fn every_entry_is_complete_and_names_are_unique() {
    let all = datasets::all();
    let mut names = HashSet::new();
    for d in &all {
        assert!(names.insert(d.name.clone()), "{} stands twice", d.name);
        match (&d.path, &d.generated) {
            (Some(path), None) => {
                assert!(path.starts_with(d.name.split('/').next().unwrap()), "{}: {path}", d.name);
                assert!(d.source.is_some() && d.licence.is_some(), "{}", d.name);
                assert_eq!(d.sha256.as_ref().map(String::len), Some(64), "{}", d.name);
            }
            (None, Some(_)) => assert!(d.size > 0, "{}", d.name),
            _ => panic!("{}: either path or generated", d.name),
        }
    }
}

#[test]
fn files_are_those_that_are_meant() {
    for d in datasets::available(|d| d.path.is_some()) {
        d.check_sum().unwrap();
    }
}

#[test]
fn counts_are_as_stated() {
    let mut wrong = Vec::new();
    for d in datasets::available(|d: &Dataset| !d.large) {
        let mesh = match d.load(Some(false)) {
            Ok(mesh) => mesh,
            Err(error) => {
                wrong.push(error);
                continue;
            }
        };
        let faces = mesh.faces().filter(|f| f.len() > 2).count();
        if (mesh.vertex_count(), faces) != (d.vertices, d.faces) {
            wrong.push(format!("{} {} {faces}", d.name, mesh.vertex_count()));
        }
    }
    assert!(wrong.is_empty(), "datasets.toml is wrong about (found):\n{}", wrong.join("\n"));
}
