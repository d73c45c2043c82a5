//! What a training step takes of a GPU's memory, estimated from its configuration.
//!
//! An estimate that is meant to lie above the truth: the counts of tensors below were measured (wgpu, burn 0.22: what
//! the device had set aside after some steps), and rounded up; most steps take between half of it and all of it. Rays
//! that miss the cube take nothing.

use dvr_model::{DecoderConfig, EncoderConfig, ShapeDecoderConfig};

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::methods::method::Method;
use crate::objects::config::ObjectsConfig;
use crate::objects::systems::config::SystemConfig;
use dvr_core::Supervision;

/// Bytes of a number in single precision.
const NUMBER: f64 = 4.0;

/// Layers of a point that are kept for the backward pass, for each block of the decoder and beside the blocks, with
/// what the passes themselves need.
const LAYERS_PER_BLOCK: f64 = 5.0;
const MORE_LAYERS: f64 = 10.0;

/// Layers of a point that features of its place in the picture take, with their derivatives along three axes.
const ALIGNED_LAYERS: f64 = 40.0;

/// Layers that the normal term keeps for each block and point: values and three tangents, with their masks, at two
/// points.
const LAYERS_OF_NORMALS: f64 = 40.0;

/// Evaluations that the normal term takes for each point with central differences.
const DIFFERENCES: f64 = 12.0;

/// Copies of the parameters: themselves, gradients, Adam's two moments, and what a step makes of them.
const PARAMETER_COPIES: f64 = 7.0;

/// Bytes of an image's pixel in a ResNet-18, with its gradients.
const RESNET_BYTES_PER_PIXEL: f64 = 1200.0;

/// Bytes of an image's pixel in the small convolutional encoder for each channel of its first layer.
const CONVOLUTIONAL_BYTES_PER_PIXEL: f64 = 11.0;

/// What a device sets aside at least.
const PAGES: f64 = 4e6;

/// Refuses a method whose step would take more than `allowed` bytes of GPU memory.
///
/// # Errors
/// Says how many rays a step may have at most.
pub fn check_memory(method: &dyn Method, allowed: u64) -> Result<()> {
    let bytes = method.memory_estimate(None);
    if bytes <= allowed {
        return Ok(());
    }
    let fits = |rays: usize| method.memory_estimate(Some(rays)) <= allowed;
    let rays = method.rays().filter(|rays| fits(*rays.start())).map(|rays| {
        // What a step takes grows with its rays.
        let (mut low, mut high) = (*rays.start(), rays.end() + 1);
        while low + 1 < high {
            let middle = low.midpoint(high);
            *if fits(middle) { &mut low } else { &mut high } = middle;
        }
        low
    });
    Err(Error::StepMemory { bytes, allowed, rays })
}

/// Bytes that a step of a network on one scene takes at most, about.
pub(crate) fn scene_step_bytes(config: &TrainConfig) -> u64 {
    (PAGES + scene_step(config)) as u64
}

/// The same for many objects.
pub(crate) fn objects_step_bytes(config: &ObjectsConfig) -> u64 {
    (PAGES + objects_step(config)) as u64
}

/// The same for a system that makes whole shapes.
pub(crate) fn system_step_bytes(config: &SystemConfig) -> u64 {
    let objects = config.objects as f64;
    // Numbers of all layers of an object's decoder.
    let layers = match config.decoder {
        // The finest layer's eight neighbours of each voxel, that of half its resolution, and what is made.
        ShapeDecoderConfig::Voxels { width } => 1.25 * 8.0 * 17f64.powi(3) * width as f64 + 4.0 * 32f64.powi(3),
        ShapeDecoderConfig::Points { width } => 4.0 * 768.0 * width as f64,
        ShapeDecoderConfig::Patches { width, .. } => 1.75 * (config.points * width) as f64,
        // Six layers of the last of three stages, of 642 vertices: each of a vertex, its six neighbours and their mean; and those
        // of the others, which are a third of it.
        ShapeDecoderConfig::Graph { width } => 1.4 * 642.0 * 6.0 * 8.0 * width as f64 / LAYERS_PER_BLOCK,
        ShapeDecoderConfig::Sphere { width } => 3.0 * width as f64 + 12.0 * 1920.0,
    };
    let weights = config.model().parameters() as f64;
    (PAGES
        + objects * image_bytes(&config.encoder)
        + NUMBER * (LAYERS_PER_BLOCK * objects * layers + PARAMETER_COPIES * weights)) as u64
}

/// Bytes of a picture in an encoder.
fn image_bytes(encoder: &EncoderConfig) -> f64 {
    match encoder {
        EncoderConfig::Resnet18 { image_size } => RESNET_BYTES_PER_PIXEL * (image_size * image_size) as f64,
        EncoderConfig::Convolutional { image_size, width } | EncoderConfig::ConvolutionalBn { image_size, width } => {
            CONVOLUTIONAL_BYTES_PER_PIXEL * (width * image_size * image_size) as f64
        }
        // Five layers of the plane, at half the picture's size, beside the convolutions.
        EncoderConfig::Local { image_size, width, channels }
        | EncoderConfig::LocalBn { image_size, width, channels } => {
            (CONVOLUTIONAL_BYTES_PER_PIXEL * *width as f64 + 0.25 * 5.0 * NUMBER * *channels as f64)
                * (image_size * image_size) as f64
        }
        EncoderConfig::Codes { .. } => 0.0,
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
    let known = match train.supervision {
        Supervision::Occupancy => config.points,
        _ => config.hull_points(),
    };
    let rays = if train.supervision == Supervision::Occupancy { 0 } else { train.rays };
    let of_targets = objects * known as f64 * point(&train.model) + rays_step(train, objects * rays as f64);
    // Each point is matched with each object to add up the gradients of codes.
    let points = known + rays;
    let matches = NUMBER * objects * objects * points as f64;
    let weights = match &config.encoder {
        EncoderConfig::Resnet18 { .. } => 11.3e6,
        EncoderConfig::Convolutional { width, .. } | EncoderConfig::ConvolutionalBn { width, .. } => {
            1600.0 * (width * width) as f64
        }
        EncoderConfig::Local { width, channels, .. } | EncoderConfig::LocalBn { width, channels, .. } => {
            1600.0 * (width * width) as f64 + 9.0 * (channels * channels) as f64
        }
        EncoderConfig::Codes { objects } => (objects * train.model.code_dim) as f64,
    };
    // The plane as the decoder takes it, and what a point finds in it: four places, what lies between them, derivatives.
    let aligned = config.encoder.local_channels().and_then(|_| config.encoder.image_size()).map_or(0.0, |image_size| {
        let hidden = NUMBER * train.model.hidden as f64;
        let plane = 0.25 * (image_size * image_size) as f64;
        objects * hidden * (2.0 * plane + ALIGNED_LAYERS * points as f64)
    });
    let images = image_bytes(&config.encoder);
    aligned + of_targets + matches + objects * images + NUMBER * PARAMETER_COPIES * weights + parameters(&train.model)
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
    NUMBER * ((LAYERS_PER_BLOCK * model.blocks as f64 + MORE_LAYERS) * model.hidden as f64 + features as f64)
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
    use dvr_model::Decoder;

    use super::*;
    use crate::methods::field_method::FieldMethod;
    use crate::methods::grid::grid;
    use crate::methods::network::decoder_method;
    use crate::methods::objects::{objects, objects_classic};

    fn network(change: impl Fn(&mut TrainConfig)) -> FieldMethod<Decoder> {
        let mut config = TrainConfig::new(Supervision::Rgb);
        change(&mut config);
        decoder_method("network", config)
    }

    #[test]
    fn measured_steps_take_what_is_estimated_and_not_much_less() {
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
            let estimate = method.memory_estimate(None) as f64 / 1e6;
            assert!(estimate > measured && estimate < 2.0 * measured, "{hidden} {rays}: {estimate}, not {measured} MB");
        }
    }

    #[test]
    fn too_little_memory_is_refused_with_the_largest_step_that_fits() {
        let method = network(|_| ());
        let needed = method.memory_estimate(None);
        assert!(check_memory(&method, needed).is_ok());
        let Err(Error::StepMemory { rays: Some(rays), .. }) = check_memory(&method, needed / 2) else {
            panic!("half of the memory is too little for all rays and enough for some")
        };
        let fits = |rays| method.memory_estimate(Some(rays)) <= needed / 2;
        assert!(fits(rays) && !fits(rays + 1), "{rays}");
        assert!(matches!(check_memory(&method, 0), Err(Error::StepMemory { rays: None, .. })));
    }

    #[test]
    fn the_papers_setting_needs_a_large_gpu_and_grids_none() {
        let large = objects_classic(Supervision::Rgb).memory_estimate(None);
        assert!(large > 10_000_000_000, "{large}");
        let small = objects(Supervision::Rgb).memory_estimate(None);
        assert!((30_000_000..300_000_000).contains(&small), "{small}");
        assert_eq!(grid(Supervision::Rgb).memory_estimate(None), 0);
    }
}
