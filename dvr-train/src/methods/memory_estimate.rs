//! What a training step takes of a graphics processor's memory, foretold from its configuration.
//!
//! An estimate that is meant to lie above the truth: the counts of tensors below were measured (wgpu, burn 0.22: what
//! the device had set aside after some steps), and rounded up; most steps take between half of it and all of it. Rays
//! that miss the cube take nothing.

use dvr_model::{DecoderConfig, EncoderConfig};

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::methods::method::Method;
use crate::objects::ObjectsConfig;
use dvr_core::Supervision;

/// Bytes of a number in single precision.
const NUMBER: f64 = 4.0;

/// Layers of a point that are kept for the backward pass, for each block of the decoder and beside the blocks, with
/// what the passes themselves need.
const LAYERS_A_BLOCK: f64 = 5.0;
const MORE_LAYERS: f64 = 10.0;

/// Layers that the normal term keeps for each block and point: values and three tangents, with their masks, at two
/// points.
const LAYERS_OF_NORMALS: f64 = 40.0;

/// Evaluations that the normal term takes for each point with central differences.
const DIFFERENCES: f64 = 12.0;

/// Copies of the parameters: themselves, gradients, Adam's two moments, and what a step makes of them.
const PARAMETER_COPIES: f64 = 7.0;

/// Bytes of an image's pixel in a ResNet-18, with its gradients.
const RESNET_BYTES_A_PIXEL: f64 = 1200.0;

/// Bytes of an image's pixel in the small convolutional encoder for each channel of its first layer.
const CONVOLUTIONAL_BYTES_A_PIXEL: f64 = 11.0;

/// What a device sets aside at least.
const PAGES: f64 = 4e6;

/// Bytes that a step of the method takes at most on a graphics processor, about. 0 for fields on grids: what
/// they take is photographs and grids, which only the scene tells, and is looked at while they are trained.
pub fn memory_estimate(method: &Method) -> u64 {
    let bytes = match method {
        Method::Grid(_) => 0.0,
        Method::Network(config) => PAGES + scene_step(config),
        Method::Objects(config) => PAGES + objects_step(config),
    };
    bytes as u64
}

/// Refuses a method whose step would take more than `allowed` bytes of a graphics processor's memory.
///
/// # Errors
/// Says how many rays a step may have at most.
pub fn check_memory(method: &Method, allowed: u64) -> Result<()> {
    let bytes = memory_estimate(method);
    if bytes <= allowed {
        return Ok(());
    }
    let fits = |rays: usize| memory_estimate(&with_rays(method, rays)) <= allowed;
    let remedy = match fewest_and_most_rays(method) {
        Some((fewest, most)) if fits(fewest) => {
            // What a step takes grows with its rays.
            let (mut low, mut high) = (fewest, most + 1);
            while low + 1 < high {
                let middle = low.midpoint(high);
                *if fits(middle) { &mut low } else { &mut high } = middle;
            }
            let warm_start = match method {
                Method::Network(config) if config.hull.warm_start_points > low => {
                    format!(" --set hull.warm_start_points={low}")
                }
                _ => String::new(),
            };
            format!("--set rays={low}{warm_start} fits, or allow more with --memory")
        }
        _ => "no number of rays fits; allow more with --memory, take a smaller network (--set model.hidden=N), or \
              --backend cpu"
            .into(),
    };
    Err(Error::Memory { what: "a step takes".into(), bytes, allowed, remedy })
}

/// What a run that was found to hold too much after a step says.
pub(crate) fn too_much_memory(step: usize, bytes: u64, allowed: u64) -> Error {
    let remedy =
        "everything is saved; `dvr train --resume` goes on with a larger --memory, or with --backend cpu".into();
    Error::Memory { what: format!("after step {step}, tensors hold"), bytes, allowed, remedy }
}

/// The same method with another number of rays, and no more points than that in the steps of its warm start.
fn with_rays(method: &Method, rays: usize) -> Method {
    let mut method = method.clone();
    match &mut method {
        Method::Grid(_) => {}
        Method::Network(config) => {
            config.rays = rays;
            config.hull.warm_start_points = config.hull.warm_start_points.min(rays);
        }
        Method::Objects(config) => config.train.rays = rays,
    }
    method
}

/// The fewest rays that a step can have, a patch of them, and those that it has now.
fn fewest_and_most_rays(method: &Method) -> Option<(usize, usize)> {
    match method {
        Method::Grid(_) => None,
        Method::Network(config) => Some((config.sampling().patch_pixels(), config.rays)),
        Method::Objects(config) if config.train.supervision == Supervision::Occupancy => None,
        Method::Objects(config) => Some((config.train.sampling().patch_pixels(), config.train.rays)),
    }
}

/// Bytes of a step on one scene.
fn scene_step(config: &TrainConfig) -> f64 {
    let warm_start = config.hull.warm_start_points as f64 * point(&config.model);
    rays_step(config, config.rays as f64).max(warm_start) + parameters(&config.model)
}

/// Bytes of a step on many objects.
fn objects_step(config: &ObjectsConfig) -> f64 {
    let train = &config.train;
    let objects = config.objects as f64;
    let ray_gradient = match train.supervision {
        Supervision::Occupancy => objects * config.points as f64 * point(&train.model),
        _ => rays_step(train, objects * train.rays as f64),
    };
    // Each point is matched with each object to add up the gradients of codes.
    let points = match train.supervision {
        Supervision::Occupancy => config.points,
        _ => train.rays,
    };
    let matches = NUMBER * objects * objects * points as f64;
    let [images, weights] = match &config.encoder {
        EncoderConfig::Resnet18 { image_size } => [RESNET_BYTES_A_PIXEL * (image_size * image_size) as f64, 11.3e6],
        EncoderConfig::Convolutional { image_size, width } => {
            let width = *width as f64;
            [CONVOLUTIONAL_BYTES_A_PIXEL * width * (image_size * image_size) as f64, 1600.0 * width * width]
        }
        EncoderConfig::Codes { objects } => [0.0, (objects * train.model.code_dim) as f64],
    };
    ray_gradient + matches + objects * images + NUMBER * PARAMETER_COPIES * weights + parameters(&train.model)
}

/// Bytes of so many rays: their points on the graph, and the normals at some of them.
fn rays_step(config: &TrainConfig, rays: f64) -> f64 {
    let losses = &config.losses;
    let model = &config.model;
    let normals = if losses.normal > 0.0 { rays.min(losses.normal_points as f64) } else { 0.0 };
    let a_normal = if losses.normal_difference == 0.0 {
        NUMBER * LAYERS_OF_NORMALS * (model.blocks * model.hidden) as f64
    } else {
        DIFFERENCES * point(model)
    };
    let sparse = if losses.sparse_depth > 0.0 { losses.sparse_points as f64 } else { 0.0 };
    (rays + sparse) * point(model) + normals * a_normal
}

/// Bytes of a point on the graph.
fn point(model: &DecoderConfig) -> f64 {
    let features = 2 * (3 + 6 * model.octaves);
    NUMBER * ((LAYERS_A_BLOCK * model.blocks as f64 + MORE_LAYERS) * model.hidden as f64 + features as f64)
}

/// Bytes of a decoder's parameters and of what goes with them.
fn parameters(model: &DecoderConfig) -> f64 {
    let (hidden, features) = (model.hidden, 3 + 6 * model.octaves);
    let codes = if model.code_dim > 0 { (model.code_dim + 1) * hidden } else { 0 };
    let count = (features + 1) * hidden + model.blocks * (2 * (hidden + 1) * hidden + codes) + 4 * (hidden + 1);
    NUMBER * PARAMETER_COPIES * count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(change: impl Fn(&mut TrainConfig)) -> Method {
        let mut config = TrainConfig::new(Supervision::Rgb);
        change(&mut config);
        Method::Network(config)
    }

    #[test]
    fn steps_that_were_measured_take_what_is_foretold_and_not_much_less() {
        // Width, blocks, octaves, rays, and the megabytes that a device had set aside after three steps (llvmpipe,
        // wgpu).
        for (hidden, blocks, octaves, rays, measured) in [
            (64, 5, 4, 512, 12.3),
            (64, 5, 4, 2048, 21.2),
            (128, 5, 4, 2048, 40.6),
            (128, 2, 4, 2048, 21.3),
            (256, 5, 0, 1024, 61.4),
        ] {
            let method = network(|config| {
                config.rays = rays;
                config.hull.warm_start_points = 0;
                config.model = DecoderConfig::new().with_hidden(hidden).with_blocks(blocks).with_octaves(octaves);
            });
            let foretold = memory_estimate(&method) as f64 / 1e6;
            assert!(foretold > measured && foretold < 2.0 * measured, "{hidden} {rays}: {foretold}, not {measured} MB");
        }
    }

    #[test]
    fn too_little_memory_is_refused_with_the_largest_step_that_fits() {
        let method = network(|_| ());
        let needed = memory_estimate(&method);
        assert!(check_memory(&method, needed).is_ok());
        let problem = check_memory(&method, needed / 2).unwrap_err().to_string();
        let rays: usize = problem.split("rays=").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!(problem.contains(&format!("hull.warm_start_points={rays} ")), "{problem}");
        let fits = |rays| check_memory(&with_rays(&method, rays), needed / 2).is_ok();
        assert!(fits(rays) && !fits(rays + 1), "{problem}");
        assert!(problem.contains("--memory") && problem.contains("MB"), "{problem}");
        let problem = check_memory(&method, 0).unwrap_err().to_string();
        assert!(problem.contains("no number of rays") && problem.contains("--backend cpu"), "{problem}");
    }

    #[test]
    fn the_publications_setting_needs_a_large_card_and_grids_none() {
        let large = memory_estimate(&Method::Objects(ObjectsConfig::classic(Supervision::Rgb)));
        assert!(large > 10_000_000_000, "{large}");
        let small = memory_estimate(&Method::Objects(ObjectsConfig::new(Supervision::Rgb)));
        assert!((30_000_000..300_000_000).contains(&small), "{small}");
        assert_eq!(memory_estimate(&Method::Grid(dvr_grid::GridConfig::hull())), 0);
    }
}
