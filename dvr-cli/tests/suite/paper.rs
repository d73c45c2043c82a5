//! `dvr paper` on two categories of five small objects that the test renders itself.

use crate::support::{Corpus, Tiny, dvr, refuses, succeeds, text};
use dvr_core::Scene;
use dvr_core::mesh::{Mesh, write_mesh};
use dvr_test_support::test_with;

#[test]
fn the_table_of_single_pictures_is_made_kept_and_goes_on() {
    let corpus = Corpus::new();
    let (data, out) = (corpus.data(), corpus.path("table"));
    let rows = |rows: &str, more: &[&str]| {
        let args = ["paper", "--table", "shapenet", "--data", text(&data), "--out", text(&out), "--rows", rows];
        dvr(&[&args[..], &["--steps", "2", "--resolution", "16"], more].concat())
    };
    let plan = succeeds(&rows("psgn,softras,mean-shape", &["--plan"]));
    assert!(plan.contains("psgn.0                   2") && plan.contains("CPU minutes"), "{plan}");
    assert!(!out.exists(), "a plan writes nothing");

    let output = rows("softras,psgn,mean-shape", &[]);
    let table = succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("trainings: 0 of 3 are kept"), "{said}");
    for line in ["| 2D | SoftRas (Liu et al. 2019) | 2 | 2 |", "| 3D | PSGN (Fan et al. 2017) | 2 | 2 |", "| 0.266 |"] {
        assert!(table.contains(line), "{line}: {table}");
    }
    assert!(table.contains("| lookup | mean shape of the category | 2 |  |  |"), "{table}");
    assert_eq!(corpus.read("table/table.md").trim_end(), table.trim_end());
    assert_eq!(corpus.read("table/table.csv").lines().count(), 1 + 3 * 3, "two categories and their mean");
    assert!(corpus.read("table/report.html").contains("data:image/jpeg;base64,"));
    let pictures = image::open(out.join("pictures.png")).unwrap();
    assert!(pictures.width() >= 2 * 128 && pictures.height() >= 3 * 128, "two objects, a picture and two systems");

    // Again, and with another row: what is there is kept.
    let model = || std::fs::metadata(out.join("runs/softras.0/last.ckpt")).unwrap().modified().unwrap();
    let before = model();
    let output = rows("softras,atlasnet", &[]);
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("trainings: 1 of 2 are kept"), "{said}");
    assert_eq!(model(), before);
    // A training that was killed after its last checkpoint goes on.
    std::fs::remove_file(out.join("runs/softras.0.json")).unwrap();
    succeeds(&rows("softras", &[]));
    assert!(corpus.read("table/runs/softras.0.json").contains("seconds"));

    // Of other steps, the row is made again.
    let args = ["paper", "--table", "shapenet", "--data", text(&data), "--out", text(&out), "--rows", "softras"];
    let output = dvr(&[&args[..], &["--steps", "3", "--resolution", "16"]].concat());
    assert!(succeeds(&output).contains("| 2 | 3 |"));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("made again: softras.0 (of another settings)"), "{said}");
    // With another encoder too.
    let output = dvr(&[&args[..], &["--steps", "3", "--resolution", "16", "--encoder", "convolutional"]].concat());
    assert!(String::from_utf8_lossy(&output.stderr).contains("made again: softras.0"));
    assert!(succeeds(&output).contains("| 2 | 3 |"));
    assert!(corpus.read("table/runs/softras.0/config.json").contains("\"convolutional\""));
}

#[test]
fn objects_that_are_learned_by_heart_are_those_that_are_measured() {
    let corpus = Corpus::new();
    let (data, out) = (corpus.data(), corpus.path("heart"));
    let args = ["paper", "--table", "shapenet", "--data", text(&data), "--out", text(&out), "--rows", "psgn"];
    let more = ["--steps", "2", "--resolution", "16", "--by-heart", "3"];
    let table = succeeds(&dvr(&[&args[..], &more].concat()));
    assert!(table.contains("3 objects that were trained on") && table.contains("| 3 | 2 |"), "{table}");
    let names = |split: &str| {
        let of = |category: &str| corpus.read(&format!("heart/objects/{category}/{split}.lst"));
        of("balls") + &of("rings")
    };
    assert_eq!((names("train").lines().count(), names("test")), (3, names("train")));
    refuses(&dvr(&[&args[..], &["--by-heart", "99"]].concat()), &["6 objects", "99"]);
}

#[test_with(colmap)]
fn a_table_of_scans_has_rows_of_methods_and_of_points() {
    let tiny = Tiny::new();
    let scene = Scene::read(tiny.scene()).unwrap();
    let truth = scene.ground_truth.surface.as_ref().unwrap();
    let to_world = &scene.object_to_world;
    let cloud = Mesh {
        vertices: truth.points.iter().map(|&point| to_world.transform_point_f32(point)).collect(),
        normals: truth.normals.as_ref().map(|all| all.iter().map(|&n| to_world.transform_direction(n)).collect()),
        ..Mesh::default()
    };
    let (data, out) = (tiny.scene(), tiny.path("scans"));
    let name = data.file_name().unwrap().to_str().unwrap();
    write_mesh(tiny.path(&format!("truth_{name}.ply")), &cloud).unwrap();
    let points = format!("truth={}", tiny.path("truth_{scene}.ply").display());
    let args = ["paper", "--table", "dtu", "--data", text(&data), "--out", text(&out), "--cloud", &points];
    let plan = succeeds(&dvr(&[&args[..], &["--plan"]].concat()));
    for row in ["hull", "classic", "grid", "stereo-poisson-7", "truth-0", "truth-5", "CPU minutes"] {
        assert!(plan.contains(row), "{row}: {plan}");
    }
    assert!(!out.exists());
    let rows = |rows: &str| dvr(&[&args[..], &["--rows", rows]].concat());
    let output = rows("hull,truth-0");
    let table = succeeds(&output);
    assert!(table.contains("By the true surface") && table.contains("truth + sPSR, trimmed at 0"), "{table}");
    let csv = std::fs::read_to_string(out.join("table.csv")).unwrap();
    let figure = |row: &str| -> f64 {
        let line = csv.lines().find(|line| line.split(',').nth(1) == Some(row)).unwrap();
        line.split(',').nth(4).unwrap().parse().unwrap()
    };
    assert!(figure("truth-0") < figure("hull"), "the true points are nearer than the hull: {csv}");
    assert!(std::fs::read_to_string(out.join("report.html")).unwrap().contains("visual hull"));
    let again = rows("hull,truth-0");
    succeeds(&again);
    assert!(String::from_utf8_lossy(&again.stderr).contains("surfaces: 2 of 2 are kept"));

    refuses(&rows("hull,truth-6"), &["truth-6", "truth-7", "stereo-poisson-5"]);
    refuses(&dvr(&[&args[..], &["--points", "none.npz"]].concat()), &["--points none.npz", "none of the scenes"]);
    let lost = ["--cloud", "lost=/nowhere/{scene}.ply"];
    refuses(&dvr(&[&args[..7], &lost].concat()), &["/nowhere/", ".ply", "no such file"]);
    let unnumbered = ["--cloud", "lost=/nowhere/{scan}.ply"];
    refuses(&dvr(&[&args[..7], &unnumbered].concat()), &["{scan}", "no number behind `scan`"]);
    refuses(&dvr(&[&args[..7], &["--cloud", "a b"]].concat()), &["NAME=FILE"]);
    refuses(&dvr(&[&args[..], &["--seeds", "2"]].concat()), &["one seed", "dvr bench"]);
    refuses(&dvr(&[&args[..], &["--steps", "2"]].concat()), &["--steps", "shapenet"]);
}

#[test]
fn what_a_table_cannot_be_made_of_is_refused_and_nothing_is_written() {
    let corpus = Corpus::new();
    let (data, out) = (corpus.data(), corpus.path("out"));
    let object = corpus.read("data/rings/test.lst").lines().next().unwrap().to_owned();
    let scene = data.join("rings").join(object);
    let paper = |table: &str, data: &str, more: &[&str]| {
        dvr(&[&["paper", "--table", table, "--data", data, "--out", text(&out)], more].concat())
    };
    refuses(&paper("shapenet", text(&scene), &[]), &["not a dataset of objects", "dvr synth"]);
    refuses(&paper("shapenet", text(&data), &["--rows", "dvr,voxels"]), &["voxels", "softras", "dvr-depth"]);
    refuses(&paper("shapenet", text(&data), &["--data", text(&scene)]), &["one dataset", "2 paths"]);
    refuses(&paper("depth", text(&scene), &["--by-heart", "3"]), &["--by-heart", "shapenet"]);
    refuses(&paper("voxels", text(&data), &[]), &["voxels", "smoothness"]);
    refuses(&paper("shapenet", text(&data), &["--reference", "/nowhere"]), &["--reference", "dtu"]);
    let inside = data.join("rings/out");
    let args = ["paper", "--table", "shapenet", "--data", text(&data), "--out", text(&inside)];
    refuses(&dvr(&args), &["rings"]);
    assert!(!out.exists() && !inside.exists());
    let plan = dvr(&["paper", "--table", "depth", "--data", text(&scene), "--out", text(&out), "--plan"]);
    succeeds(&plan);
    let said = String::from_utf8_lossy(&plan.stderr).into_owned();
    assert!(
        said.contains("dvr bench") && said.contains("rgb,depth,rgb+depth") && said.contains("CPU minutes"),
        "{said}"
    );
    assert!(!out.exists());
}
