//! How well objects that were not trained on are explained: by their silhouettes and pictures, as seen from other
//! sides.

use burn::tensor::Device;
use dvr_core::dataset::{InputPicture, ObjectDataset};
use dvr_core::{Split, View};
use dvr_model::ImageModel;
use dvr_render::FieldShader;

use super::config::ObjectsConfig;
use super::draw::stable_hash;
use super::model::{field_of, render_settings};
use dvr_render::{ViewMetrics, view_metrics};

/// Samples across the cube where a field is looked at.
const SAMPLES: usize = 48;

/// A validation view: what the encoder sees of an object, and how the object looks from another side.
#[derive(Clone, Debug)]
pub struct ValidationView {
    /// Place among the training objects, for encoders that know objects by it.
    pub row: i64,
    /// What the encoder sees, where it sees something.
    pub input: Option<InputPicture>,
    /// The other side.
    pub view: View,
}

/// Reads the validation views: of objects of the validation split, spread evenly over it, or training objects where the encoder
/// knows no others (`size`, of the encoder's pictures, is `None`). An object that cannot be read is left out; `problem` hears why.
pub(crate) fn read_validation_views(
    dataset: &ObjectDataset,
    count: usize,
    size: Option<usize>,
    seed: u64,
    mut problem: impl FnMut(usize, String),
) -> Vec<ValidationView> {
    let objects = dataset.of_split(if size.is_some() { Split::Val } else { Split::Train });
    let count = count.min(objects.len());
    let mut all = Vec::with_capacity(count);
    for i in 0..count {
        let row = i * objects.len() / count;
        match read_validation_view(dataset, objects[row], row, size, seed) {
            Ok(view) => all.push(view),
            Err(error) => problem(objects[row], error.to_string()),
        }
    }
    all
}

fn read_validation_view(
    dataset: &ObjectDataset,
    object: usize,
    row: usize,
    size: Option<usize>,
    seed: u64,
) -> dvr_core::Result<ValidationView> {
    let name = &dataset.objects()[object];
    let hash = stable_hash(seed, &[&name.category, &name.name]);
    let (inputs, views) = (dataset.inputs(object)? as u64, dataset.views(object)? as u64);
    let input = hash % inputs;
    // Half the views further: where input and view are the same pictures, the one looks at the other's back.
    let view = (input + views / 2) % views;
    let input = size.map(|size| dataset.read_input(object, input as usize, size as u32)).transpose()?;
    Ok(ValidationView { row: row as i64, input, view: dataset.read_view(object, view as usize)? })
}

/// The mean metrics of a model, without gradient tracking, on all validation views, on about so many pixels.
pub(crate) fn validate(
    model: &ImageModel,
    all: &[ValidationView],
    pixels: usize,
    config: &ObjectsConfig,
    device: &Device,
) -> Option<ViewMetrics> {
    mean_metrics(all, |one| {
        let field = field_of(model, one.input.as_ref(), one.row, config, device);
        let shader = FieldShader::new(&field, render_settings(SAMPLES), None);
        view_metrics(&shader, &[&one.view], pixels / all.len())
    })
}

/// The mean of what is found of each validation view.
pub(crate) fn mean_metrics(
    all: &[ValidationView],
    of_one: impl Fn(&ValidationView) -> Option<ViewMetrics>,
) -> Option<ViewMetrics> {
    let of_each: Vec<ViewMetrics> = all.iter().filter_map(of_one).collect();
    let mean = |part: fn(&ViewMetrics) -> f64| of_each.iter().map(part).sum::<f64>() / of_each.len() as f64;
    (!of_each.is_empty()).then(|| ViewMetrics {
        psnr: mean(|a| a.psnr),
        mask_iou: mean(|a| a.mask_iou),
        pixels: of_each.iter().map(|a| a.pixels).sum(),
    })
}
