//! `lodestream ingest` from and to a bucket on loopback, in health and in sickness.

use crate::common::Run;
use crate::common::bucket::{Bucket, Fault};
use lodestream::io::read::Format;
use lodestream::io::write::write_to;
use lodestream::samples;
use std::collections::BTreeMap;

fn mesh_bytes(i: u32) -> (String, Vec<u8>) {
    let (extension, format) = [("ply", Format::Ply), ("obj", Format::Obj), ("glb", Format::Glb)][i as usize % 3];
    let mut bytes = Vec::new();
    write_to(&mut bytes, format, &samples::asteroid(4 + i % 7, u64::from(i)), None).unwrap();
    (format!("raw/day {}/scan-{i:03}.{extension}", i % 2), bytes)
}

fn filled(count: u32) -> Bucket {
    let bucket = Bucket::start();
    for i in 0..count {
        let (key, bytes) = mesh_bytes(i);
        bucket.put(&key, bytes);
    }
    bucket.put("raw/notes.txt", b"not a mesh".to_vec());
    bucket.put("rawhide/other.ply", b"below another prefix".to_vec());
    bucket
}

/// Run the program against a bucket.
fn ingest(bucket: &Bucket, words: &str) -> Run {
    crate::common::lodestream_in(&std::env::temp_dir(), words, &bucket.environment())
}

fn outputs(bucket: &Bucket, prefix: &str) -> BTreeMap<String, Vec<u8>> {
    let objects = bucket.objects().into_iter();
    objects.filter_map(|(k, v)| Some((k.strip_prefix(prefix)?.to_string(), v))).collect()
}

/// What one clean run gives.
fn clean(count: u32) -> BTreeMap<String, Vec<u8>> {
    let bucket = filled(count);
    ingest(&bucket, "ingest s3://scans/raw -o s3://scans/clean --jobs 2").ok();
    let outputs = outputs(&bucket, "clean/");
    assert_eq!(outputs.len(), count as usize);
    outputs
}

#[test]
fn a_bucket_becomes_a_bucket_in_pages_and_resumes() {
    let bucket = filled(20);
    let run = ingest(&bucket, "ingest s3://scans/raw/ -o s3://scans/out --verify").ok();
    assert!(run.stdout.contains("20: 20 done"), "{}", run.stdout);
    let first = outputs(&bucket, "out/");
    assert!(first.contains_key("day 1/scan-001.lods"), "{:?}", first.keys());
    let run = ingest(&bucket, "ingest s3://scans/raw/ -o s3://scans/out --resume").ok();
    assert!(run.stdout.contains("20: 0 done, 20 skipped"), "{}", run.stdout);
    // From the bucket to a folder, by a pattern, gives the same bytes.
    let folder = crate::common::Scratch::new("store-folder");
    let run = crate::common::lodestream_in(
        folder.folder(),
        "ingest s3://scans/raw/**/scan-00*.ply -o out",
        &bucket.environment(),
    )
    .ok();
    assert!(run.stdout.contains("4: 4 done"), "{}", run.stdout);
    // The pattern begins below raw/.
    assert_eq!(std::fs::read(folder.path("out/day 0/scan-000.lods")).unwrap(), first["day 0/scan-000.lods"]);
    let run = ingest(&bucket, "ingest s3://scans/nothing -o s3://scans/out");
    assert_eq!((run.code, run.stderr.contains("no mesh was found")), (1, true), "{}", run.stderr);
}

#[test]
fn a_store_that_fails_now_and_then_is_asked_again() {
    let clean = clean(12);
    for fault in [Fault::Status(500, 3), Fault::Status(503, 4), Fault::Cut(3), Fault::Slow(20)] {
        let bucket = filled(12);
        bucket.fault(fault);
        let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --jobs 2 --retry-within 60").ok();
        assert!(run.stdout.contains("12: 12 done"), "{fault:?}: {}", run.stdout);
        assert!(outputs(&bucket, "out/") == clean, "{fault:?}: other bytes");
    }
}

#[test]
fn a_list_that_breaks_off_goes_on_where_it_was() {
    // Four pages; every second answer breaks off, whichever the threads ask for first.
    let bucket = filled(26);
    bucket.fault(Fault::Cut(2));
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --jobs 2 --retry-within 60").ok();
    assert!(run.stdout.contains("26: 26 done"), "{}", run.stdout);
    assert_eq!(outputs(&bucket, "out/").len(), 26);
    let bucket = filled(2);
    bucket.fault(Fault::Cut(1));
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --retries 2 --retry-within 5");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stderr.contains("s3://scans/raw: the store failed"), "{}", run.stderr);
    let lists = bucket.requests().iter().filter(|r| r.contains("list-type")).count();
    assert_eq!(lists, 3, "one attempt and two more: {:?}", bucket.requests());
}

#[test]
fn what_a_store_refuses_fails_alone_and_comes_with_the_next_run() {
    let clean = clean(9);
    let bucket = filled(9);
    let (sick, _) = mesh_bytes(3);
    bucket.refuse(&sick, 500);
    bucket.refuse(&mesh_bytes(4).0, 403);
    bucket.refuse("out/day 1/scan-005.lods", 503);
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --retries 2 --retry-within 5");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stdout.contains("9: 6 done, 0 skipped, 3 failed"), "{}", run.stdout);
    assert!(run.stdout.contains("failed: store") && run.stdout.contains("failed: permission"), "{}", run.stdout);
    assert!(run.stderr.contains(&format!("s3://scans/{sick}: the store failed")), "{}", run.stderr);
    assert!(run.stderr.contains("the store refuses access"), "{}", run.stderr);
    bucket.heal();
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --resume").ok();
    assert!(run.stdout.contains("9: 3 done, 6 skipped"), "{}", run.stdout);
    assert!(outputs(&bucket, "out/") == clean);
    assert_eq!(bucket.open_uploads(), 0);
}

#[test]
fn a_store_that_hangs_is_given_up_in_time() {
    let bucket = filled(2);
    bucket.fault(Fault::Slow(4000));
    let start = std::time::Instant::now();
    let run =
        ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --retries 1 --retry-within 2 --request-timeout 1");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stdout.contains("failed: store"), "{}", run.stdout);
    assert!(start.elapsed().as_secs() < 60);
}

#[test]
fn what_lies_beside_a_source_comes_along_and_large_outputs_are_complete_before_they_are_seen() {
    let folder = crate::common::Scratch::new("store-beside");
    let bucket = Bucket::start();
    let object =
        b"mtllib ../looks/rock.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl x\nf 1/1 2/2 3/3\n";
    // An image larger than what goes in one request travels as it is, and so makes a large output.
    let mut image = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut random = samples::Random::new(3);
    image.extend((0..66 << 17).flat_map(|_| random.bits().to_le_bytes()));
    for (name, bytes) in [
        ("rocks/rock.obj", object.to_vec()),
        ("looks/rock.mtl", b"newmtl x\nmap_Kd big rock.png\n".to_vec()),
        ("rocks/big rock.png", image),
    ] {
        let path = folder.path(&format!("raw/{name}"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &bytes).unwrap();
        bucket.put(&format!("raw/{name}"), bytes);
    }
    crate::common::lodestream(folder.folder(), "ingest raw -o out --asset-root raw").ok();
    let local = std::fs::read(folder.path("out/rocks/rock.lods")).unwrap();
    assert!(local.len() > 66 << 20, "the image is in the output: {} bytes", local.len());

    bucket.fault(Fault::Part(2, 500));
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --asset-root raw --retries 1 --retry-within 3");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stderr.contains("s3://scans/out/rocks/rock.lods: the store failed"), "{}", run.stderr);
    assert!(outputs(&bucket, "out/").is_empty(), "a part of an output is to be seen");
    assert_eq!(bucket.open_uploads(), 0, "the upload that failed was not aborted");

    bucket.heal();
    let before = bucket.requests().len();
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --asset-root raw --resume --verify").ok();
    assert!(run.stdout.contains("1: 1 done"), "{}", run.stdout);
    assert!(outputs(&bucket, "out/")["rocks/rock.lods"] == local, "the bucket gives other bytes than the folder");
    assert_eq!(bucket.open_uploads(), 0);
    let requests = &bucket.requests()[before..];
    let writes: Vec<&str> =
        requests.iter().filter(|r| r.starts_with('P')).map(|r| &r[..r.find(' ').unwrap()]).collect();
    assert_eq!(writes, ["POST", "PUT", "PUT", "PUT", "POST"], "begun, three parts, completed last: {requests:?}");
    let run = ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --asset-root raw --resume").ok();
    assert!(run.stdout.contains("1: 0 done, 1 skipped"), "{}", run.stdout);

    // Completed, but the answer that says so breaks off: sent once more.
    bucket.fault(Fault::Completion);
    let before = bucket.requests().len();
    ingest(&bucket, "ingest s3://scans/raw -o s3://scans/out --asset-root raw --retry-within 60").ok();
    assert!(outputs(&bucket, "out/")["rocks/rock.lods"] == local);
    let requests = &bucket.requests()[before..];
    let completed = requests.iter().filter(|r| r.starts_with("POST") && r.contains("uploadId")).count();
    assert_eq!(completed, 2, "{requests:?}");
}
