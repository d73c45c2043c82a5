//! The fixtures' decoders as one field.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use dvr_model::{Conditioned, Decoder};
use dvr_render::{Crossing, Differentiable, Field, FieldJet, FieldValues, Query};

/// A decoder with or without codes as one type.
#[derive(Module, Debug)]
pub struct BoundDecoder {
    /// The decoder.
    pub decoder: Decoder,
    codes: Option<Param<Tensor<2>>>,
}

impl BoundDecoder {
    /// The decoder with its codes, `[objects, length]`, where it takes any.
    pub fn new(decoder: &Decoder, codes: Option<Tensor<2>>) -> Self {
        Self { decoder: decoder.clone(), codes: codes.map(Param::from_tensor) }
    }

    fn bound(&self) -> Option<Conditioned> {
        Some(self.decoder.with_codes(self.codes.as_ref()?.val()))
    }
}

impl Field for BoundDecoder {
    fn evaluate(&self, query: &Query) -> FieldValues {
        self.bound().map_or_else(|| self.decoder.evaluate(query), |bound| bound.evaluate(query))
    }

    fn device(&self) -> Device {
        self.decoder.device()
    }
}

impl Differentiable for BoundDecoder {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        match self.bound() {
            Some(bound) => bound.jet(query, direction),
            None => self.decoder.jet(query, direction),
        }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        self.bound().map_or_else(|| self.decoder.occupancy_gradient(query), |bound| bound.occupancy_gradient(query))
    }
}

impl Crossing for BoundDecoder {}
