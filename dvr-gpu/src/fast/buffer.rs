//! Numbers on the device, in rows without gaps.

use std::sync::atomic::{AtomicUsize, Ordering};

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, TensorMetadata};
use burn::tensor::{FloatDType, IntDType, Shape, TensorData};
use cubecl::client::Client;

use super::FastError;
use crate::memory::{CubeDevice, beyond_limit};

/// Numbers on the device: f32, i32 or u32, as the kernels that are given them know.
pub(super) type Buffer = FloatTensor<Cube>;

/// Makes buffers, none larger than the device's largest.
pub(super) struct Buffers {
    pub client: Client,
    device: CubeDevice,
    /// How often the device was waited for.
    reads: AtomicUsize,
}

impl Buffers {
    pub fn new(client: Client, device: CubeDevice) -> Self {
        Self { client, device, reads: AtomicUsize::new(0) }
    }

    /// How often the device was waited for.
    pub fn reads(&self) -> usize {
        self.reads.load(Ordering::Relaxed)
    }

    /// Whether so many numbers of four bytes find room.
    pub fn check(&self, what: &'static str, length: usize) -> Result<Shape, FastError> {
        let (bytes, most) = (4 * length as u64, self.client.properties().memory.max_page_size);
        if bytes > most {
            return Err(FastError::TooLarge { what, mebibytes: bytes >> 20, most: most >> 20 });
        }
        if let Some((held, allowed)) = beyond_limit(&self.device, bytes) {
            return Err(FastError::OverLimit { what, bytes, held, allowed });
        }
        // No buffer is empty: kernels are given something that they do not read.
        Ok(Shape::new([length.max(1)]))
    }

    pub fn floats(&self, what: &'static str, mut numbers: Vec<f32>) -> Result<Buffer, FastError> {
        let shape = self.check(what, numbers.len())?;
        numbers.resize(shape[0], 0.0);
        Ok(Cube::float_from_data(TensorData::new(numbers, shape), &self.device))
    }

    pub fn words(&self, what: &'static str, mut words: Vec<u32>) -> Result<Buffer, FastError> {
        let shape = self.check(what, words.len())?;
        words.resize(shape[0], 0);
        Ok(Cube::int_from_data(TensorData::new(words, shape), &self.device))
    }

    pub fn zero_floats(&self, what: &'static str, length: usize) -> Result<Buffer, FastError> {
        Ok(Cube::float_zeros(self.check(what, length)?, &self.device, FloatDType::F32))
    }

    /// Zeros as i32 or u32.
    pub fn zeros(&self, what: &'static str, length: usize, kind: IntDType) -> Result<Buffer, FastError> {
        Ok(Cube::int_zeros(self.check(what, length)?, &self.device, kind))
    }

    /// Reads buffers back, all at once, as words: what the device was given before is waited for.
    pub fn read(&self, buffers: &[&Buffer]) -> Result<Vec<Vec<u32>>, FastError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let handles = buffers.iter().map(|buffer| buffer.handle.clone()).collect();
        let bytes = self.client.read(handles).map_err(|e| FastError::Device(e.to_string()))?;
        let read = bytes.iter().zip(buffers).map(|(bytes, buffer)| {
            let (words, _) = bytes.as_chunks::<4>();
            words.iter().take(buffer.shape()[0]).map(|&word| u32::from_le_bytes(word)).collect()
        });
        Ok(read.collect())
    }
}
