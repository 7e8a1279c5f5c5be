//! Runs in this process, with hooks; `tests/ingest.rs` starts the real program.

use super::*;
use crate::generate;
use crate::write::{WriteOptions, write_path};
use std::path::Path;
use std::sync::Mutex;

fn meshes(folder: &Path, count: u32) {
    for i in 0..count {
        let mesh = generate::asteroid(3 + i % 5, u64::from(i));
        write_path(folder.join(format!("rock-{i:02}.ply")), &mesh, None, &WriteOptions::default()).unwrap();
    }
}

fn plan(from: &Path, to: &Path) -> Plan {
    let mut plan = Plan::new(vec![from.display().to_string()], to.display().to_string());
    (plan.jobs, plan.threads, plan.memory) = (2, 2, 4 << 30);
    plan
}

fn outputs(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut list: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .flatten()
        .map(|e| (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).unwrap()))
        .collect();
    list.sort();
    list
}

struct Records(Mutex<Vec<Record>>);

impl Observer for Records {
    fn event(&self, event: Event<'_>) {
        if let Event::Ended { record, .. } = event {
            self.0.lock().unwrap().push(record.clone());
        }
    }
}

#[test]
fn a_panic_is_the_failure_of_its_file_alone() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    meshes(from.path(), 6);
    let mut plan = plan(from.path(), to.path());
    plan.hook = Some(Arc::new(|name| assert!(!name.ends_with("rock-03.ply"), "index out of order")));
    let records = Records(Mutex::default());
    let summary = run(&plan, &records).unwrap();
    assert_eq!((summary.done, summary.failed()), (5, 1));
    assert_eq!(summary.failures[&FailureKind::Bug], 1);
    let records = records.0.into_inner().unwrap();
    let failed = records.iter().find(|r| r.status == Status::Failed).unwrap();
    let said = failed.error.as_deref().unwrap();
    assert!(said.contains("rock-03.ply: a bug of lodestream: index out of order; please report it"), "{said}");
    assert_eq!(outputs(to.path()).len(), 5);
}

#[test]
fn outputs_depend_on_sources_and_settings_alone() {
    let (from, one, many) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    meshes(from.path(), 9);
    let mut single = plan(from.path(), one.path());
    (single.jobs, single.threads) = (1, 2);
    run(&single, &()).unwrap();
    for k in 0..3 {
        let mut part = plan(from.path(), many.path());
        part.shard = Shard { k, n: 3 };
        (part.jobs, part.verify) = (3, true);
        run(&part, &()).unwrap();
    }
    assert_eq!(outputs(one.path()), outputs(many.path()));
}

#[test]
fn resuming_goes_by_bytes_and_settings_not_by_time_stamps() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    meshes(from.path(), 4);
    let mut plan = plan(from.path(), to.path());
    plan.resume = true;
    assert_eq!(run(&plan, &()).unwrap().done, 4);
    let before = outputs(to.path());
    // The same bytes with a new time stamp are the same source.
    let touched = from.path().join("rock-00.ply");
    std::fs::write(&touched, std::fs::read(&touched).unwrap()).unwrap();
    // Other bytes with an old one are another.
    let changed = from.path().join("rock-01.ply");
    let stamp = std::fs::metadata(&changed).unwrap().modified().unwrap();
    write_path(&changed, &generate::torus(9, 9), None, &WriteOptions::default()).unwrap();
    std::fs::File::options().write(true).open(&changed).unwrap().set_modified(stamp).unwrap();
    // An output that was cut is not there.
    std::fs::write(to.path().join("rock-02.lods"), &before[2].1[..50]).unwrap();
    let summary = run(&plan, &()).unwrap();
    assert_eq!((summary.done, summary.skipped), (2, 2));
    assert_eq!(outputs(to.path())[2], before[2]);
    assert_ne!(outputs(to.path())[1], before[1]);
    plan.settings.encode.lock_borders = true;
    let summary = run(&plan, &()).unwrap();
    assert_eq!((summary.done, summary.skipped), (4, 0), "other settings are another output");
}

#[test]
fn what_cannot_fit_is_not_started_and_says_what_it_needs() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    meshes(from.path(), 2);
    let large = "ply\nformat binary_little_endian 1.0\nelement vertex 30000000\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 60000000\nproperty list uchar int vertex_indices\nend_header\n";
    let file = std::fs::File::create(from.path().join("large.ply")).unwrap();
    std::io::Write::write_all(&mut &file, large.as_bytes()).unwrap();
    // A file with a hole: as long as a real one, at no cost.
    file.set_len(large.len() as u64 + 30_000_000 * 12 + 60_000_000 * 13).unwrap();
    let mut plan = plan(from.path(), to.path());
    plan.memory = 1 << 30;
    let records = Records(Mutex::default());
    let summary = run(&plan, &records).unwrap();
    assert_eq!((summary.done, summary.failures[&FailureKind::Memory]), (2, 1));
    let records = records.0.into_inner().unwrap();
    let said = records.iter().find_map(|r| r.error.clone()).unwrap();
    assert!(
        said.contains("large.ply: encoding it takes about 1") && said.contains("raise --memory or cut the mesh"),
        "{said}"
    );
}

#[test]
fn two_sources_of_one_output_do_not_overwrite_each_other() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mesh = generate::asteroid(3, 1);
    for name in ["a.obj", "a.ply", "b.ply"] {
        write_path(from.path().join(name), &mesh, None, &WriteOptions::default()).unwrap();
    }
    let summary = run(&plan(from.path(), to.path()), &()).unwrap();
    assert_eq!((summary.done, summary.failures[&FailureKind::Name]), (2, 1));
}

#[test]
fn stopping_at_the_first_failure_starts_no_more() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    meshes(from.path(), 30);
    // The largest go first: this one is tried at once.
    std::fs::write(from.path().join("a.ply"), format!("ply\nformat ascii 1.0\n{}", " ".repeat(2_000_000))).unwrap();
    let mut plan = plan(from.path(), to.path());
    plan.on_error = OnError::Stop;
    plan.hook = Some(Arc::new(|name| {
        if !name.ends_with("a.ply") {
            std::thread::sleep(std::time::Duration::from_millis(30));
        }
    }));
    let summary = run(&plan, &()).unwrap();
    assert!(summary.stopped && summary.failed() == 1 && summary.done < 30, "{summary:?}");
}
