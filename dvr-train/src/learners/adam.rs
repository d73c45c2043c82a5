//! Adam, with the moments in the CPU's memory when they come from a file.

use burn::optim::{
    Adam, AdamConfig, AdamState, LearningRate, ModuleOptimizer, Optimizer, RecordState, StateSink, StateSource,
};
use burn::tensor::{Device, Tensor};

/// The optimiser of DVR's reference code: Adam with the usual moments.
pub(crate) fn adam() -> ModuleOptimizer {
    ModuleOptimizer::from(HostLoaded(AdamConfig::new().with_epsilon(1e-8).build()))
}

/// Adam as it is, but for where burn puts a state that it reads.
///
/// burn loads it onto its default device, which is a GPU wherever the program was built for one, be
/// there such a thing or not; the next step moves it to the parameters' device. So it can as well start on the CPU,
/// which is always there.
#[derive(Clone)]
struct HostLoaded(Adam);

/// Adam's state of one parameter.
#[derive(Clone)]
struct HostLoadedState<const D: usize>(AdamState<D>);

impl<const D: usize> RecordState for HostLoadedState<D> {
    fn state_flatten(&self, prefix: &str, out: &mut StateSink) {
        self.0.state_flatten(prefix, out);
    }

    fn state_unflatten(prefix: &str, source: &mut StateSource, _default: &Device) -> Option<Self> {
        AdamState::state_unflatten(prefix, source, &Device::flex()).map(Self)
    }
}

impl Optimizer for HostLoaded {
    type State<const D: usize> = HostLoadedState<D>;

    fn step<const D: usize>(
        &self,
        learning_rate: LearningRate,
        tensor: Tensor<D>,
        gradient: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let (tensor, state) = self.0.step(learning_rate, tensor, gradient, state.map(|state| state.0));
        (tensor, state.map(HostLoadedState))
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        HostLoadedState(<Adam as Optimizer>::to_device(state.0, device))
    }
}
