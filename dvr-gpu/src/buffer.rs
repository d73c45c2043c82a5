//! Numbers on the device, in rows without gaps.

use std::sync::atomic::{AtomicUsize, Ordering};

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, DispatchDevice, TensorMetadata};
use burn::tensor::{Device, FloatDType, IntDType, Shape, TensorData};
use cubecl::client::Client;

use crate::memory::{CubeDevice, beyond_limit};

/// Why training on a device cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// It is not a GPU.
    #[error("this device is not a GPU")]
    NoGpu,
    /// Something is larger than the device's largest piece of memory.
    #[error("{what} would take {mebibytes} MiB in one piece, and this GPU has at most {most}")]
    TooLarge {
        /// What it is.
        what: &'static str,
        /// How large it would be.
        mebibytes: u64,
        /// How large it may be.
        most: u64,
    },
    /// There is no room for something within what [`crate::limit_memory`] allows.
    #[error(
        "{what} would take {:.2} MB beside the {:.2} MB that tensors hold, and {:.2} MB are allowed",
        megabytes(*bytes), megabytes(*held), megabytes(*allowed)
    )]
    OverLimit {
        /// What it is.
        what: &'static str,
        /// How large it would be.
        bytes: u64,
        /// How much is in use.
        held: u64,
        /// How much may be.
        allowed: u64,
    },
    /// Its kernels are given too few pieces of memory.
    #[error("this GPU gives a kernel {bindings} pieces of memory, and 11 are needed")]
    TooFewBindings {
        /// How many it gives.
        bindings: u32,
    },
    /// The driver gave up.
    #[error("the GPU failed: {0}")]
    Device(String),
}

/// Millions of bytes.
fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

/// Numbers on the device: f32, i32 or u32, as the kernels that are given them know.
pub type Buffer = FloatTensor<Cube>;

/// Makes buffers, none larger than the device's largest.
pub struct Buffers {
    /// Where kernels are launched.
    pub client: Client,
    device: CubeDevice,
    /// How often the device was waited for.
    reads: AtomicUsize,
}

impl Buffers {
    /// Buffers of a device, and the client through which its kernels are launched.
    ///
    /// # Errors
    /// When it is no GPU.
    pub fn on(device: &Device) -> Result<Self, DeviceError> {
        let DispatchDevice::Cube(device) = device.clone().inner().as_dispatch().clone() else {
            return Err(DeviceError::NoGpu);
        };
        Ok(Self { client: device.client(), device, reads: AtomicUsize::new(0) })
    }

    /// How often the device was waited for.
    pub fn reads(&self) -> usize {
        self.reads.load(Ordering::Relaxed)
    }

    /// The shape of `length` numbers of four bytes, if there is room for them.
    ///
    /// # Errors
    /// When there is none.
    pub fn check(&self, what: &'static str, length: usize) -> Result<Shape, DeviceError> {
        let (bytes, most) = (4 * length as u64, self.client.properties().memory.max_page_size);
        if bytes > most {
            return Err(DeviceError::TooLarge { what, mebibytes: bytes >> 20, most: most >> 20 });
        }
        if let Some((held, allowed)) = beyond_limit(&self.device, bytes) {
            return Err(DeviceError::OverLimit { what, bytes, held, allowed });
        }
        // No buffer is empty: kernels are given something that they do not read.
        Ok(Shape::new([length.max(1)]))
    }

    /// Numbers, brought to the device. `what` names them where there is no room.
    ///
    /// # Errors
    /// When there is no room for them.
    pub fn floats(&self, what: &'static str, mut numbers: Vec<f32>) -> Result<Buffer, DeviceError> {
        let shape = self.check(what, numbers.len())?;
        numbers.resize(shape[0], 0.0);
        Ok(Cube::float_from_data(TensorData::new(numbers, shape), &self.device))
    }

    /// Words, brought to the device. `what` names them where there is no room.
    ///
    /// # Errors
    /// When there is no room for them.
    pub fn words(&self, what: &'static str, mut words: Vec<u32>) -> Result<Buffer, DeviceError> {
        let shape = self.check(what, words.len())?;
        words.resize(shape[0], 0);
        Ok(Cube::int_from_data(TensorData::new(words, shape), &self.device))
    }

    /// Zeros as f32. `what` names them where there is no room.
    ///
    /// # Errors
    /// When there is no room for them.
    pub fn zero_floats(&self, what: &'static str, length: usize) -> Result<Buffer, DeviceError> {
        Ok(Cube::float_zeros(self.check(what, length)?, &self.device, FloatDType::F32))
    }

    /// Zeros as i32 or u32.
    ///
    /// # Errors
    /// When there is no room for them.
    pub fn zeros(&self, what: &'static str, length: usize, kind: IntDType) -> Result<Buffer, DeviceError> {
        Ok(Cube::int_zeros(self.check(what, length)?, &self.device, kind))
    }

    /// Reads buffers back, all at once, as words: what the device was given before is waited for.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read(&self, buffers: &[&Buffer]) -> Result<Vec<Vec<u32>>, DeviceError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let handles = buffers.iter().map(|buffer| buffer.handle.clone()).collect();
        let bytes = self.client.read(handles).map_err(|e| DeviceError::Device(e.to_string()))?;
        let read = bytes.iter().zip(buffers).map(|(bytes, buffer)| {
            let (words, _) = bytes.as_chunks::<4>();
            words.iter().take(buffer.shape()[0]).map(|&word| u32::from_le_bytes(word)).collect()
        });
        Ok(read.collect())
    }
}
