//! A step that several devices share: each compares a part of the pixels, and their gradients are added up.
//!
//! The parameters live on the first device, which takes a part like the others. Every step the others get a copy,
//! work at the same time, a thread each, and send their gradients back. For a network of some megabytes that is little
//! beside a step, and it asks nothing of the devices: burn's own all-reduce (`burn::tensor::distributed`, 0.22) knows
//! CUDA cards and NCCL alone.

use burn::module::Module;
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor};

use crate::learners::objective::StepLoss;

/// The devices that share the steps of a training, the first of which holds the parameters; all without autodiff.
#[derive(Clone, Debug)]
pub(crate) struct DataParallel {
    devices: Vec<Device>,
}

/// What one device is to do: `weight` is its share of the whole, so that all of them sum to 1.
pub(crate) struct Part<T> {
    pub weight: f64,
    pub work: T,
}

impl DataParallel {
    /// One device.
    pub fn one(device: Device) -> Self {
        Self { devices: vec![device] }
    }

    /// Adds devices.
    pub fn with(mut self, others: impl IntoIterator<Item = Device>) -> Self {
        self.devices.extend(others);
        self
    }

    /// Where the parameters are.
    pub fn first(&self) -> &Device {
        &self.devices[0]
    }

    /// How many devices there are.
    pub fn len(&self) -> usize {
        self.devices.len()
    }

    /// The loss of all parts, and its gradients by the parameters of `model`; both on the first device, and none where
    /// nothing took part. There are at most as many parts as devices.
    pub fn learn<M: Module, T: Send>(
        &self,
        model: &M,
        parts: Vec<Part<T>>,
        loss: impl Fn(&M, T, &Device) -> StepLoss + Sync,
    ) -> (StepLoss, Option<GradientsParams>) {
        let is_alone = parts.len() == 1;
        let learn = |model: M, Part { weight, work }: Part<T>, device: &Device| {
            let mut loss = loss(&model, work, device);
            // A device that works alone must not even round.
            if !is_alone {
                loss = loss.weighted(weight);
            }
            let has_terms = !loss.terms.is_empty();
            let gradients = has_terms.then(|| GradientsParams::from_grads(loss.total.clone().backward(), &model));
            let gradients = gradients.map(|gradients| gradients.to_device(self.first(), &model));
            (loss.detached_on(self.first()), gradients)
        };
        let learned = std::thread::scope(|scope| {
            let mut parts = parts.into_iter().zip(&self.devices);
            let own = parts.next();
            let others: Vec<_> = parts
                .map(|(part, device)| {
                    let replica = model.clone().fork(device);
                    let learn = &learn;
                    scope.spawn(move || learn(replica, part, device))
                })
                .collect();
            let own = own.map(|(part, device)| learn(model.clone(), part, device));
            // A device that was lost panics over there; that panics here as if it had been the first one.
            let others = others.into_iter().map(|other| other.join().unwrap_or_else(|e| std::panic::resume_unwind(e)));
            own.into_iter().chain(others).collect::<Vec<_>>()
        });
        let mut sum = GradientsAccumulator::new();
        let (mut losses, mut has_terms) = (Vec::new(), false);
        for (loss, gradients) in learned {
            losses.push(loss);
            if let Some(gradients) = gradients {
                has_terms = true;
                sum.accumulate(model, gradients);
            }
        }
        (StepLoss::sum(losses, self.first()), has_terms.then(|| sum.grads()))
    }
}

/// The parts of `count` things, in order and as equal as can be: their ranges. No part is empty, so that there may be
/// fewer than asked for.
pub(crate) fn shares(count: usize, parts: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    let parts = parts.min(count).max(1);
    (0..parts).map(move |i| i * count / parts..(i + 1) * count / parts)
}

impl StepLoss {
    /// Times a factor.
    fn weighted(self, factor: f64) -> Self {
        let terms = self.terms.into_iter().map(|(name, term)| (name, term * factor)).collect();
        Self { total: self.total * factor, terms, mask_iou: self.mask_iou * factor }
    }

    /// The numbers alone, on another device.
    fn detached_on(self, device: &Device) -> Self {
        let moved = |tensor: Tensor<1>| tensor.inner().to_device(device);
        let terms = self.terms.into_iter().map(|(name, term)| (name, moved(term))).collect();
        Self { total: moved(self.total), terms, mask_iou: self.mask_iou }
    }

    /// Of several parts, which were weighted.
    fn sum(parts: Vec<Self>, device: &Device) -> Self {
        let mut whole = Self { total: Tensor::zeros([1], device), terms: Vec::new(), mask_iou: 0.0 };
        for part in parts {
            whole.total = whole.total + part.total;
            whole.mask_iou += part.mask_iou;
            for (name, value) in part.terms {
                match whole.terms.iter_mut().find(|(known, _)| *known == name) {
                    Some((_, sum)) => *sum = sum.clone() + value,
                    None => whole.terms.push((name, value)),
                }
            }
        }
        whole
    }
}
