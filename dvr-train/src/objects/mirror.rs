//! Mirror images of objects, as further objects to learn from.

use dvr_core::dataset::ObjectDataset;
use dvr_core::{MirrorAxis, Split};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::hulls::Hulls;

/// Whether objects are learned from as their mirror images too, and in which mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mirror {
    /// In the mirror in which the training objects change least, where they change little; found when training begins.
    Auto,
    /// They are not.
    #[default]
    Off,
    /// In the plane `x = 0`.
    X,
    /// In the plane `y = 0`.
    Y,
    /// In the plane `z = 0`.
    Z,
}

/// Objects that are asked which mirror it is.
const ASKED: usize = 64;

/// The least mean intersection over union of hulls with their mirror images. In a mirror in which objects change more, a front is
/// where others of the same kind have their back.
const ALIKE: f64 = 0.6;

impl Mirror {
    /// The axis that changes its sign; none without a mirror, or before it is found.
    pub fn axis(self) -> Option<MirrorAxis> {
        match self {
            Self::Auto | Self::Off => None,
            Self::X => Some(MirrorAxis::X),
            Self::Y => Some(MirrorAxis::Y),
            Self::Z => Some(MirrorAxis::Z),
        }
    }

    /// Finds the mirror, where it is still to be found: by the visual hulls of training objects, spread evenly over them. Objects
    /// that cannot be read have no say.
    pub(crate) fn found(self, dataset: &ObjectDataset, hulls: &Hulls) -> Self {
        if self != Self::Auto {
            return self;
        }
        let objects = dataset.of_split(Split::Train);
        let count = objects.len().min(ASKED);
        let asked: Vec<[f64; 3]> = (0..count)
            .into_par_iter()
            .filter_map(|i| hulls.of(dataset, objects[i * objects.len() / count]).ok())
            .filter_map(|hull| {
                let [x, y, z] = MirrorAxis::ALL.map(|axis| hull.mirror_iou(axis));
                Some([x?, y?, z?])
            })
            .collect();
        let mean = |axis: MirrorAxis| asked.iter().map(|alike| alike[axis.index()]).sum::<f64>() / asked.len() as f64;
        // The first of those that are equal.
        let best = MirrorAxis::ALL.into_iter().rev().max_by(|a, b| mean(*a).total_cmp(&mean(*b)));
        match best.filter(|axis| mean(*axis) >= ALIKE) {
            Some(MirrorAxis::X) => Self::X,
            Some(MirrorAxis::Y) => Self::Y,
            Some(MirrorAxis::Z) => Self::Z,
            None => Self::Off,
        }
    }
}
