//! A decoder as a field: of one object, or bound to the latent codes of several.

use burn::module::Module;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor};
use dvr_render::{Crossing, Differentiable, Field, FieldJet, FieldValues, Query, Snapshot, axis_direction};
#[cfg(feature = "gpu")]
use dvr_render::{MarchSettings, Marcher};

use crate::aligned_features::AlignedFeatures;
use crate::decoder::Decoder;
use crate::decoder_at_points::decoder_at_points;
use crate::fused::{FusedDecoder, snapshots};
#[cfg(feature = "gpu")]
use crate::gpu_march::KernelMarcher;
use crate::host_function::is_on_host;

impl Decoder {
    /// The field of objects with latent codes, `[objects, code_dim]`: a [`Query`]'s object index picks the row.
    ///
    /// Codes are projected here, once per object; what is left for each point is to pick a row.
    pub fn with_codes(&self, codes: Tensor<2>) -> Conditioned {
        Conditioned { conditions: self.conditions(Some(codes)), decoder: self.clone(), aligned: None }
    }

    /// The field of the one object that a decoder without codes holds.
    pub fn unconditioned(&self) -> Conditioned {
        Conditioned { conditions: Vec::new(), decoder: self.clone(), aligned: None }
    }
}

/// A decoder bound to the latent codes of its objects.
#[derive(Clone, Debug)]
pub struct Conditioned {
    decoder: Decoder,
    /// What each block adds of the codes, `[objects, hidden]`; empty without codes.
    conditions: Vec<Tensor<2>>,
    /// Features of the objects' pictures.
    aligned: Option<AlignedFeatures>,
}

impl Conditioned {
    /// The decoder.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// The same with features of the objects' pictures.
    pub(crate) fn with_aligned(self, aligned: Option<AlignedFeatures>) -> Self {
        Self { aligned, ..self }
    }

    /// The same field, as it is now, without gradient tracking.
    #[must_use]
    pub fn without_gradients(&self) -> Self {
        Self {
            decoder: self.decoder.valid(),
            conditions: self.conditions.iter().map(|condition| condition.clone().inner()).collect(),
            aligned: self.aligned.as_ref().map(AlignedFeatures::inner),
        }
    }

    /// [`Field::occupancy_logit`] for training by many points, which are constants: on the CPU in less time, and the same but for rounding. Not for
    /// differences of logits over small steps, which multiply rounding.
    pub fn occupancy_logit_of_points(&self, query: &Query) -> Tensor<1> {
        if !is_on_host(&self.decoder.fc_p.weight.val()) {
            return self.occupancy_logit(query);
        }
        let (object, aligned) = (query.object.as_ref(), self.aligned.as_ref());
        let outputs = decoder_at_points(&self.decoder, query.points.clone(), &self.conditions, object, aligned);
        outputs.narrow(1, 0, 1).squeeze_dim(1)
    }

    /// Raw outputs, `[n, 4]`.
    fn outputs(&self, query: &Query) -> Tensor<2> {
        let (points, aligned) = (query.points.clone(), self.aligned.as_ref());
        match &query.object {
            Some(object) => self.decoder.outputs(points, &self.conditions, Some(object), aligned),
            None => self.decoder.outputs(points, &self.of_object_0(), None, aligned),
        }
    }

    /// Raw outputs and their derivatives along directions, each `[n, 4]`.
    fn tangents(&self, query: &Query, directions: Vec<Tensor<2>>) -> (Tensor<2>, Vec<Tensor<2>>) {
        let (points, aligned) = (query.points.clone(), self.aligned.as_ref());
        match &query.object {
            Some(object) => self.decoder.tangents(points, &self.conditions, Some(object), aligned, directions),
            None => self.decoder.tangents(points, &self.of_object_0(), None, aligned, directions),
        }
    }

    /// What the blocks add of the first object's code, `[1, hidden]` each.
    fn of_object_0(&self) -> Vec<Tensor<2>> {
        self.conditions.iter().map(|condition| condition.clone().narrow(0, 0, 1)).collect()
    }
}

/// Raw outputs as a logit and a colour.
fn as_values(out: Tensor<2>) -> FieldValues {
    FieldValues { occupancy_logit: out.clone().narrow(1, 0, 1).squeeze_dim(1), color: sigmoid(out.narrow(1, 1, 3)) }
}

impl Field for Conditioned {
    fn evaluate(&self, query: &Query) -> FieldValues {
        as_values(self.outputs(query))
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        self.outputs(query).narrow(1, 0, 1).squeeze_dim(1)
    }

    fn device(&self) -> Device {
        self.decoder.fc_p.weight.val().device()
    }
}

impl Differentiable for Conditioned {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let (out, mut tangents) = self.tangents(query, vec![direction]);
        let value = as_values(out);
        let tangent = tangents.remove(0);
        // d sigmoid(x) = sigmoid(x) (1 - sigmoid(x)) dx
        let slope = value.color.clone() * (value.color.clone().neg() + 1.0);
        let derivative = FieldValues {
            occupancy_logit: tangent.clone().narrow(1, 0, 1).squeeze_dim(1),
            color: tangent.narrow(1, 1, 3) * slope,
        };
        FieldJet { value, derivative }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        let axes = (0..3).map(|axis| axis_direction(query, axis)).collect();
        let (_, tangents) = self.tangents(query, axes);
        Tensor::cat(tangents.into_iter().map(|t| t.narrow(1, 0, 1)).collect(), 1)
    }
}

impl Crossing for Conditioned {
    #[cfg(feature = "gpu")]
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        (self.aligned.is_none() && dvr_gpu::is_gpu(&self.device())).then(|| {
            Box::new(KernelMarcher::new(&self.decoder, &self.conditions, self.clone(), settings)) as Box<dyn Marcher>
        })
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        if !FusedDecoder::suits(&self.decoder.fc_p.weight.val()) {
            return Vec::new();
        }
        let fused = FusedDecoder::with_inputs(&self.decoder, self.aligned.as_ref());
        let decoders = if self.conditions.is_empty() { vec![fused] } else { fused.with_conditions(&self.conditions) };
        let Some(aligned) = &self.aligned else { return snapshots(decoders) };
        let of_pictures = decoders.into_iter().zip(aligned.picture_planes());
        snapshots(of_pictures.map(|(decoder, plane)| decoder.with_picture(plane)).collect())
    }
}

impl Field for Decoder {
    fn evaluate(&self, query: &Query) -> FieldValues {
        self.unconditioned().evaluate(query)
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        self.unconditioned().occupancy_logit(query)
    }

    fn device(&self) -> Device {
        self.fc_p.weight.val().device()
    }
}

impl Differentiable for Decoder {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        self.unconditioned().jet(query, direction)
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        self.unconditioned().occupancy_gradient(query)
    }
}

impl Crossing for Decoder {
    #[cfg(feature = "gpu")]
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        let field = self.unconditioned();
        dvr_gpu::is_gpu(&field.device())
            .then(|| Box::new(KernelMarcher::new(self, &[], field, settings)) as Box<dyn Marcher>)
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        self.unconditioned().snapshots()
    }
}
