//! The training object with the most similar picture: the baseline that remembers.

use dvr_core::Split;
use dvr_core::dataset::ObjectDataset;
use dvr_core::record::Digest;
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Side of the pictures that are compared, pixels: 44 000 objects with 24 pictures each take 800 MB.
const SIZE: u32 = 16;

/// All pictures of all training objects, small.
pub struct NearestPicture {
    /// The object of each picture.
    owner: Vec<usize>,
    /// Bytes of each picture, sRGB.
    pictures: Vec<Vec<u8>>,
}

impl NearestPicture {
    /// Reads the pictures of all training objects; `progress` hears how many are done, `problem` of those left out.
    ///
    /// # Errors
    /// When no picture can be read.
    pub fn read(
        dataset: &ObjectDataset,
        progress: impl Fn(usize) + Sync,
        mut problem: impl FnMut(usize, String),
    ) -> Result<Self> {
        let objects = dataset.of_split(Split::Train);
        let done = std::sync::atomic::AtomicUsize::new(0);
        let read: Vec<dvr_core::Result<Vec<Vec<u8>>>> = objects
            .par_iter()
            .map(|&object| {
                let inputs = 0..dataset.inputs(object)?;
                let pictures =
                    inputs.map(|input| Ok(dataset.read_input(object, input, SIZE)?.image.into_raw())).collect();
                progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1);
                pictures
            })
            .collect();
        let (mut owner, mut pictures) = (Vec::new(), Vec::new());
        for (&object, read) in objects.iter().zip(read) {
            match read {
                Ok(read) => {
                    owner.resize(owner.len() + read.len(), object);
                    pictures.extend(read);
                }
                Err(error) => problem(object, error.to_string()),
            }
        }
        if pictures.is_empty() {
            return Err(nothing_to_compare(dataset));
        }
        Ok(Self { owner, pictures })
    }

    /// The digest of all pictures and of whose they are.
    pub fn digest(&self) -> Digest {
        let owner: Vec<u8> = self.owner.iter().flat_map(|owner| owner.to_le_bytes()).collect();
        let pictures = self.pictures.iter().map(|picture| Digest::of_bytes(picture));
        Digest::of_all(&pictures.chain([Digest::of_bytes(&owner)]).collect::<Vec<_>>())
    }

    /// The training object with the picture nearest to that of `object`, by the squared difference of pixels.
    ///
    /// # Errors
    /// Where the object's picture cannot be read.
    pub fn find(&self, dataset: &ObjectDataset, object: usize, input: usize) -> Result<usize> {
        let picture = dataset.read_input(object, input, SIZE)?.image.into_raw();
        let distance = |other: &Vec<u8>| -> u64 {
            picture.iter().zip(other).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2)).sum()
        };
        let nearest = (0..self.pictures.len()).min_by_key(|&i| distance(&self.pictures[i]));
        nearest.map(|i| self.owner[i]).ok_or_else(|| nothing_to_compare(dataset))
    }
}

fn nothing_to_compare(dataset: &ObjectDataset) -> Error {
    Error::NothingToCompare { dataset: dataset.root().to_owned(), what: "pictures to compare with" }
}
