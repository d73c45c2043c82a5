//! Fresh parameters from a seed. Alone in its process, since the generator is one for all of it: other tests draw numbers, too.

use burn::module::{Module, ModuleVisitor, Param};
use burn::store::ModuleRecord;
use burn::tensor::{Device, Distribution, Tensor};
use dvr_model::{Decoder, DecoderConfig, from_safetensors, seeded, to_safetensors};

/// All parameters, one after the other.
#[derive(Default)]
struct Numbers(Vec<f32>);

impl ModuleVisitor for Numbers {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.extend(param.val().into_data().iter::<f32>());
    }
}

fn config() -> DecoderConfig {
    DecoderConfig::new().with_hidden(8).with_blocks(2)
}

fn numbers(decoder: &Decoder) -> Vec<f32> {
    let mut numbers = Numbers::default();
    decoder.visit(&mut numbers);
    numbers.0
}

fn drawn(seed: u64) -> Vec<f32> {
    let device = Device::flex();
    numbers(&seeded(&device, seed, || config().init(&device)))
}

/// The first number that is drawn after something else was done.
fn next_after(work: impl FnOnce()) -> Vec<f32> {
    let device = Device::flex();
    device.seed(3);
    work();
    Tensor::<1>::random([1], Distribution::Default, &device).into_data().iter::<f32>().collect()
}

// One test: two would draw at the same time.
#[test]
fn parameters_are_those_of_their_seed_whatever_other_threads_make_and_reading_draws_none() {
    let expected = [drawn(0), drawn(1)];
    assert_ne!(expected[0], expected[1]);
    let make_many = |seed: usize| (0..50).all(|_| drawn(seed as u64) == expected[seed]);
    std::thread::scope(|scope| {
        let threads = [0, 1, 0, 1].map(|seed| scope.spawn(move || make_many(seed)));
        assert_eq!(threads.map(|thread| thread.join().unwrap()), [true; 4]);
    });

    // Else a model that is read would come between on another thread.
    let (device, config) = (Device::flex(), config());
    let decoder = seeded(&device, 0, || config.init(&device));
    let file = to_safetensors(&decoder, &config).unwrap();
    let record = decoder.clone().into_record().into_bytes().unwrap();
    let read = || {
        let (_, read): (DecoderConfig, Decoder) = from_safetensors(&file, &device).unwrap();
        assert_eq!(numbers(&read), expected[0]);
        let read = config.init(&device).try_load_record(ModuleRecord::from_bytes(record).unwrap()).unwrap();
        assert_eq!(numbers(&read), expected[0]);
    };
    assert_eq!(next_after(read), next_after(|| ()));
}
