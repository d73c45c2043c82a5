//! Mirror images of objects: further objects to learn from, or the same once more.

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

/// The share of an object's hull whose mirror image lies within a voxel of it, from which on it is the same in the mirror.
const SAME: f64 = 0.95;

/// The share of objects that are the same in the mirror from which on all are taken for their own mirror images.
const SYMMETRIC: f64 = 0.75;

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

    /// The mirror, found where it is still to be found: the one in which training objects are most like their mirror images, if they are
    /// like them.
    pub(crate) fn found(self, likeness: Likeness) -> Self {
        if self != Self::Auto {
            return self;
        }
        // The first of those that are equal.
        let best = MirrorAxis::ALL
            .into_iter()
            .rev()
            .max_by(|a, b| likeness.overlap[a.index()].total_cmp(&likeness.overlap[b.index()]));
        match best.filter(|axis| likeness.overlap[axis.index()] >= ALIKE) {
            Some(MirrorAxis::X) => Self::X,
            Some(MirrorAxis::Y) => Self::Y,
            Some(MirrorAxis::Z) => Self::Z,
            None => Self::Off,
        }
    }
}

/// Whether objects are taken for their own mirror images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Symmetry {
    /// Where the training objects nearly are, and features of places are looked up, so that silhouettes can tell which are not; found
    /// when training begins.
    Auto,
    /// They are not.
    #[default]
    Off,
    /// They are, in the mirror that [`Mirror`] says.
    On,
}

impl Symmetry {
    /// Whether they are, found out where it is still to be found: in the mirror of an axis, if in any.
    pub(crate) fn found(self, axis: Option<MirrorAxis>, likeness: Likeness) -> Self {
        match self {
            Self::Auto if axis.is_some_and(|axis| likeness.symmetric[axis.index()] >= SYMMETRIC) => Self::On,
            Self::Auto => Self::Off,
            given => given,
        }
    }
}

/// How like objects are to their mirror images, by their visual hulls, axis by axis.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Likeness {
    /// The mean intersection over union.
    overlap: [f64; 3],
    /// The share of objects that are nearly the same.
    symmetric: [f64; 3],
}

impl Likeness {
    /// Of training objects, spread evenly over them. Those that cannot be read have no say.
    pub fn of_training(dataset: &ObjectDataset, hulls: &Hulls) -> Self {
        let objects = dataset.of_split(Split::Train);
        let count = objects.len().min(ASKED);
        let asked: Vec<[[f64; 2]; 3]> = (0..count)
            .into_par_iter()
            .filter_map(|i| hulls.of(dataset, objects[i * objects.len() / count]).ok())
            .filter_map(|hull| {
                let [x, y, z] = MirrorAxis::ALL.map(|axis| Some([hull.mirror_iou(axis)?, hull.mirrored_share(axis)?]));
                Some([x?, y?, z?])
            })
            .collect();
        let mean = |of: &dyn Fn([f64; 2]) -> f64| {
            [0, 1, 2].map(|axis| asked.iter().map(|alike| of(alike[axis])).sum::<f64>() / asked.len().max(1) as f64)
        };
        Self {
            overlap: mean(&|[overlap, _]| overlap),
            symmetric: mean(&|[_, share]| f64::from(u8::from(share >= SAME))),
        }
    }
}
