//! One training step's loss: march without gradient, put the hits on the graph, compare with the pixels.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_render::extract::FieldSurface;
use dvr_render::{
    Crossing, Differentiable, DistinctRows, Field, Hits, March, MarchSettings, Query, RayStatus, Rays, Surface,
    axis_direction,
};
use rand::Rng;

use crate::config::{OccupancyPoint, TrainConfig};
use crate::learners::batch::PixelBatch;
use crate::learners::losses;

/// The terms of one step, each already weighted and divided by the number of rays.
#[derive(Clone, Debug)]
pub struct StepLoss {
    /// Sum of the terms, `[1]`, on the graph.
    pub total: Tensor<1>,
    /// Name and value of each term that took part.
    pub terms: Vec<(&'static str, Tensor<1>)>,
    /// Object pixels hit, of all pixels hit or object: the mask's intersection over union in this batch. Not a number where
    /// nothing is compared so.
    pub mask_iou: f64,
}

impl StepLoss {
    /// The same with another term, where there is one.
    pub(crate) fn with_term(mut self, name: &'static str, term: Option<Tensor<1>>) -> Self {
        if let Some(term) = term {
            self.total = self.total + term.clone();
            self.terms.push((name, term));
        }
        self
    }
}

/// The random numbers of a step, drawn beforehand: the step itself is a pure function.
#[derive(Clone, Debug)]
pub struct StepNoise {
    /// Shift of the samples of each ray, `[0, 1)`; `None` without jitter.
    pub jitter: Option<Vec<f32>>,
    /// Share of its interval at which free space (or random occupancy) is asked for, one a ray, `[0, 1)`.
    pub along: Vec<f32>,
    /// Position of the neighbour of each point of the normal term in its box, `[0, 1)^3`.
    pub neighbor: Vec<[f32; 3]>,
}

impl StepNoise {
    /// Draws the numbers for a batch of `rays` rays.
    pub fn draw(config: &TrainConfig, rays: usize, rng: &mut impl Rng) -> Self {
        Self {
            jitter: config.jitter.then(|| (0..rays).map(|_| rng.random()).collect()),
            along: (0..rays).map(|_| rng.random()).collect(),
            neighbor: (0..config.losses.normal_points.min(rays)).map(|_| rng.random()).collect(),
        }
    }

    /// The numbers of the first `count` rays of those that are left, and as large a share of the neighbours.
    pub(crate) fn take_first(&mut self, count: usize) -> Self {
        let neighbors = self.neighbor.len() * count / self.along.len().max(1);
        Self {
            jitter: self.jitter.as_mut().map(|jitter| jitter.drain(..count).collect()),
            along: self.along.drain(..count).collect(),
            neighbor: self.neighbor.drain(..neighbors).collect(),
        }
    }
}

/// The loss of a batch.
///
/// `frozen` is `field` without gradient tracking (`Module::valid`); `batch` lives on its device.
pub fn step_loss(
    field: &impl Differentiable,
    frozen: &impl Crossing,
    batch: &PixelBatch,
    noise: &StepNoise,
    config: &TrainConfig,
    step: usize,
) -> StepLoss {
    let device = frozen.device();
    let march = search(frozen, batch, noise, march_settings(config, step));
    let roles = Roles::sort(batch, march.as_ref());

    let weights = &config.losses;
    let mut terms = Vec::new();
    let mut add = |name, weight: f64, sum: Tensor<1>| {
        if weight > 0.0 {
            terms.push((name, sum * (weight / batch.len() as f64)));
        }
    };

    if let Some(hits) = march.as_ref().and_then(|march| march.hits.as_ref()) {
        let surface = Surface::on_graph(field, frozen, hits, config.slope);
        surface_terms(&surface, batch, &roles, config, &mut add);
        if !roles.background_hits.is_empty() {
            let background = DistinctRows::new(&roles.background_hits, hits.len(), &device);
            add(
                "free_space",
                weights.free_space,
                losses::free_space(background.gather_column(surface.occupancy_logit)),
            );
        }
        // Of a step that is shared, a part may have no neighbours left.
        if weights.normal > 0.0 && !noise.neighbor.is_empty() {
            add("normal", weights.normal, normal_term(field, hits, noise, config));
        }
    }
    let anywhere = random_depth(batch, &floats(&noise.along, &device));
    if !roles.free.is_empty() && weights.free_space > 0.0 {
        let logit = logits_on_rays(field, batch, &roles.free, anywhere.clone());
        add("free_space_missed", weights.free_space, losses::free_space(logit));
    }
    if !roles.starts_inside.is_empty() && weights.free_space > 0.0 {
        let logit = logits_on_rays(field, batch, &roles.starts_inside, batch.rays.entry.clone());
        add("free_space_entry", weights.free_space, losses::free_space(logit));
    }
    if !roles.missed_object.is_empty() && weights.occupancy > 0.0 {
        let depth = match (config.occupancy_point, &march) {
            (OccupancyPoint::Densest, Some(march)) => {
                let searched = DistinctRows::new(&batch.searched, batch.len(), &device);
                searched.scatter(march.max_logit_depth.clone())
            }
            _ => anywhere,
        };
        let logit = logits_on_rays(field, batch, &roles.missed_object, depth);
        add("occupancy", weights.occupancy, losses::occupancy(logit));
    }

    let zero = || Tensor::from_inner(Tensor::zeros([1], &device));
    let total = terms.iter().map(|(_, term)| term.clone()).reduce(|a, b| a + b).unwrap_or_else(zero);
    StepLoss { total, terms, mask_iou: roles.mask_iou }
}

/// How a step's rays are searched.
fn march_settings(config: &TrainConfig, step: usize) -> MarchSettings {
    MarchSettings {
        steps: config.samples_at(step),
        root: config.root,
        root_steps: config.root_steps,
        ..MarchSettings::default()
    }
}

/// The sparse depth term: L1 between the depths at which rays hit and those at which they are known to end, weighted
/// and divided by their number. `None` where no ray hits.
pub fn sparse_depth_loss(
    field: &impl Field,
    frozen: &impl Crossing,
    rays: &Rays,
    z_depth: &[f32],
    config: &TrainConfig,
    step: usize,
) -> Option<Tensor<1>> {
    let device = frozen.device();
    let hits = FieldSurface::new(frozen).marcher(march_settings(config, step)).march(rays, None).hits?;
    let truth = floats(z_depth, &device).select(0, hits.index.clone());
    let depth = Surface::on_graph(field, frozen, &hits, config.slope).depth;
    let weight = config.losses.sparse_depth / z_depth.len() as f64;
    Some(losses::depth_l1(depth, Tensor::from_inner(truth)) * weight)
}

/// The terms that compare the visible surface with what object pixels show.
fn surface_terms(
    surface: &Surface,
    batch: &PixelBatch,
    roles: &Roles,
    config: &TrainConfig,
    add: &mut impl FnMut(&'static str, f64, Tensor<1>),
) {
    let weights = &config.losses;
    let device = batch.color.device();
    let hits = surface.gradient.dims()[0];
    let truth =
        |rays: &[i64]| -> Tensor<2> { Tensor::from_inner(batch.color.clone().select(0, indices(rays, &device))) };
    if !roles.object_hits.is_empty() {
        let object = DistinctRows::new(&roles.object_hits, hits, &device);
        let color = truth(&roles.object_hit_rays);
        if weights.color > 0.0 {
            add("color", weights.color, losses::color_l1(object.gather(surface.color.clone()), color.clone()));
        }
        if weights.detached_color > 0.0 {
            add(
                "detached_color",
                weights.detached_color,
                losses::color_l1(object.gather(surface.fixed_color.clone()), color),
            );
        }
    }
    if weights.image_gradient > 0.0 && !roles.patch_hits.is_empty() {
        let color = DistinctRows::new(&roles.patch_hits, hits, &device).gather(surface.color.clone());
        let loss = losses::image_gradient(color, truth(&roles.patch_rays), config.patch_size);
        add("image_gradient", weights.image_gradient, loss);
    }
    if weights.depth > 0.0 && !roles.depth_hits.is_empty() {
        let measured = DistinctRows::new(&roles.depth_hits, hits, &device);
        let truth: Vec<f32> = roles.depth_rays.iter().map(|&ray| batch.z_depth[ray as usize]).collect();
        let truth = floats(&truth, &device);
        let loss = if weights.depth_on_points {
            let rays = batch.rays.select(&indices(&roles.depth_rays, &device));
            losses::point_distance(measured.gather(surface.point.clone()), Tensor::from_inner(rays.at(truth)))
        } else {
            losses::depth_l1(measured.gather_column(surface.depth.clone()), Tensor::from_inner(truth))
        };
        add("depth", weights.depth, loss);
    }
}

/// Smoothness at evenly chosen hits, scaled up to all of them.
fn normal_term(field: &impl Differentiable, hits: &Hits, noise: &StepNoise, config: &TrainConfig) -> Tensor<1> {
    let device = hits.depth.device();
    let count = hits.len().min(noise.neighbor.len());
    let chosen: Vec<i64> = (0..count).map(|i| (i * hits.len() / count) as i64).collect();
    let chosen = indices(&chosen, &device);
    let rays = hits.rays.select(&chosen);
    let points = hits.points().select(0, chosen);
    let shift: Vec<f32> = noise.neighbor[..count].iter().flatten().map(|u| u - 0.5).collect();
    let shift = Tensor::<2>::from_data(TensorData::new(shift, [count, 3]), &device) * config.losses.normal_distance;
    let at = |points| Query { object: rays.object.clone(), ..Query::new(points) }.lifted();
    let gradient_at = |query: Query| match config.losses.normal_difference {
        0.0 => field.occupancy_gradient(&query),
        distance => central_differences(field, &query, distance),
    };
    let gradient = gradient_at(at(points.clone()));
    let neighbor_gradient = gradient_at(at(points + shift));
    losses::normal_smoothness(gradient, neighbor_gradient) * (hits.len() as f64 / count as f64)
}

/// `grad_p f` by central differences, `[n, 3]`, on the graph.
fn central_differences(field: &impl Field, query: &Query, distance: f64) -> Tensor<2> {
    let along = (0..3).map(|axis| {
        let shift = axis_direction(query, axis) * (0.5 * distance);
        let logit = |points| field.occupancy_logit(&query.moved_to(points));
        let difference = logit(query.points.clone() + shift.clone()) - logit(query.points.clone() - shift);
        (difference / distance).unsqueeze_dim::<2>(1)
    });
    Tensor::cat(along.collect(), 1)
}

/// Marches the rays that are to be searched; hits and the like are indexed by their place among these.
fn search(frozen: &impl Crossing, batch: &PixelBatch, noise: &StepNoise, settings: MarchSettings) -> Option<March> {
    if batch.searched.is_empty() {
        return None;
    }
    let at = indices(&batch.searched, &frozen.device());
    let jitter = noise.jitter.as_ref().map(|jitter| floats(jitter, &frozen.device()).select(0, at.clone()));
    Some(FieldSurface::new(frozen).marcher(settings).march(&batch.rays.select(&at), jitter))
}

/// A random depth between each ray's entry into the cube and its exit, `[n]`.
fn random_depth(batch: &PixelBatch, share: &Tensor<1>) -> Tensor<1> {
    let [entry, exit] = batch.cube_interval.clone();
    entry.clone() + (exit - entry) * share.clone()
}

/// Logits on the graph, for some rays of the batch, at one depth a ray of the whole batch.
fn logits_on_rays(field: &impl Field, batch: &PixelBatch, rays: &[i64], depth: Tensor<1>) -> Tensor<1> {
    let at = indices(rays, &depth.device());
    field.occupancy_logit(&lifted(&batch.rays.select(&at), depth.select(0, at)))
}

/// Points on rays as a query on the autodiff device.
fn lifted(rays: &Rays, depth: Tensor<1>) -> Query {
    rays.query_at(depth).lifted()
}

/// Which ray plays which part. `*_rays` index the batch, `*_hits` the hits; pairs run in parallel.
#[derive(Default)]
struct Roles {
    object_hits: Vec<i64>,
    object_hit_rays: Vec<i64>,
    background_hits: Vec<i64>,
    missed_object: Vec<i64>,
    free: Vec<i64>,
    starts_inside: Vec<i64>,
    depth_hits: Vec<i64>,
    depth_rays: Vec<i64>,
    patch_hits: Vec<i64>,
    patch_rays: Vec<i64>,
    mask_iou: f64,
}

impl Roles {
    /// Sorts the rays of a batch by what the march found.
    fn sort(batch: &PixelBatch, march: Option<&March>) -> Self {
        let mut roles = Self::default();
        let mut starts_inside = vec![false; batch.len()];
        let mut hit_of_ray = vec![None; batch.len()];
        if let Some(march) = march {
            let mut hits = 0..;
            for (status, &ray) in march.status.iter().zip(&batch.searched) {
                match status {
                    RayStatus::Misses => {}
                    RayStatus::Hits => hit_of_ray[ray as usize] = hits.next(),
                    RayStatus::StartsInside => starts_inside[ray as usize] = true,
                }
            }
        }
        let (mut intersection, mut union) = (0usize, 0usize);
        for ray in (0..batch.len()).filter(|&ray| batch.in_cube[ray]) {
            let (index, object) = (ray as i64, batch.object[ray]);
            union += usize::from(object || hit_of_ray[ray].is_some());
            match hit_of_ray[ray] {
                Some(hit) if object => {
                    intersection += 1;
                    roles.object_hits.push(hit);
                    roles.object_hit_rays.push(index);
                    if batch.z_depth[ray].is_finite() {
                        roles.depth_hits.push(hit);
                        roles.depth_rays.push(index);
                    }
                }
                Some(hit) => roles.background_hits.push(hit),
                // The object lies inside the cube: where a ray enters, there is nothing, whatever the pixel shows.
                None if starts_inside[ray] => roles.starts_inside.push(index),
                None if object => roles.missed_object.push(index),
                None => roles.free.push(index),
            }
        }
        for patch in
            hit_of_ray.chunks_exact(batch.patch_pixels).zip(batch.object.chunks_exact(batch.patch_pixels)).enumerate()
        {
            let (i, (hits, object)) = patch;
            if object.iter().all(|&o| o) && hits.iter().all(Option::is_some) {
                roles.patch_hits.extend(hits.iter().flatten());
                roles.patch_rays.extend((i * batch.patch_pixels..(i + 1) * batch.patch_pixels).map(|ray| ray as i64));
            }
        }
        roles.mask_iou = if union == 0 { 1.0 } else { intersection as f64 / union as f64 };
        roles
    }
}

/// A list of indices on a device, `[n]`.
fn indices(values: &[i64], device: &Device) -> Tensor<1, Int> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device)
}

/// A list of numbers on a device, `[n]`.
fn floats(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device)
}
