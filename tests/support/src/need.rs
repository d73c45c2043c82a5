//! Files of the repository that tests compare with, and what a machine may lack.

use std::fmt::Display;
use std::path::{Path, PathBuf};

#[path = "../../needs/src/present.rs"]
mod present;

/// A file of arrays that DVR's reference code computed, of `tests/fixtures`.
#[track_caller]
pub fn fixture(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("fixtures").join(name);
    assert!(path.is_file(), "tests/fixtures has no {name}");
    path
}

/// A fixture that is too large for the repository, of the folder `DVR_LARGE_FIXTURES`.
#[track_caller]
pub fn large_fixture(name: &str) -> PathBuf {
    needed(present::below(present::LARGE_FIXTURES, name))
}

/// A scene that is not in the repository, or a part of one: a path below the folder `DVR_SCENES`.
#[track_caller]
pub fn scene(part: &str) -> PathBuf {
    needed(present::below(present::SCENES, part))
}

/// An opened GPU.
#[track_caller]
pub fn gpu<T, E: Display>(opened: Result<T, E>) -> T {
    needed(opened.map_err(|why| {
        let driver = if present::gpu_driver().is_ok() { "; VK_DRIVER_FILES= ignores the tests on a GPU" } else { "" };
        format!("{why}{driver}")
    }))
}

/// A program, as `colmap` and `ffmpeg` are.
#[track_caller]
pub fn program(name: &str) -> PathBuf {
    needed(present::program(name))
}

/// The program of a Chromium.
#[track_caller]
pub fn browser() -> PathBuf {
    needed(present::browser())
}

/// That a test may mount a disk of its own.
#[track_caller]
pub fn mounts() {
    needed(present::mounts());
}

/// That the system tells what threads wait for.
#[track_caller]
pub fn wait_channels() {
    needed(present::wait_channels());
}

/// What a test needs: `test_with` ignores the test without it, but for what `DVR_REQUIRE` lists.
#[track_caller]
fn needed<T>(found: Result<T, String>) -> T {
    found.unwrap_or_else(|why| panic!("{why}"))
}
