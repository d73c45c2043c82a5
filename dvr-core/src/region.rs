//! The region of interest: where the object is reconstructed, and what decided that.

use std::fmt;

use crate::hull::Bounds;
use crate::raster::Mask;
use crate::scene::Scene;

/// The hull leaves the region where more of its box than this lies beyond.
const CUT_OFF: f64 = 0.02;

/// Share of a frame's border that shows the object from which the frame cuts it.
const CUT_BY_FRAME: f64 = 0.02;

/// Where the object is, in object space: the box around which the unit cube is laid.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The box.
    pub bounds: Bounds,
    /// The box of the masks' visual hull before anything else cut it; `None` where the masks were not asked.
    pub hull: Option<Bounds>,
    /// What decided it, in the order in which it was asked.
    pub evidence: Vec<RegionEvidence>,
}

/// What says where the object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegionEvidence {
    /// The files promise the unit cube, or name another.
    Files,
    /// The caller, who gave the unit cube.
    Given,
    /// The caller, who gave a box.
    Box,
    /// What all cameras look at.
    Cameras,
    /// The visual hull of the masks.
    Masks,
    /// The sphere of IDR and NeuS files.
    Sphere,
    /// So many sparse points within the masks.
    Points(usize),
}

impl Region {
    /// The unit cube, because of `evidence`.
    pub fn unit_cube(evidence: RegionEvidence) -> Self {
        Self { bounds: Bounds::UNIT_CUBE, hull: None, evidence: vec![evidence] }
    }

    /// The share of the hull's box that lies beyond the region; 0 where the masks were not asked.
    pub fn cut_off(&self) -> f64 {
        let volume = |bounds: &Bounds| bounds.size().element_product();
        self.hull.map_or(0.0, |hull| {
            let kept = hull.intersection(&self.bounds).map_or(0.0, |both| volume(&both));
            1.0 - kept / volume(&hull)
        })
    }
}

impl Default for Region {
    fn default() -> Self {
        Self::unit_cube(RegionEvidence::Files)
    }
}

/// What decided the region, as part of a sentence.
impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, evidence) in self.evidence.iter().enumerate() {
            write!(f, "{}{evidence}", if i == 0 { "" } else { ", cut off by " })?;
        }
        Ok(())
    }
}

impl fmt::Display for RegionEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Files => write!(f, "the files' unit cube"),
            Self::Given => write!(f, "the unit cube that was given"),
            Self::Box => write!(f, "the box that was given"),
            Self::Cameras => write!(f, "what all cameras look at"),
            Self::Masks => write!(f, "the visual hull of the masks"),
            Self::Sphere => write!(f, "the sphere of the cameras' file"),
            Self::Points(count) => write!(f, "{count} sparse points within the masks"),
        }
    }
}

/// Whether the frame cuts what a mask shows.
pub(crate) fn is_cut_by_frame(mask: &Mask) -> bool {
    let (width, height) = mask.size();
    let rows = (0..width).flat_map(|u| [(u, 0), (u, height - 1)]);
    let columns = (0..height).flat_map(|v| [(0, v), (width - 1, v)]);
    let object = rows.chain(columns).filter(|&(u, v)| mask.is_object(u, v)).count();
    object as f64 > CUT_BY_FRAME * 2.0 * f64::from(width + height)
}

impl Scene {
    /// What a user should know of the region of interest, in plain words: where the masks' hull leaves it, and that the
    /// frame cuts the object.
    pub fn region_notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let cut_off = self.region.cut_off();
        if cut_off > CUT_OFF {
            notes.push(format!(
                "{:.0} % of the box of the masks' visual hull lies beyond the region of interest, which is bounded by {}; \
                 nothing is reconstructed there",
                100.0 * cut_off,
                self.region
            ));
        }
        let masks = || self.views.iter().filter_map(|view| view.mask.as_ref());
        let cut = masks().filter(|mask| is_cut_by_frame(mask)).count();
        if cut > 0 {
            notes.push(format!(
                "the frame cuts the object in {cut} of {} views, so masks alone do not bound it everywhere",
                masks().count()
            ));
        }
        notes
    }
}
