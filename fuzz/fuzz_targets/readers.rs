//! One reader, by the name in `DVR_READER`, with damage as `fuzz-readers` does it:
//!
//! ```sh
//! DVR_READER=png cargo +nightly fuzz run readers -- -rss_limit_mb=1024 -timeout=10
//! ```
#![no_main]

use std::sync::OnceLock;

use dvr_tests::fuzz::{Reader, damaged, reader};
use libfuzzer_sys::{fuzz_mutator, fuzz_target};

/// The reader, its sound files and its folder.
struct Door {
    reader: &'static Reader,
    seeds: Vec<Vec<u8>>,
    folder: scratch::Folder,
}

mod scratch {
    //! A folder for the process, in memory where the system has one.

    use std::path::{Path, PathBuf};

    pub struct Folder(PathBuf);

    impl Folder {
        pub fn new() -> Self {
            let memory = Path::new("/dev/shm");
            let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
            let path = parent.join(format!("dvr-fuzz-{}", std::process::id()));
            std::fs::create_dir_all(&path).expect("the temporary folder can be written");
            Self(path)
        }

        pub fn path(&self) -> &Path {
            &self.0
        }
    }
}

fn door() -> &'static Door {
    static DOOR: OnceLock<Door> = OnceLock::new();
    DOOR.get_or_init(|| {
        let name = std::env::var("DVR_READER").expect("DVR_READER names a reader");
        let reader = reader(&name).expect("DVR_READER names a reader of the list");
        let folder = scratch::Folder::new();
        (reader.prepare)(folder.path());
        Door { reader, seeds: (reader.seeds)(), folder }
    })
}

fuzz_target!(|bytes: &[u8]| {
    let door = door();
    (door.reader.read)(door.folder.path(), bytes);
});

fuzz_mutator!(|bytes: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let door = door();
    let base = if size == 0 { &door.seeds[seed as usize % door.seeds.len()] } else { &bytes[..size].to_vec() };
    let new = damaged(door.reader, base, &door.seeds, u64::from(seed));
    let length = new.len().min(max_size);
    bytes[..length].copy_from_slice(&new[..length]);
    length
});
