//! The decoder's march as a kernel of the GPU on which it lies.

use burn::nn::Linear;
use burn::tensor::Tensor;
use dvr_gpu::{PackedDecoder, RaySearch, Root, march_decoder};
use dvr_render::{Field, March, MarchSettings, Marcher, Rays, RootMethod, TensorMarcher};

use crate::decoder::{Decoder, LEAK};

/// Marches through a decoder without reading anything back but which rays hit.
pub(crate) struct KernelMarcher<F> {
    /// Marched through tensors where the kernel has no room for the network.
    field: F,
    packed: PackedDecoder,
    settings: MarchSettings,
}

impl<F: Field> KernelMarcher<F> {
    /// Packs the parameters of `field`, `decoder` with what each block adds of the codes (`[objects, hidden]`), as they
    /// are now, on the device.
    pub fn new(decoder: &Decoder, conditions: &[Tensor<2>], field: F, settings: MarchSettings) -> Self {
        let mut parts = Vec::new();
        let mut layer = |linear: &Linear, columns: usize| {
            parts.push(linear.weight.val().narrow(1, 0, columns).flatten::<1>(0, 1));
            if let Some(bias) = &linear.bias {
                parts.push(bias.val().narrow(0, 0, columns));
            }
        };
        let hidden = decoder.fc_p.weight.dims()[1];
        layer(&decoder.fc_p, hidden);
        for block in &decoder.blocks {
            layer(&block.fc_0, hidden);
            layer(&block.fc_1, hidden);
        }
        layer(&decoder.fc_out, 1);
        let packed = PackedDecoder {
            weights: Tensor::cat(parts, 0),
            conditions: (!conditions.is_empty()).then(|| Tensor::cat(conditions.to_vec(), 0)),
            hidden,
            blocks: decoder.blocks.len(),
            octaves: decoder.octaves,
            leak: if decoder.leaky { LEAK as f32 } else { 0.0 },
        };
        Self { field, packed, settings }
    }
}

impl<F: Field> Marcher for KernelMarcher<F> {
    fn march(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> March {
        let search = RaySearch {
            origin: rays.origin.clone(),
            direction: rays.direction.clone(),
            interval: [rays.entry.clone(), rays.exit.clone()],
            jitter: jitter.clone(),
            object: rays.object.clone(),
            steps: self.settings.steps,
            root: match self.settings.root {
                RootMethod::Secant => Root::Secant,
                RootMethod::Bisection => Root::Bisection,
                RootMethod::Chandrupatla => Root::Chandrupatla,
            },
            root_steps: self.settings.root_steps,
        };
        match march_decoder(&self.packed, &search) {
            Some(found) => March::of_columns(rays, &found),
            None => TensorMarcher::new(&self.field, self.settings).march(rays, jitter),
        }
    }
}
