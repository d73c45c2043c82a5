//! Damaged files for every reader: what comes out must be a value or an error, in bounded time and memory.
//!
//! [`READERS`] lists the doors by which files come in. Each has small sound files to start from ([`Reader::seeds`]) and
//! says how its files are built ([`Anatomy`]), so that damage is done behind checksums and compression too. An input
//! follows from the reader, a seed and a number ([`input`]): what is found can be made again.
//!
//! [`worker`] reads inputs in a process that may die of them; [`campaign`] drives such processes and keeps what they
//! find. The program `fuzz-readers` is both; `fuzz/` has the same readers for `cargo fuzz`.

pub mod campaign;
mod claims;
mod containers;
mod mutation;
mod parts;
mod readers;
mod seeds;
pub mod worker;

use std::path::Path;

use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub use claims::claims;
pub use readers::READERS;

/// The most bytes that a reader may have allocated at any time.
pub const MEMORY_LIMIT: usize = 1 << 30;

/// The most seconds that a reader may take for an input.
pub const SECONDS_LIMIT: f64 = 10.0;

/// The longest input that is made by mutation.
const LONGEST: usize = 1 << 16;

/// How files are built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anatomy {
    /// Bytes, without checksums.
    Bytes,
    /// Lines of words.
    Text,
    /// PNG: chunks with checksums, the pixels deflated.
    Png,
    /// A zip archive.
    Zip,
    /// A header of so many bytes, the length of what follows, and the CRC-32 of all but itself.
    Checked(usize),
    /// Safetensors: the length of a JSON header, the header, and bytes.
    Safetensors,
    /// Binary glTF: a JSON chunk, then bytes.
    Glb,
    /// Several files, see `parts`.
    Parts,
}

/// A door by which files come in.
pub struct Reader {
    /// What it is called on the command line.
    pub name: &'static str,
    /// How its files are built.
    pub anatomy: Anatomy,
    /// Sound files to start from.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Puts what lies beside the files into an empty folder.
    pub prepare: fn(&Path),
    /// Reads a file's bytes, in such a folder; whether they were read without an error.
    pub read: fn(&Path, &[u8]) -> bool,
}

/// The reader of a name.
pub fn reader(name: &str) -> Option<&'static Reader> {
    READERS.iter().find(|reader| reader.name == name)
}

/// The input of a number: the seeds themselves first, then what is made of them.
pub fn input(reader: &Reader, seeds: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
    if let Some(sound) = usize::try_from(number).ok().and_then(|number| seeds.get(number)) {
        return sound.clone();
    }
    let name = reader.name.bytes().fold(seed, |hash, byte| hash.wrapping_mul(0x0100_0000_01b3) ^ u64::from(byte));
    let mut rng = ChaCha8Rng::seed_from_u64(name.wrapping_add(number.wrapping_mul(0x9e37_79b9_7f4a_7c15)));
    let base = &seeds[rng.random_range(0..seeds.len())];
    of(reader, base, seeds, &mut rng)
}

/// A file of a reader with damage that follows from a seed.
pub fn damaged(reader: &Reader, base: &[u8], seeds: &[Vec<u8>], seed: u64) -> Vec<u8> {
    of(reader, base, seeds, &mut ChaCha8Rng::seed_from_u64(seed))
}

fn of(reader: &Reader, base: &[u8], seeds: &[Vec<u8>], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let other = &seeds[rng.random_range(0..seeds.len())];
    let mut bytes = containers::damaged(reader.anatomy, base, other, rng);
    bytes.truncate(LONGEST);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_is_read_and_an_input_follows_from_its_number() {
        for reader in READERS {
            let folder = tempfile::tempdir().unwrap();
            (reader.prepare)(folder.path());
            let seeds = (reader.seeds)();
            for (i, seed) in seeds.iter().enumerate() {
                assert!((reader.read)(folder.path(), seed), "seed {i} of {} is refused", reader.name);
                assert!(seed.len() <= LONGEST, "seed {i} of {} has {} bytes", reader.name, seed.len());
            }
            let inputs: Vec<Vec<u8>> = (0..50).map(|number| input(reader, &seeds, 1, number)).collect();
            assert!(
                (0..50).all(|number| input(reader, &seeds, 1, number) == inputs[number as usize]),
                "{}",
                reader.name
            );
            assert!(inputs[seeds.len()..].iter().any(|input| !seeds.contains(input)), "{} stays sound", reader.name);
        }
    }
}
