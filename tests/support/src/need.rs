//! What a machine may lack: each is given where it is there, else the test is skipped, or fails if it is required.

use std::env;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Where scenes lie unless `DVR_SCENES` says otherwise: beside the checkout.
const SCENES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes");

/// Lists, with commas, what must not be missing.
const REQUIRE: &str = "DVR_REQUIRE";

/// An opened GPU; a software adapter will do.
#[track_caller]
pub fn gpu<T, E: Display>(opened: Result<T, E>) -> Option<T> {
    match opened {
        Ok(gpu) => Some(gpu),
        Err(problem) => skip("gpu", &problem.to_string()),
    }
}

/// A scene, or a part of one: a path below the folder of scenes.
#[track_caller]
pub fn scene(part: &str) -> Option<PathBuf> {
    existing("scenes", scenes().join(part))
}

/// A file of arrays that DVR's reference code computed.
#[track_caller]
pub fn fixture(name: &str) -> Option<PathBuf> {
    existing("fixtures", scenes().join("../fixtures").join(name))
}

/// The program of a Chromium, by the folders of `PATH`.
#[track_caller]
pub fn browser() -> Option<PathBuf> {
    let paths = env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let mut programs = env::split_paths(&paths).flat_map(|folder| names.map(|name| folder.join(name)));
    programs.find(|path| path.is_file()).or_else(|| skip("browser", "there is no chromium or chrome in PATH"))
}

fn scenes() -> PathBuf {
    env::var_os("DVR_SCENES").map_or_else(|| PathBuf::from(SCENES), PathBuf::from)
}

#[track_caller]
fn existing(need: &str, path: PathBuf) -> Option<PathBuf> {
    if path.exists() { Some(path) } else { skip(need, &format!("{} does not exist", shown(&path))) }
}

/// A path without `..` where that is possible.
fn shown(path: &Path) -> String {
    let folder = path.ancestors().find_map(|ancestor| Some((ancestor, ancestor.canonicalize().ok()?)));
    let whole = folder.and_then(|(ancestor, whole)| Some(whole.join(path.strip_prefix(ancestor).ok()?)));
    whole.as_deref().unwrap_or(path).display().to_string()
}

/// Nothing, and why.
#[track_caller]
fn skip<T>(need: &str, why: &str) -> Option<T> {
    let required = env::var(REQUIRE).unwrap_or_default();
    assert!(!is_listed(&required, need), "{REQUIRE} lists {need}: {why}");
    println!("skipped: {why}");
    None
}

fn is_listed(required: &str, need: &str) -> bool {
    required.split(',').any(|name| name.trim() == need)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_required_is_listed_by_its_whole_name() {
        assert!(is_listed("gpu, scenes", "scenes") && is_listed("gpu", "gpu"));
        assert!(!is_listed("", "gpu") && !is_listed("gpus,browser", "gpu"));
    }
}
