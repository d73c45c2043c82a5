//! Leaves the commit in `DVR_COMMIT`, so that results can name what made them.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rustc-env=DVR_COMMIT={}", commit().unwrap_or_else(|| "unknown".into()));
    for file in ["HEAD", "index", "logs/HEAD"] {
        println!("cargo::rerun-if-changed=../.git/{file}");
    }
    // A change that is not committed makes the build a dirty one, wherever in the workspace it is.
    for folder in Path::new("..").read_dir().into_iter().flatten().flatten() {
        if folder.path().join("Cargo.toml").is_file() {
            println!("cargo::rerun-if-changed={}", folder.path().display());
        }
    }
    for file in ["Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed=../{file}");
    }
}

/// The commit, with `-dirty` where something that is compiled differs from it. Texts are not.
fn commit() -> Option<String> {
    let git = |arguments: &[&str]| Command::new("git").arg("--no-optional-locks").args(arguments).output().ok();
    let described = git(&["rev-parse", "--short=9", "HEAD"]).filter(|output| output.status.success())?;
    let commit = String::from_utf8(described.stdout).ok()?.trim().to_owned();
    let code = ["diff", "--quiet", "HEAD", "--", ":/", ":(top,exclude)docs", ":(top,exclude)*.md"];
    let is_clean = git(&code).is_some_and(|output| output.status.success());
    Some(if is_clean { commit } else { commit + "-dirty" })
}
