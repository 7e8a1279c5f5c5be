//! Runs in this process, with hooks; `tests/ingest.rs` starts the real program.

use super::*;
use crate::io::write::{WriteOptions, write_path};
use crate::samples;
use std::path::Path;
use std::sync::Mutex;

fn meshes(folder: &Path, count: u32) {
    for i in 0..count {
        let mesh = samples::asteroid(3 + i % 5, u64::from(i));
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
    write_path(&changed, &samples::torus(9, 9), None, &WriteOptions::default()).unwrap();
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
fn resuming_sees_every_file_that_reaches_the_output() {
    let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let put = |name: &str, text: &[u8]| std::fs::write(from.path().join(name), text).unwrap();
    put("a.obj", b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl x\nf 1/1 2/2 3/3\n");
    put("a.mtl", b"newmtl x\nmap_Kd x.png\nnewmtl unused\nmap_Kd y.png\n");
    put(
        "b.ply",
        b"ply\nformat ascii 1.0\ncomment TextureFile x.png\nelement vertex 3\nproperty float x\nproperty float y\n\
          property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    );
    put("x.png", b"\x89PNG one");
    let gltf = |image: &str| {
        let bytes: Vec<u8> =
            [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        put("c.bin", &bytes);
        put(
            "c.gltf",
            format!(
                r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"uri":"c.bin","byteLength":36}}],"bufferViews":[{{"buffer":0,"byteLength":36}}],
                "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"images":[{{"uri":"{image}"}}]}}"#
            )
            .as_bytes(),
        );
    };
    gltf("X.PNG");
    let mut plan = plan(from.path(), to.path());
    (plan.resume, plan.verify) = (true, true);
    let again = |plan: &Plan| {
        let s = run(plan, &()).unwrap();
        (s.done, s.skipped, s.failed())
    };
    assert_eq!(again(&plan), (3, 0, 0));
    assert_eq!(again(&plan), (0, 3, 0));
    put("x.png", b"\x89PNG two");
    assert_eq!(again(&plan), (3, 0, 0), "an image of all three, the third names it in other letters");
    put("a.mtl", b"newmtl x\nKd 1 0 0\nmap_Kd x.png\n");
    assert_eq!(again(&plan), (1, 2, 0), "a library");
    put("y.png", b"\x89PNG of a material that is not used");
    assert_eq!(again(&plan), (0, 3, 0));
    put("c.bin", &[0; 36]);
    assert_eq!(again(&plan), (1, 2, 0), "a buffer");
    std::fs::remove_file(from.path().join("x.png")).unwrap();
    assert_eq!(again(&plan), (3, 0, 0), "a file that is gone");
    plan.settings.drop.images = true;
    assert_eq!(again(&plan), (3, 0, 0));
    put("x.png", b"\x89PNG again");
    assert_eq!(again(&plan), (0, 3, 0), "what is dropped does not matter");
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
    let mesh = samples::asteroid(3, 1);
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
