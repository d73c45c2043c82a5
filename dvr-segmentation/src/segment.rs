//! The whole: from photographs to masks.

use std::sync::atomic::{AtomicUsize, Ordering};

use dvr_core::{Cancellation, Mask, Split, View, signed_distance};
use glam::Vec3;
use rayon::prelude::*;

use crate::HALF;
use crate::all_views::of_all_views;
use crate::color_model::{ColorCounts, ColorModel, MAX_RATIO, ObjectColors};
use crate::error::SegmentationError;
use crate::evidence::Evidence;
use crate::outline::{Edges, OUTLINE, drawn};
use crate::parts::join_parts;
use crate::radiance::LEVELS;
use crate::second_way::{Believed, SecondWay};
use crate::shrunk::{FINAL_SIZE, Shrunk, WORKING_SIZE};
use crate::support_colors::SupportColors;
use crate::support_plane::{LYING, SupportPlane};
use crate::volume::{Cube, Round, Volume};
use crate::within_cube::within_cube;

/// The rounds. At first masks are rough, and more views may be wrong about a place: a part that is lost then does not come
/// back, while what is too much still looks like background.
pub(crate) const ROUNDS: [Round; 5] = {
    let (rough, fine) = (Round { nodes: 65, disagreeing: 0.16 }, Round { nodes: 97, disagreeing: 0.08 });
    [rough, rough, fine, fine, fine]
};

/// From this round on only the cube around what was found is looked at.
const CLOSER: usize = 2;

/// How much a pixel counts whose depth is known.
const DEPTH: f32 = 3.0;

/// What a pixel costs of which nothing is known: little, so that plain parts of the object go with what surrounds them.
const UNKNOWN: f32 = 0.05;

/// How much the volume counts.
#[derive(Clone, Copy)]
struct Trust {
    /// Most that it counts.
    most: f32,
    /// The distance to its outline from which it counts so much, working pixels. What is further away than [`DECIDED`] times as
    /// much is decided by it alone.
    reach: f32,
}

/// In each round, and in the end: all views have agreed about it then, and colours fray outlines where the object looks like
/// what is behind it.
const GROWING: Trust = Trust { most: 1.5, reach: 6.0 };
const FINAL: Trust = Trust { most: 2.5, reach: 3.0 };

const DECIDED: f32 = 2.0;

/// Nearer to an outline than this, working pixels, depths say nothing, since windows see both sides; from there on, over
/// that many pixels, more and more.
const BLURRED: f32 = 2.0;
const SHARPER: f32 = 4.0;

/// How far from the outline background counts, working pixels, and how much all of it does.
const RING: f32 = 15.0;
const ALL: f32 = 0.1;

/// Steps of the solver: at first, in each round, and in the end.
const STEPS: [usize; 3] = [400, 100, 60];

/// Views that are needed.
const LEAST_VIEWS: usize = 4;

/// What masks are to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The object that stands out; where none does, as [`Cube`](Self::Cube).
    Auto,
    /// The object that stands out, and nothing else.
    Object,
    /// What is learned of the object together with the background, and nothing else.
    Learned,
    /// All that lies in a cube around what is in the middles of pictures.
    Cube,
}

/// What masks show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// An object that stands out of what is around it.
    Object,
    /// All that lies in a cube around what is in the middles of pictures: no object stands out.
    Cube,
}

/// Masks that were found.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// One mask for each view, as large as its picture.
    pub masks: Vec<Mask>,
    /// What they show.
    pub shown: Shown,
    /// What the object stands on, where that was found, in the space of the views. It is not part of the object.
    pub support: Option<SupportPlane>,
    /// Whether a field in which object and background were learned together had a say in masks.
    pub is_learned: bool,
}

/// Finds the object in all views: what they agree about in the cube [-0.5, 0.5]^3 that all cameras look at. Views for testing
/// have no say in it; their masks follow from what the others found.
///
/// `progress` is told how many parts of the work are done, and of how many.
///
/// Depths of pixels come from a plane sweep; the plane that the object stands on from them. Then, in turns: how frequent
/// colours are in the object and around it, and what the plane looks like where nothing stands on it; the outline in each
/// picture that agrees best with colours, depths and volume and follows its edges; and the volume that the outlines of all
/// views agree about. Then object and background are learned together as a field of opacity and colour, and what that has in
/// the cube, before the plane, is compared. Where it is by and large the same, it decides where both differ by more than a rim:
/// it is nearer to the truth between legs and where the object has the background's colours. Where it is not, and the plane's
/// colours, place by place, speak for it, outlines are found again from it. Where no object stands out, masks show all that lies
/// in a cube around what is in the middles of pictures.
///
/// # Errors
/// [`SegmentationError`]: too few views, nothing that they agree about, or somebody wanted it to end.
pub fn segment(
    views: &[View],
    wanted: Wanted,
    cancellation: &Cancellation,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Segmentation, SegmentationError> {
    let asked: Vec<bool> = views.iter().map(|view| view.split != Split::Test).collect();
    let found = asked.iter().filter(|&&asked| asked).count();
    if found < LEAST_VIEWS {
        return Err(SegmentationError::TooFewViews { found, least: LEAST_VIEWS });
    }
    // A view's part of a round is about a third of its depths, and a half of that of a level. Masks are drawn up to three times.
    let parts = (3 + ROUNDS.len() + 2 * LEVELS.len() + ROUNDS[CLOSER..].len() + 3) * views.len();
    let done = AtomicUsize::new(0);
    let advance = |more: usize| progress(done.fetch_add(more, Ordering::Relaxed) + more, parts);
    let small: Vec<Shrunk> = views.par_iter().map(|view| Shrunk::new(view, WORKING_SIZE)).collect();
    if wanted != Wanted::Cube {
        match object(views, &small, &asked, wanted, cancellation, &advance) {
            Err(SegmentationError::NothingFound) if wanted == Wanted::Auto => {}
            found => {
                // What is learned is given up as soon as it differs too much.
                let left = parts - done.load(Ordering::Relaxed).min(parts);
                advance(left);
                return found;
            }
        }
    }
    // Depths and outlines of each view are what is left.
    let (before, cube_done) = (done.into_inner(), AtomicUsize::new(0));
    let advance = || {
        let done = cube_done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(before + (parts - before) * done / (2 * views.len()), parts);
    };
    let masks = within_cube(views, &small, &asked, cancellation, &advance)?.ok_or(SegmentationError::NothingFound)?;
    Ok(Segmentation { masks, shown: Shown::Cube, support: None, is_learned: false })
}

/// The object, where one stands out.
fn object(
    views: &[View],
    small: &[Shrunk],
    asked: &[bool],
    wanted: Wanted,
    cancellation: &Cancellation,
    advance: &(dyn Fn(usize) + Sync),
) -> Result<Segmentation, SegmentationError> {
    let evidence = Evidence::of(small, asked, cancellation, &|| advance(3))?;
    let support = evidence.support;
    let segmentation = |masks, is_learned| Segmentation { masks, shown: Shown::Object, support, is_learned };
    let second = SecondWay { views, small, asked, evidence: &evidence, cancellation, advance };
    if wanted == Wanted::Learned {
        return second.alone()?.map(|masks| segmentation(masks, true)).ok_or(SegmentationError::NothingFound);
    }
    let mut work = Work::new(small, asked, &evidence);
    for round in ROUNDS {
        work.round(round, cancellation)?;
        advance(views.len());
    }
    let masks = of_all_views(views.len(), cancellation, advance, |i| work.mask(i, &views[i]))?;
    Ok(match second.beside(&masks)? {
        Believed::First => segmentation(masks, false),
        Believed::Both(masks) => segmentation(masks, true),
        Believed::Second(learned) => segmentation(again(&mut work, learned, views, cancellation, advance)?, true),
    })
}

/// Outlines found again from masks that are right by and large: they are finer by colours, and object and plane are told by the
/// right ones then. The masks themselves where views agree about nothing.
fn again(
    work: &mut Work,
    masks: Vec<Mask>,
    views: &[View],
    cancellation: &Cancellation,
    advance: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Mask>, SegmentationError> {
    work.start_again(&masks);
    for round in &ROUNDS[CLOSER..] {
        match work.round(*round, cancellation) {
            Err(SegmentationError::NothingFound) => return Ok(masks),
            ended => ended?,
        }
        advance(views.len());
    }
    Ok(of_all_views(views.len(), cancellation, advance, |i| work.mask(i, &views[i]))?)
}

/// What is known at a time.
struct Work<'a> {
    views: &'a [Shrunk],
    asked: &'a [bool],
    evidence: &'a Evidence,
    edges: Vec<Edges>,
    /// Per view and pixel, from 0 to 1, how much it belongs to the object.
    belongs: Vec<Vec<f32>>,
    colors: Vec<ColorModel>,
    /// Where the plane is seen that the object stands on: what it looks like, and the object.
    support: Option<(SupportColors, ObjectColors)>,
    volume: Option<Volume>,
    rounds: usize,
}

impl<'a> Work<'a> {
    /// By depths alone. Where they say nothing, a pixel goes with what surrounds it, up to the picture's edges.
    fn new(views: &'a [Shrunk], asked: &'a [bool], evidence: &'a Evidence) -> Self {
        let edges: Vec<Edges> = views.par_iter().map(|view| Edges::new(view, OUTLINE)).collect();
        let by_depth = |(edges, says): (&Edges, &Vec<f32>)| {
            let price: Vec<f32> = says.iter().map(|says| UNKNOWN - DEPTH * says).collect();
            edges.cut(&price, says.iter().map(|says| 0.5 + 0.5 * says).collect(), STEPS[0])
        };
        let belongs = edges.par_iter().zip(&evidence.says).map(by_depth).collect();
        Self { views, asked, evidence, edges, belongs, colors: Vec::new(), support: None, volume: None, rounds: 0 }
    }

    /// From these masks, with finer rounds.
    fn start_again(&mut self, masks: &[Mask]) {
        let belongs = |(view, mask): (&Shrunk, &Mask)| {
            view.covered_by(mask).into_iter().map(|is| f32::from(u8::from(is))).collect()
        };
        self.belongs = self.views.par_iter().zip(masks).map(belongs).collect();
        (self.volume, self.rounds) = (None, CLOSER);
    }

    /// Colours, outlines, volume.
    fn round(&mut self, round: Round, cancellation: &Cancellation) -> Result<(), SegmentationError> {
        cancellation.check()?;
        let views = self.views;
        // Distance of each pixel to the outline of the volume, where there is one.
        let distances: Option<Vec<Vec<f32>>> = self
            .volume
            .as_ref()
            .map(|volume| views.par_iter().map(|view| signed_distance(&volume.silhouette(view), view.width)).collect());
        let distances = distances.as_ref();
        self.learn_colors(distances, cancellation)?;
        cancellation.check()?;
        let outline = |i: usize| {
            let distance = distances.map(|distances| &distances[i]);
            let price: Vec<f32> = (0..views[i].len())
                .map(|pixel| {
                    let color = self.color_says(i, &views[i], pixel);
                    let distance = distance.map(|distance| distance[pixel]);
                    -color - shape_and_depth(distance, self.evidence.says[i][pixel], GROWING)
                })
                .collect();
            let mut cut = self.edges[i].cut(&price, self.belongs[i].clone(), STEPS[1]);
            if let Some(distance) = distance {
                join_parts(&mut cut, |pixel| distance[pixel] > 0.0, views[i].width);
            }
            cut
        };
        self.belongs = (0..views.len()).into_par_iter().map(outline).collect();
        cancellation.check()?;
        let closer = self.volume.as_ref().filter(|_| self.rounds >= CLOSER).and_then(Volume::cube_around);
        let cube = closer.unwrap_or(Cube { origin: Vec3::ZERO, half: HALF });
        let support = self.evidence.support;
        let is_allowed =
            |point: Vec3| point.abs().max_element() < HALF && support.is_none_or(|plane| plane.distance(point) > LYING);
        let volume = Volume::agreed(&self.asked(), cube, round, is_allowed, cancellation)?;
        if volume.is_empty() {
            return Err(SegmentationError::NothingFound);
        }
        self.volume = Some(volume);
        self.rounds += 1;
        Ok(())
    }

    /// Colour models by what belongs to the object now, and mostly of what is near it.
    fn learn_colors(
        &mut self,
        distances: Option<&Vec<Vec<f32>>>,
        cancellation: &Cancellation,
    ) -> Result<(), SegmentationError> {
        let views = self.views;
        let near: Vec<Vec<f32>> = (0..views.len())
            .map(|i| match distances {
                Some(distances) => distances[i].iter().map(|d| ALL + (d.min(0.0) / RING).exp()).collect(),
                None => vec![1.0; views[i].len()],
            })
            .collect();
        let of_view = |i: usize| ColorCounts::of(&views[i], &self.belongs[i], &near[i]);
        let counts: Vec<[ColorCounts; 2]> = (0..views.len()).into_par_iter().map(of_view).collect();
        let mut all = [ColorCounts::none(), ColorCounts::none()];
        for (counts, _) in counts.iter().zip(self.asked).filter(|(_, asked)| **asked) {
            all.iter_mut().zip(counts).for_each(|(sum, counts)| sum.join(counts, 1.0));
        }
        let model = |i: usize| ColorModel::new(&views[i], &self.belongs[i], &near[i], &counts[i], &all);
        self.colors = (0..views.len()).into_par_iter().map(model).collect();
        // The first round may take plain parts of the object for the plane.
        if let Some(plane) = self.evidence.support.filter(|_| self.rounds > 0) {
            self.support = Some((SupportColors::new(plane, &self.asked(), cancellation)?, ObjectColors::new(&all[0])));
        }
        Ok(())
    }

    /// The views that have a say, with how much each of their pixels belongs to the object.
    fn asked(&self) -> Vec<(&'a Shrunk, &[f32])> {
        (self.views.iter().zip(&self.belongs).zip(self.asked))
            .filter_map(|((view, belongs), asked)| asked.then_some((view, belongs.as_slice())))
            .collect()
    }

    /// How much the colour of a pixel says that it is the object's, by what is frequent around, and by what the plane looks like
    /// where it is seen; `picture` is a view in any size.
    fn color_says(&self, view: usize, picture: &Shrunk, pixel: usize) -> f32 {
        let (place, color) = (picture.middle(pixel), picture.colors[pixel]);
        let scale = self.views[view].width as f32 / picture.width as f32;
        let around = self.colors[view].says(scale * place, color);
        let support = self.support.as_ref();
        let before_support =
            support.and_then(|(plane, object)| Some(object.says(color, plane.density(&picture.camera, place, color)?)));
        // Where one of the two is wrong, they cancel out, and volume and edges decide.
        (around + before_support.unwrap_or(0.0)).clamp(-MAX_RATIO, MAX_RATIO)
    }

    /// The mask of a view, in finer pixels.
    fn mask(&self, index: usize, view: &View) -> Mask {
        let small = &self.views[index];
        let fine = Shrunk::new(view, FINAL_SIZE);
        let scale = fine.width as f32 / small.width as f32;
        let covered = self.volume.as_ref().map_or_else(Vec::new, |volume| volume.silhouette(&fine));
        let distance = signed_distance(&covered, fine.width);
        let coarse = |pixel: usize| small.pixel_at(fine.middle(pixel) / scale);
        let price: Vec<f32> = (0..fine.len())
            .map(|pixel| {
                let color = self.color_says(index, &fine, pixel);
                let depth = coarse(pixel).map_or(0.0, |pixel| self.evidence.says[index][pixel]);
                -color - shape_and_depth(Some(distance[pixel] / scale), depth, FINAL)
            })
            .collect();
        let start =
            (0..fine.len()).map(|pixel| coarse(pixel).map_or(0.0, |pixel| self.belongs[index][pixel])).collect();
        let mut belongs = Edges::new(&fine, OUTLINE * scale.max(1.0)).cut(&price, start, STEPS[2]);
        join_parts(&mut belongs, |pixel| covered[pixel], fine.width);
        drawn(&belongs, &fine, view)
    }
}

/// What a pixel at this distance from the volume's outline, positive inside, is taken for because of it and of what its depth
/// says; without a volume by depth alone. Working pixels.
fn shape_and_depth(distance: Option<f32>, depth: f32, Trust { most, reach }: Trust) -> f32 {
    let Some(distance) = distance else { return DEPTH * depth };
    let trust = ((distance.abs() - BLURRED) / SHARPER).clamp(0.0, 1.0);
    let reaches = distance / reach;
    let shape = if reaches.abs() > DECIDED { 10.0 * reaches.signum() } else { most * reaches.clamp(-1.0, 1.0) };
    shape + trust * DEPTH * depth
}
