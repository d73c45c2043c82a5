//! Disks that are full or read-only: what a user hears, and what stays.
//!
//! Each test has a disk of its own, a tmpfs in a namespace of its own.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

use crate::support::{SMALL, Tiny, refuses, succeeds, text};
use dvr_tests::{mounts, test_with};

/// A disk that only commands [within](Self::within) its namespace see at its place.
struct Disk {
    /// Keeps the namespace.
    holder: Child,
    place: PathBuf,
}

impl Disk {
    /// Mounts a disk of so many KiB at `place`, which holds a file of the user's.
    fn mounted(place: PathBuf, kib: usize) -> Self {
        mounts();
        std::fs::create_dir(&place).unwrap();
        let script = format!(
            "mount -t tmpfs -o size={kib}k tmpfs \"$0\" && echo 'the user'\\''s' > \"$0/notes.txt\" && echo mounted && exec cat"
        );
        let mut holder = Command::new("unshare")
            .args(["--user", "--map-root-user", "--mount", "sh", "-c", &script, text(&place)])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = String::new();
        BufReader::new(holder.stdout.as_mut().unwrap()).read_line(&mut said).unwrap();
        assert_eq!(said, "mounted\n");
        Self { holder, place }
    }

    /// Carries a command out where the disk is.
    fn within(&self, command: &[&str]) -> Output {
        let namespace = ["--target", &self.holder.id().to_string(), "--user", "--mount", "--preserve-credentials"];
        Command::new("nsenter").args(namespace).args(command).output().unwrap()
    }

    fn dvr(&self, arguments: &[&str]) -> Output {
        self.within(&[&[env!("CARGO_BIN_EXE_dvr")], arguments].concat())
    }

    /// Mounts it again with other options.
    fn remounted(&self, options: &str) {
        let done = self.within(&["mount", "-o", &format!("remount,{options}"), text(&self.place)]);
        assert!(done.status.success(), "{done:?}");
    }

    /// The files of the disk, but for folders, by their paths there.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let root = PathBuf::from(format!("/proc/{}/root{}", self.holder.id(), text(&self.place)));
        let mut files = BTreeMap::new();
        let mut folders = vec![root.clone()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                if entry.is_dir() {
                    folders.push(entry);
                } else {
                    let name = entry.strip_prefix(&root).unwrap().display().to_string();
                    files.insert(name, std::fs::read(entry).unwrap());
                }
            }
        }
        files
    }

    /// Nothing but the user's file and what a run's folder may hold; no temporary file.
    fn is_clean(&self) {
        let files = self.files();
        assert_eq!(files["notes.txt"], b"the user's\n");
        for name in files.keys() {
            assert!(name == "notes.txt" || (name.starts_with("run/") && !name.contains("tmp")), "{name}");
        }
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

#[test_with(mounts)]
fn on_a_full_disk_the_file_is_named_nothing_of_the_users_is_touched_and_the_run_goes_on_with_more_room() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("whole", &["--no-report"]));
    let disk = Disk::mounted(tiny.path("disk"), 4);
    let (scene, run) = (tiny.scene(), disk.place.join("run"));
    let mut train =
        vec!["train", text(&scene), "--out", text(&run), "--steps", "24", "--resolution", "32", "--no-report"];
    train.extend(SMALL);
    let mut refused = Vec::new();
    let mut last = None;
    for kib in [4, 8, 32, 128, 512, 16384] {
        disk.remounted(&format!("size={kib}k"));
        let more: &[&str] = if disk.files().contains_key("run/dvr-folder.json") { &["--resume"] } else { &[] };
        let output = disk.dvr(&[&train[..], more].concat());
        disk.is_clean();
        if output.status.success() {
            last = Some(kib);
            break;
        }
        refuses(&output, &["error: ", "disk/run/", "No space left on device", "help: Make room", "--resume"]);
        refused.push(kib);
    }
    assert!(refused.len() >= 3 && last.is_some(), "refused at {refused:?} KiB");
    for file in ["mesh.ply", "mesh.glb", "preview.png"] {
        let whole = std::fs::read(tiny.path("whole").join(file)).unwrap();
        assert!(disk.files()[&format!("run/{file}")] == whole, "{file}: bit for bit");
    }
}

#[test_with(mounts)]
fn a_read_only_disk_is_said_before_training_and_stays_as_it_is() {
    let tiny = Tiny::new();
    let disk = Disk::mounted(tiny.path("disk"), 16384);
    let (scene, run) = (tiny.scene(), disk.place.join("run"));
    let train = ["train", text(&scene), "--out", text(&run), "--method", "hull", "--resolution", "16"];
    succeeds(&disk.dvr(&train));
    let before = disk.files();
    disk.remounted("ro");
    let other = disk.place.join("other");
    let elsewhere = ["train", text(&scene), "--out", text(&other), "--method", "hull", "--resolution", "16"];
    let mesh = ["mesh", text(&run), "--resolution", "16"];
    for command in [&[&train[..], &["--overwrite"]].concat()[..], &elsewhere, &mesh] {
        let output = disk.dvr(command);
        refuses(&output, &["error: ", "disk/", "Read-only file system", "help: Nothing can be written there"]);
        assert!(!String::from_utf8_lossy(&output.stderr).contains("training ("), "{output:?}");
        assert!(disk.files() == before, "{command:?}");
    }
}
