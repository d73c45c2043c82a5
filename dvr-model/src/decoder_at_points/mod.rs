//! The decoder at many points on the CPU, with its gradient by hand: what training by points of known occupancy costs.
//!
//! [`Decoder::outputs`] in burn's operations keeps some fifty tensors of a row per point for the backward pass, and does little
//! with each. Here a share of the points goes through all layers while it is in the cache; the backward pass goes through them
//! once more, so that nothing is kept.

mod layers;
mod pass;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use burn::tensor::{Int, Tensor};
use pulp::Arch;
use rayon::prelude::*;

use crate::aligned_features::AlignedFeatures;
use crate::decoder::{Decoder, LEAK};
use crate::encoding;
use crate::host_function::{HostFunction, host_function};
use layers::Layers;
use pass::{Activations, Backward, Forward, Pass};

/// Points that go through the layers together: few enough for the cache.
const CHUNK: usize = 128;

/// Parts that gradients are summed in, whatever the threads: the same bits on every machine with as many.
const PARTS: usize = 8;

/// Values of a point: the occupancy logit, and the colour before the sigmoid.
const OUTPUTS: usize = 4;

/// [`Decoder::outputs`], `[n, 4]`, at points that are constants where there are features of pictures; `object` picks the row of
/// `conditions` for each point, and without it all have the first.
pub(crate) fn decoder_at_points(
    decoder: &Decoder,
    points: Tensor<2>,
    conditions: &[Tensor<2>],
    object: Option<&Tensor<1, Int>>,
    aligned: Option<&AlignedFeatures>,
) -> Tensor<2> {
    let own = encoding::encode(points.clone(), decoder.octaves);
    // What pictures have of a point is more inputs of the first layer.
    let (features, input_weight) = match aligned {
        Some(aligned) => (
            Tensor::cat(vec![own, aligned.inputs(&points, object)], 1),
            Tensor::cat(vec![decoder.fc_p.weight.val(), aligned.weights()], 0),
        ),
        None => (own, decoder.fc_p.weight.val()),
    };
    let [count, per_point] = features.dims();
    let [objects, given] = conditions.first().map_or([0, 0], Tensor::dims);
    let layers = Layers {
        points: count,
        features: per_point,
        hidden: decoder.fc_p.weight.dims()[1],
        blocks: decoder.blocks.len(),
        conditions: conditions.len(),
        objects,
        given,
        leak: if decoder.leaky { LEAK as f32 } else { 0.0 },
    };
    let object: Vec<u32> = match object {
        Some(object) if layers.conditions > 0 => object.clone().into_data().iter::<i64>().map(|i| i as u32).collect(),
        _ => vec![0; count],
    };
    let linears = std::iter::once(&decoder.fc_p)
        .chain(decoder.blocks.iter().flat_map(|block| [&block.fc_0, &block.fc_1]))
        .chain([&decoder.fc_out]);
    let mut inputs: Vec<Tensor<1>> = Vec::new();
    for (i, linear) in linears.enumerate() {
        let outputs = linear.weight.dims()[1];
        let weight = if i == 0 { input_weight.clone() } else { linear.weight.val() };
        inputs.push(weight.flatten(0, 1));
        inputs.push(match &linear.bias {
            Some(bias) => bias.val(),
            None => Tensor::zeros([outputs], &features.device()),
        });
    }
    inputs.extend(conditions.iter().map(|condition| condition.clone().flatten(0, 1)));
    inputs.push(features.flatten(0, 1));
    let function = Arc::new(AtPoints { layers, object });
    host_function(Tensor::cat(inputs, 0), function).reshape([count, OUTPUTS])
}

/// The function: of which object each point is.
#[derive(Debug)]
struct AtPoints {
    layers: Layers,
    object: Vec<u32>,
}

impl HostFunction for AtPoints {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let Layers { features: per_point, .. } = self.layers;
        let (parameters, features) = inputs.split_at(self.layers.parameters().end);
        let mut values = vec![0.0; OUTPUTS * self.layers.points];
        let parts = values.par_chunks_mut(OUTPUTS * CHUNK).zip(features.par_chunks(per_point * CHUNK));
        parts.zip(self.object.par_chunks(CHUNK)).for_each_init(
            || Activations::new(&self.layers),
            |activations, ((values, features), object)| {
                let pass = Pass { layers: &self.layers, parameters, features, object };
                Arch::new().dispatch(Forward { pass, activations, values });
            },
        );
        values
    }

    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let Layers { features: per_point, points, .. } = self.layers;
        let (parameters, features) = inputs.split_at(self.layers.parameters().end);
        let part = points.div_ceil(CHUNK).div_ceil(PARTS).max(1) * CHUNK;
        let mut gradient = vec![0.0; inputs.len()];
        let (total, by_features) = gradient.split_at_mut(parameters.len());
        let parts = by_features.par_chunks_mut(per_point * part).zip(features.par_chunks(per_point * part));
        let parts = parts.zip(self.object.par_chunks(part)).zip(by.par_chunks(OUTPUTS * part));
        let sums = parts.map(|(((by_features, features), object), by)| {
            let (mut sum, mut activations) = (vec![0.0; parameters.len()], Activations::new(&self.layers));
            let chunks = by_features.chunks_mut(per_point * CHUNK).zip(features.chunks(per_point * CHUNK));
            for (((by_features, features), object), by) in
                chunks.zip(object.chunks(CHUNK)).zip(by.chunks(OUTPUTS * CHUNK))
            {
                let pass = Pass { layers: &self.layers, parameters, features, object };
                Arch::new().dispatch(Backward { pass, activations: &mut activations, by, by_features, sum: &mut sum });
            }
            sum
        });
        for sum in sums.collect::<Vec<_>>() {
            total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        gradient
    }
}
