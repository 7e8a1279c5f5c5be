//! Pictures and their scores as a user meets them, through the command line; on real models where `LODESTREAM_DATA` is set.

use crate::common::{Scratch, datasets, lodestream};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::Mesh;
use lodestream::quality::picture::{Picture, decode};
use lodestream::samples;

const BACKGROUND: [u8; 3] = [38, 42, 50];

/// A picture that the program wrote.
fn picture(scratch: &Scratch, name: &str) -> Picture {
    let pixels = decode(&std::fs::read(scratch.path(name)).unwrap()).unwrap();
    let rgb = pixels.rgba.as_chunks::<4>().0.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    Picture { width: pixels.width, height: pixels.height, rgb }
}

fn save(scratch: &Scratch, name: &str, mesh: &Mesh) {
    write::write_path(scratch.path(name), mesh, None, &WriteOptions::default()).unwrap();
}

/// The channel that outshines both others twice over, if one does.
fn hue(pixel: [u8; 3]) -> Option<char> {
    let strongest = (0..3).find(|&k| (0..3).all(|i| i == k || u16::from(pixel[k]) > 2 * u16::from(pixel[i])));
    strongest.map(|k| ['r', 'g', 'b'][k])
}

/// Three squares across the axis of sight: red, small and in front; green behind it; blue, small, at the back.
const SQUARES: &str = "\
v -1 -1 1 1 0 0\nv 1 -1 1 1 0 0\nv 1 1 1 1 0 0\nv -1 1 1 1 0 0
v -3 -3 0 0 1 0\nv 3 -3 0 0 1 0\nv 3 3 0 0 1 0\nv -3 3 0 0 1 0
v -1 -1 -1 0 0 1\nv 1 -1 -1 0 0 1\nv 1 1 -1 0 0 1\nv -1 1 -1 0 0 1
f 1 2 3 4\nf 5 6 7 8\nf 12 11 10 9
";

#[test]
fn what_is_nearer_hides_what_is_farther() {
    let scratch = Scratch::new("pictures-hidden");
    scratch.write("squares.obj", SQUARES);
    for (view, middle) in [("front", 'r'), ("back", 'b')] {
        for more in ["", " --perspective 40", " --shading flat"] {
            lodestream(scratch.folder(), &format!("render squares.obj -o a.png --size 100x80 --view {view}{more}"))
                .ok();
            let drawn = picture(&scratch, "a.png");
            assert_eq!((drawn.width, drawn.height), (100, 80));
            assert_eq!(hue(drawn.pixel(50, 40)), Some(middle), "{view}{more}");
            // The green square is seen around it, and nothing in the corner.
            for (x, y) in [(50, 25), (35, 40), (65, 40), (50, 55)] {
                assert_eq!(hue(drawn.pixel(x, y)), Some('g'), "{view}{more} at {x}, {y}");
            }
            assert_eq!(drawn.pixel(1, 1), BACKGROUND);
        }
    }
}

#[test]
fn textures_lie_where_their_coordinates_say() {
    let scratch = Scratch::new("pictures-textures");
    let mut image = Picture::new(64, 64, [255, 0, 0]);
    image.paste(&Picture::new(64, 32, [0, 0, 255]), 0, 32);
    image.paste(&Picture::new(32, 32, [0, 255, 0]), 32, 0);
    image.write_png(std::fs::File::create(scratch.path("image.png")).unwrap()).unwrap();
    scratch.write("square.mtl", "newmtl m\nKd 1 1 1\nmap_Kd image.png\n");
    let square = "mtllib square.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                  f 1/1 2/2 3/3 4/4\n";
    scratch.write("square.obj", square);
    lodestream(scratch.folder(), "encode square.obj -o square.lods --texture keep").ok();
    for input in ["square.obj", "square.lods"] {
        lodestream(scratch.folder(), &format!("render {input} -o a.png --size 80 --view front")).ok();
        let drawn = picture(&scratch, "a.png");
        // The upper half is red on the left and green on the right, the lower one blue.
        for (x, y, expected) in [(30, 30, 'r'), (50, 30, 'g'), (30, 50, 'b'), (50, 50, 'b')] {
            assert_eq!(hue(drawn.pixel(x, y)), Some(expected), "{input} at {x}, {y}");
        }
    }
}

#[test]
fn pictures_and_scores_are_the_same_on_any_number_of_threads() {
    let scratch = Scratch::new("pictures-threads");
    save(&scratch, "fine.ply", &samples::mixed(30, 30, 4));
    save(&scratch, "coarse.ply", &samples::mixed(12, 12, 4));
    for words in ["render fine.ply -o N.png --size 130x170 --shading wire", "render coarse.ply -o N.png --size 96"] {
        let drawn = ["1", "2", "5"].map(|threads| {
            let name = format!("{threads}.png");
            lodestream(scratch.folder(), &format!("{} --threads {threads}", words.replace("N.png", &name))).ok();
            std::fs::read(scratch.path(&name)).unwrap()
        });
        assert!(drawn[0] == drawn[1] && drawn[0] == drawn[2], "{words}");
    }
    let compare = "compare fine.ply coarse.ply --samples 1000 --views 5 --size 180 --json --threads";
    let [one, many] = ["1", "5"].map(|threads| lodestream(scratch.folder(), &format!("{compare} {threads}")).json());
    assert_eq!(one["appearance"], many["appearance"]);
    assert_eq!(one["appearance"]["views"].as_array().map(Vec::len), Some(5));
}

#[test]
fn coarser_levels_look_less_alike() {
    let scratch = Scratch::new("pictures-levels");
    save(&scratch, "rock.ply", &samples::asteroid(20, 4));
    lodestream(scratch.folder(), "encode rock.ply -o rock.lods").ok();
    let json =
        lodestream(scratch.folder(), "report rock.ply -o page --levels 4 --samples 500 --views 3 --size 180 --json");
    let levels = json.json()["files"][0]["levels"].as_array().cloned().unwrap();
    let scores: Vec<f64> = levels.iter().map(|level| level["ms_ssim"].as_f64().unwrap()).collect();
    assert!(scores.len() >= 3 && scores.is_sorted_by(|a, b| a < b), "{scores:?}");
    assert!(scores[0] > 0.1 && scores[scores.len() - 1] > 0.999, "{scores:?}");
    // `compare` sees the same.
    let coarse =
        format!("compare rock.ply rock.lods --level {} --samples 500 --views 3 --size 180 --json", levels[0]["level"]);
    let compared = lodestream(scratch.folder(), &coarse).json()["appearance"]["ms_ssim"].as_f64().unwrap();
    assert!((compared - scores[0]).abs() < 1e-12, "{compared} {scores:?}");
}

#[test]
fn drawing_takes_no_device() {
    let scratch = Scratch::new("pictures-device");
    save(&scratch, "rock.ply", &samples::asteroid(4, 4));
    for words in ["render rock.ply -o a.png", "compare rock.ply rock.ply", "report rock.ply -o page"] {
        for option in ["--device cpu", "--gpu-memory 1GiB"] {
            let run = lodestream(scratch.folder(), &format!("{words} {option}"));
            assert_eq!(run.code, 2, "{words} {option}");
            let name = option.split(' ').next().unwrap_or_default();
            assert!(run.stderr.contains(&format!("unexpected argument '{name}'")), "{}", run.stderr);
        }
    }
    assert_eq!(scratch.names(), ["rock.ply"]);
}

#[test]
fn real_models_look_like_themselves() {
    let names = ["classic/fandisk", "textured/avocado", "textured/damagedhelmet", "textured/duck", "textured/spot"];
    for dataset in datasets::available(|d| names.contains(&d.name.as_str())) {
        let scratch = Scratch::new("pictures-real");
        let file = dataset.file().expect("it is there").display().to_string();
        for bits in ["12", "6"] {
            let words = format!("encode {file} -o {bits}.lods --position-bits {bits} --texture keep");
            lodestream(scratch.folder(), &words).ok();
        }
        let seen = |words: &str| {
            let words = format!("compare {words} --samples 500 --views 4 --size 256 --json");
            let json = lodestream(scratch.folder(), &words).json();
            json["appearance"]["ms_ssim"].as_f64().unwrap()
        };
        let (same, fine, coarse) =
            (seen(&format!("{file} {file}")), seen(&format!("{file} 12.lods")), seen(&format!("{file} 6.lods")));
        println!("{}: {same} {fine} {coarse}", dataset.name);
        assert!(same == 1.0 && fine > 0.99 && fine > coarse && coarse > 0.3, "{}: {fine} {coarse}", dataset.name);
    }
}
