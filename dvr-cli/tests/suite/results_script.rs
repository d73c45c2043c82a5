//! `scripts/results.sh` with a program that stands for `dvr`: every part, its pages and its marks.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// Folders of all scenes that are not the script's own.
const SCENES: [&str; 10] = [
    "dino_sparse_ring",
    "temple_sparse_ring",
    "nerf_chair",
    "dtu_scan65",
    "dtu_scan24",
    "nerd_head",
    "photoreal/bronze",
    "photoreal/plastic",
    "photoreal/exposure",
    "photoreal/desk_truth",
];

/// A copy of the scripts and the pages, and programs that stand for `dvr`, `cargo` and the scripts that download.
struct Copy {
    folder: TempDir,
}

impl Copy {
    fn new() -> Self {
        let copy = Self { folder: tempfile::tempdir().unwrap() };
        let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for part in ["scripts", "docs", "README.md"] {
            let done = Command::new("cp").arg("-r").arg(repository.join(part)).arg(copy.path("")).status().unwrap();
            assert!(done.success());
        }
        let stub = include_str!("support/stub_dvr.sh");
        copy.program("bin/dvr", stub);
        copy.program("bin/cargo", "#!/bin/sh\necho \"cargo $*\" >> \"$CALLS\"\nprintf '| printed |\\n|---|\\n'\n");
        copy.program("scripts/soak.sh", "#!/bin/sh\necho '| soaked |'\n");
        for script in ["furniture.sh", "furniture_scenes.sh"] {
            let body = "#!/bin/sh\nmkdir -p \"$2/bench\"\necho table > \"$2/bench/table.md\"\necho csv > \"$2/bench/results.csv\"\n";
            copy.program(&format!("scripts/{script}"), if script == "furniture.sh" { "#!/bin/sh\n" } else { body });
        }
        for scene in SCENES {
            std::fs::create_dir_all(copy.path("downloaded").join(scene)).unwrap();
        }
        std::fs::write(copy.path("downloaded/nerd_head/verified_points.npz"), "points").unwrap();
        copy
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn program(&self, name: &str, text: &str) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Runs the script with arguments and variables.
    fn run(&self, arguments: &[&str], variables: &[(&str, &str)]) -> Output {
        let path = format!("{}:{}", self.path("bin").display(), std::env::var("PATH").unwrap());
        let mut command = Command::new("sh");
        command.arg(self.path("scripts/results.sh")).args(arguments).env("PATH", path);
        command.env("DVR", self.path("bin/dvr")).env("CALLS", self.path("calls")).env_remove("DVR_SCENES");
        command.env_remove("DVR_SEEDS");
        command.envs(variables.iter().copied()).output().unwrap()
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_default()
    }
}

fn succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn every_part_fills_the_marks_of_its_page() {
    let copy = Copy::new();
    let (out, scenes) = (copy.path("out"), copy.path("downloaded"));
    let said = succeeds(&copy.run(&["--write", out.to_str().unwrap()], &[("DVR_SCENES", scenes.to_str().unwrap())]));
    assert!(said.contains("dvr 9.9 (abcdef012): about ") && said.contains("== soak: about"), "{said}");
    let pages = std::fs::read_dir(copy.path("docs/results")).unwrap().flatten().map(|entry| entry.path());
    for page in pages.chain([copy.path("README.md")]).filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let text = std::fs::read_to_string(&page).unwrap();
        for (name, rest) in text.split("<!-- results:").skip(1).filter_map(|part| part.split_once(" -->")) {
            // A page may also speak of marks; `insert.awk` refuses one that does not end.
            let Some((block, _)) = rest.split_once(&format!("<!-- /results:{name} -->")) else { continue };
            assert!(!block.contains("made before"), "{}: {name} is the old one", page.display());
            assert_eq!(block.trim(), copy.read(&format!("out/blocks/{name}.md")).trim(), "{}: {name}", page.display());
        }
    }
    let readme = copy.read("README.md");
    assert!(readme.contains("| mug | 3 of 3 | 1.00 | 2.0 (1.0-3.0) | 0.0030 | 0.0020 | 25.00 | 20 |"), "{readme}");
    assert!(!readme.contains("| temple_sparse_ring |"), "the README shows a part");
    let stress = copy.read("docs/results/stress.md");
    assert!(stress.contains("few views ([chart](charts/views.svg))."), "{stress}");
    assert!(stress.contains("dvr stress --out DIR --methods hull,grid --seeds 3"), "the command is there");
    assert_eq!(copy.read("docs/results/renders.csv"), "scene\n");
    assert_eq!(copy.read("docs/results/charts/views.svg"), "svg\n");
    assert!(!copy.read("docs/results/renders.md").contains(out.to_str().unwrap()), "no folder of this machine");

    // The program keeps its rows itself; a dataset that another commit rendered is rendered again.
    let tables = || copy.read("calls").lines().filter(|call| call.starts_with("paper --table shapenet")).count();
    assert_eq!(tables(), 1);
    let object = copy.path("out/furniture/data/chair/one");
    std::fs::create_dir_all(&object).unwrap();
    succeeds(&copy.run(&[out.to_str().unwrap(), "objects"], &[]));
    assert!(object.is_dir());
    succeeds(&copy.run(&[out.to_str().unwrap(), "objects"], &[("STUB_COMMIT", "another")]));
    assert_eq!((tables(), object.is_dir()), (3, false));
}

#[test]
fn photographs_are_measured_as_far_as_they_are_there_in_their_size_and_by_their_points() {
    let copy = Copy::new();
    let (out, scenes) = (copy.path("out"), copy.path("downloaded"));
    let (out, scenes) = (out.to_str().unwrap(), scenes.to_str().unwrap());
    let calls = |seeds: &str| {
        succeeds(&copy.run(&[out, "photographs"], &[("DVR_SCENES", scenes), ("DVR_SEEDS", seeds)]));
        let calls = copy.read("calls");
        std::fs::remove_file(copy.path("calls")).unwrap();
        calls.lines().filter(|call| call.starts_with("bench ")).map(str::to_owned).collect::<Vec<_>>()
    };
    let all = calls("3");
    assert_eq!(all.len(), 3, "whole, half and networks: {all:?}");
    assert!(SCENES.iter().all(|scene| all[0].contains(scene) != (*scene == "nerd_head")), "{}", all[0]);
    assert!(all[0].contains("--seeds 3") && !all[0].contains("--points") && !all[0].contains("--downscale"));
    assert!(all[1].contains("dtu_scan24") && all[1].contains("nerd_head"), "{}", all[1]);
    assert!(all[1].contains("--downscale 2 --points verified_points.npz"), "{}", all[1]);
    let block = copy.read("out/blocks/photographs_half.md");
    assert!(block.contains("| nerd_head | rgb | grid | 3 of 3 |") && !block.contains(scenes), "{block}");

    for scene in &SCENES[1..] {
        std::fs::remove_dir_all(copy.path("downloaded").join(scene)).unwrap();
    }
    let some = calls("1");
    assert_eq!(some.len(), 2, "{some:?}");
    assert!(some[0].contains("dino_sparse_ring --methods hull,grid --seeds 1"), "{}", some[0]);
    // A page has all scenes and three seeds.
    let refused = |seeds: &str| {
        let variables = [("DVR_SCENES", scenes), ("DVR_SEEDS", seeds)];
        let output = copy.run(&["--write", out, "photographs"], &variables);
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(refused("3").contains("photographs needs these scenes"));
    for scene in SCENES {
        std::fs::create_dir_all(copy.path("downloaded").join(scene)).unwrap();
    }
    assert!(refused("1").contains("DVR_SEEDS=1: pages have three seeds"));
}

#[test]
fn parts_are_chosen_and_what_cannot_be_made_is_said() {
    let copy = Copy::new();
    let out = copy.path("out");
    let out = out.to_str().unwrap();
    let list = succeeds(&copy.run(&["--list"], &[]));
    for line in ["demo ", "docs/results/renders.md", "[needs DVR_SCENES with: dino_sparse_ring"] {
        assert!(list.contains(line), "{line} in\n{list}");
    }
    assert!(!copy.path("out").exists() && !copy.path("calls").exists(), "nothing was made");
    // A run that fails is a row of its table and ends nothing.
    let page = copy.read("README.md");
    let said = succeeds(&copy.run(&[out, "demo"], &[("STUB_FAILS", "1")]));
    assert!(said.contains("about 1 minutes for demo"), "{said}");
    assert!(copy.read("out/blocks/readme.md").contains("| mug | 3 of 3 |"));
    assert_eq!(copy.read("README.md"), page, "pages are written with --write alone");
    let refused = |arguments: &[&str], variables: &[(&str, &str)], words: &str| {
        let output = copy.run(arguments, variables);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains(words), "{arguments:?}: {said}");
    };
    refused(&[out, "photographs"], &[], "docs/guide/scenes.md");
    refused(&[out, "nothing"], &[], "there is no part nothing");
    refused(&["--write", out, "demo"], &[("STUB_COMMIT", "abc-dirty")], "commit the changes first");
    refused(&[], &[], "--list");
}
