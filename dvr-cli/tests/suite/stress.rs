//! `dvr stress`: where methods fail.

use std::process::Command;

use crate::support::{Tiny, dvr, refuses, succeeds, text};

#[test]
fn cells_are_judged_and_not_computed_twice() {
    let tiny = Tiny::new();
    let out = tiny.path("stress");
    let stress = || dvr(&["stress", "--axis", "texture-lies,gradient-scale", "--methods", "hull", "--out", text(&out)]);
    let table = succeeds(&stress());
    for line in ["| breaks at |", "texture-lies", "scale-free", "**", "dvr 0"] {
        assert!(table.contains(line), "{line} in\n{table}");
    }
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let (results, csv) = (read("results.json"), read("results.csv"));
    let cells = serde_json::from_str::<serde_json::Value>(&results).unwrap()["cells"].as_array().unwrap().len();
    assert_eq!(cells, 2 + 2 * 6, "two scenes, and six scales under two rules");
    assert_eq!(csv.lines().count(), 1 + cells);
    assert!(out.join("scenes/texture-lies.16.0/cameras.npz").is_file(), "the scene is there to be looked at");
    // A stored cell is used as it is, a deleted one is computed again with the same result.
    std::fs::remove_file(out.join("cells/texture-lies.4.0.hull.json")).unwrap();
    let again = stress();
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(said.contains("cells: 13 of 14 are kept; what is missing takes about"), "{said}");
    succeeds(&again);
    assert_eq!(read("results.json"), results);
    // A scene that was deleted is rendered again, to the same bytes: its cell is kept.
    let cell = || std::fs::metadata(out.join("cells/texture-lies.16.0.hull.json")).unwrap().modified().unwrap();
    let before = cell();
    std::fs::remove_dir_all(out.join("scenes/texture-lies.16.0")).unwrap();
    succeeds(&stress());
    assert_eq!((read("results.json"), cell()), (results, before));
    // A cell of another program is computed again, and says which.
    let path = out.join("cells/gradient-scale.1.0.scale-free.json");
    let older = std::fs::read_to_string(&path).unwrap().replace("\"program\": \"dvr", "\"program\": \"older dvr");
    std::fs::write(&path, older).unwrap();
    let again = stress();
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(
        said.contains("13 of 14 are kept; made again: gradient-scale.1.0.scale-free (of another program)"),
        "{said}"
    );
    assert!(!succeeds(&again).contains("older dvr") && !read("results.csv").contains("older dvr"));

    std::fs::write(out.join("cells/texture-lies.4.0.hull.json"), "{").unwrap();
    refuses(&stress(), &["texture-lies.4.0.hull.json is damaged"]);
}

#[test]
fn rivals_are_tested_where_a_method_fails() {
    let tiny = Tiny::new();
    let out = tiny.path("stress");
    let stress = |against: &str| {
        let variant = "quick:steps=20,capacity={\"cells\":32}";
        let args = ["stress", "--axis", "mask-grown,texture-lies", "--methods", "hull", "--variant", variant];
        dvr(&[&args[..], &["--against", against, "--out", text(&out)]].concat())
    };
    refuses(&stress("nobody"), &["nobody", "--methods"]);
    assert!(!out.exists(), "refused before anything was written");
    let table = succeeds(&stress("hull"));
    let rivals = || std::fs::read_dir(out.join("cells")).unwrap().flatten().map(|entry| entry.file_name());
    let rivals: Vec<_> = rivals().filter(|name| name.to_string_lossy().contains("quick")).collect();
    assert_eq!(rivals, ["mask-grown.1.0.quick.json"], "{table}");
    let row = table.lines().find(|line| line.starts_with("| mask-grown")).unwrap();
    assert!(row.contains("| at once |") && !row.contains("or before"), "{row}");
}

#[test]
fn a_list_whose_reader_has_gone_ends_quietly() {
    for arguments in [&["stress", "--list"][..], &["devices"]] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_dvr")).args(arguments).stdout(writer).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[test]
fn axes_are_listed_and_unknown_ones_refused() {
    let listed = succeeds(&dvr(&["stress", "--list"]));
    for axis in ["rod-radius (shape)", "camera-rotation (cameras)", "4, 2, 1, 0.5, 0.25, 0.1 pixels"] {
        assert!(listed.contains(axis), "{axis} in\n{listed}");
    }
    assert_eq!(succeeds(&dvr(&["stress", "--list", "--axis", "masks"])).matches("(masks)").count(), 5);
    refuses(&dvr(&["stress", "--out", "nowhere", "--axis", "no-such"]), &["no-such", "--list"]);
}
