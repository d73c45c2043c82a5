//! What this machine has. Both the attribute, while a test is compiled, and the test itself ask here.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of scenes that are not in the repository.
pub const SCENES: &str = "DVR_SCENES";

/// The folder of fixtures that are too large for the repository.
pub const LARGE_FIXTURES: &str = "DVR_LARGE_FIXTURES";

/// What the Vulkan loader reads instead of its own folders.
pub const DRIVER_FILES: [&str; 2] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];

/// The path of `part` below the folder that a variable names, or what is missing.
pub fn below(variable: &str, part: &str) -> Result<PathBuf, String> {
    let folder = env::var_os(variable).filter(|folder| !folder.is_empty());
    let path = PathBuf::from(folder.ok_or_else(|| format!("{variable} is not set"))?).join(part);
    if path.exists() { Ok(path) } else { Err(format!("{variable} has no {part}")) }
}

/// The program of a Chromium, by the folders of `PATH`.
pub fn browser() -> Result<PathBuf, String> {
    let paths = env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let mut programs = env::split_paths(&paths).flat_map(|folder| names.map(|name| folder.join(name)));
    programs.find(|path| path.is_file()).ok_or_else(|| "there is no chromium or chrome in PATH".into())
}

/// A program in one of the folders of `PATH`.
pub fn program(name: &str) -> Result<PathBuf, String> {
    let paths = env::var_os("PATH").unwrap_or_default();
    let mut programs = env::split_paths(&paths).map(|folder| folder.join(name));
    programs.find(|path| path.is_file()).ok_or_else(|| format!("there is no {name} in PATH"))
}

/// Whether a test may mount a disk of its own: in a namespace of its own, which Linux allows to users in most places.
pub fn mounts() -> Result<(), String> {
    let mount = ["--user", "--map-root-user", "--mount", "mount", "-t", "tmpfs", "tmpfs", "/tmp"];
    let mounted = Command::new("unshare").args(mount).output();
    let enters = Command::new("nsenter").arg("--version").output();
    let is_allowed = |output: std::io::Result<std::process::Output>| output.is_ok_and(|output| output.status.success());
    if is_allowed(mounted) && is_allowed(enters) { Ok(()) } else { Err("no disk can be mounted by a test".into()) }
}

/// Whether a driver for GPUs is installed. Beyond Linux, every system comes with one.
pub fn gpu_driver() -> Result<(), String> {
    let is_installed = match DRIVER_FILES.iter().find_map(env::var_os) {
        Some(files) => env::split_paths(&files).any(|file| file.is_file()),
        None => !cfg!(target_os = "linux") || driver_folders().iter().any(|folder| has_driver(folder)),
    };
    if is_installed { Ok(()) } else { Err("no Vulkan driver is installed".into()) }
}

/// Where the Vulkan loader looks for drivers on Linux.
fn driver_folders() -> Vec<PathBuf> {
    let home = env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/share"));
    let shared = env::var_os("XDG_DATA_DIRS").unwrap_or_else(|| "/usr/local/share:/usr/share".into());
    let roots = home.into_iter().chain(env::split_paths(&shared)).chain(["/etc".into()]);
    roots.map(|root| root.join("vulkan/icd.d")).collect()
}

fn has_driver(folder: &Path) -> bool {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    entries.into_iter().any(|entry| entry.path().extension() == Some(OsStr::new("json")))
}

/// Whether the system tells in `/proc` what a thread waits for (proc(5): `wchan`).
pub fn wait_channels() -> Result<(), String> {
    // A thread that waits for another, as this one does for it.
    let (sender, receiver) = std::sync::mpsc::channel::<()>();
    let waiting = std::thread::spawn(move || receiver.recv().is_ok());
    std::thread::sleep(std::time::Duration::from_millis(200));
    let told = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten().any(|thread| {
        std::fs::read_to_string(thread.path().join("wchan")).is_ok_and(|waits_in| waits_in.starts_with("futex"))
    });
    drop(sender);
    let _ = waiting.join();
    if told { Ok(()) } else { Err("/proc does not tell what threads wait for".into()) }
}
