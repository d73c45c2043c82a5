//! The mean training shape of a category: the baseline that looks at no picture.

use std::collections::BTreeMap;

use dvr_core::dataset::ObjectDataset;
use dvr_core::mesh::Mesh;
use dvr_core::record::Digest;
use dvr_core::{OccupancySamples, Split};
use dvr_render::extract::ExtractSettings;

use super::voxel_values::{VoxelValues, voxel_of};
use crate::error::{Error, Result};

/// The most voxels along an edge: 100 000 points of an object give three a voxel.
const MOST_VOXELS: usize = 32;

/// Points a voxel that an object should have: the objects of a dataset may all be known at the same points.
const POINTS_A_VOXEL: f64 = 3.0;

/// How often the training objects of each category are inside, over the cube.
///
/// An object's occupancies in `points.npz` are averaged in voxels, and these over the objects. The shape is where the
/// mean exceeds the threshold that gives it the mean volume of the objects: at one half, thin and varied categories
/// would have no shape at all.
pub struct MeanShapes {
    /// The mean minus the threshold.
    categories: BTreeMap<String, VoxelValues>,
}

/// Counts of one category's samples.
struct LossSums {
    voxels: usize,
    inside: Vec<u32>,
    all: Vec<u32>,
}

impl MeanShapes {
    /// Reads the occupancies of all training objects; `progress` hears how many are done, `problem` of those left out.
    ///
    /// # Errors
    /// When no training object has occupancies.
    pub fn read(
        dataset: &ObjectDataset,
        mut progress: impl FnMut(usize),
        mut problem: impl FnMut(usize, String),
    ) -> Result<Self> {
        let mut tallies: BTreeMap<String, LossSums> = BTreeMap::new();
        for (done, object) in dataset.of_split(Split::Train).into_iter().enumerate() {
            match dataset.read_occupancy(object) {
                Ok(Some(samples)) => {
                    let category = dataset.objects()[object].category.clone();
                    tallies.entry(category).or_insert_with(|| LossSums::for_samples(&samples)).add(&samples);
                }
                Ok(None) => problem(object, "there is no points.npz".into()),
                Err(error) => problem(object, error.to_string()),
            }
            progress(done + 1);
        }
        if tallies.is_empty() {
            return Err(Error::NothingToCompare {
                dataset: dataset.root().to_owned(),
                what: "occupancy points (points.npz) to take the mean of",
            });
        }
        let categories = tallies.into_iter().map(|(category, sums)| (category, sums.mean())).collect();
        Ok(Self { categories })
    }

    /// The digest of all of them.
    pub fn digest(&self) -> Digest {
        let category = |(name, mean): (&String, &VoxelValues)| {
            let level: Vec<u8> = mean.values.iter().flat_map(|level| level.to_le_bytes()).collect();
            [Digest::of_bytes(name.as_bytes()), Digest::of_bytes(&level)]
        };
        Digest::of_all(&self.categories.iter().flat_map(category).collect::<Vec<_>>())
    }

    /// The mean shape of a category.
    ///
    /// # Errors
    /// When no training object of it has occupancies.
    pub fn of(&self, category: &str, extraction: &ExtractSettings) -> Result<Mesh> {
        let mean =
            self.categories.get(category).ok_or_else(|| Error::UnknownCategory { category: category.to_owned() })?;
        Ok(mean.surface(extraction))
    }
}

impl LossSums {
    /// As fine as this many samples allow.
    fn for_samples(samples: &OccupancySamples) -> Self {
        let voxels = (samples.points.len() as f64 / POINTS_A_VOXEL).cbrt() as usize;
        let voxels = voxels.clamp(2, MOST_VOXELS);
        Self { voxels, inside: vec![0; voxels.pow(3)], all: vec![0; voxels.pow(3)] }
    }

    fn add(&mut self, samples: &OccupancySamples) {
        for (point, &inside) in samples.points.iter().zip(&samples.inside) {
            if let Some(voxel) = voxel_of(*point, self.voxels) {
                self.all[voxel] += 1;
                self.inside[voxel] += u32::from(inside);
            }
        }
    }

    fn mean(&self) -> VoxelValues {
        let share = |(&inside, &all): (&u32, &u32)| if all == 0 { 0.0 } else { inside as f32 / all as f32 };
        let means: Vec<f32> = self.inside.iter().zip(&self.all).map(share).collect();
        let volume = means.iter().sum::<f32>().round() as usize;
        let mut sorted = means.clone();
        sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        // Between the last voxel that belongs to the shape and the first that does not.
        let at = volume.clamp(1, sorted.len() - 1);
        let threshold = 0.5 * (sorted[at - 1] + sorted[at]);
        VoxelValues { voxels: self.voxels, values: means.into_iter().map(|mean| mean - threshold).collect() }
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::UnitCube;
    use dvr_core::sampling::sample_cube;
    use glam::Vec3;

    use super::*;

    /// The mean of balls.
    fn balls(radii: impl Iterator<Item = f32>) -> VoxelValues {
        let points = sample_cube(UnitCube::default(), 20_000, 1);
        let samples = |radius: f32| OccupancySamples {
            inside: points.iter().map(|point| point.length() < radius).collect(),
            points: points.clone(),
        };
        let mut sums = LossSums::for_samples(&samples(0.0));
        radii.for_each(|radius| sums.add(&samples(radius)));
        sums.mean()
    }

    #[test]
    fn the_mean_of_balls_is_the_ball_of_their_mean_volume() {
        let radii = || (0..21).map(|i| 0.2 + 0.01 * i as f32);
        let mean = balls(radii());
        let expected = (radii().map(|radius| radius.powi(3)).sum::<f32>() / 21.0).cbrt();
        for direction in [Vec3::X, Vec3::NEG_Y, Vec3::ONE.normalize()] {
            assert!(mean.at(direction * (expected - 0.06)) > 0.0 && mean.at(direction * (expected + 0.06)) < 0.0);
        }
    }

    #[test]
    fn a_category_without_volume_has_no_inside() {
        assert!(balls([0.0].into_iter()).values.iter().all(|&level| level <= 0.0));
    }
}
