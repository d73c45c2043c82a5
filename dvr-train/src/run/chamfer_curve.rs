//! How the shape comes nearer to the truth while training goes on: measured beside the clock.

use std::time::Instant;

use burn::tensor::Device;
use dvr_core::PointCloud;
use dvr_core::metrics::shape::{EMPTY_DISTANCE, score_surface};
use dvr_core::sampling::sample_surface;
use dvr_render::extract::{ExtractSettings, extract_mesh};

use crate::error::Result;
use crate::learners::learner::Learner;
use crate::methods::method::Method;
use crate::resources::Resources;

/// Cells along an edge of the meshes: their error is far below that of a field in training.
const RESOLUTION: usize = 128;

/// Points of each mesh.
const SAMPLES: usize = 30_000;

/// Compares what a run has learned so far with the true surface, and keeps account of the time that this takes.
pub(crate) struct ChamferCurve<'a> {
    truth: &'a PointCloud,
    device: Device,
    /// Wall and CPU seconds spent here.
    spent: [f64; 2],
}

impl<'a> ChamferCurve<'a> {
    pub fn new(truth: &'a PointCloud, device: Device) -> Self {
        Self { truth, device, spent: [0.0; 2] }
    }

    /// Wall and CPU seconds spent so far.
    pub fn spent(&self) -> [f64; 2] {
        self.spent
    }

    /// Chamfer-L1 of what the learner has learned so far, in object units; of nothing, where there is no surface.
    ///
    /// # Errors
    /// When the model cannot be had, or the truth is broken.
    pub fn chamfer_l1(&mut self, method: &dyn Method, learner: &dyn Learner) -> Result<f64> {
        let (wall, cpu) = (Instant::now(), Resources::now().cpu_seconds);
        let model = method.load(&learner.model()?, &self.device)?;
        let settings = ExtractSettings { resolution: RESOLUTION, upsampling_steps: 1, ..ExtractSettings::default() };
        let chamfer = match extract_mesh(model.as_ref(), &settings, &[]) {
            Ok(extracted) => {
                let found = PointCloud::from(sample_surface(&extracted.mesh, SAMPLES, method.common().seed));
                score_surface(&found, self.truth, &[])?.chamfer_l1
            }
            Err(_) => EMPTY_DISTANCE,
        };
        self.spent[0] += wall.elapsed().as_secs_f64();
        self.spent[1] += Resources::now().cpu_seconds - cpu;
        Ok(chamfer)
    }
}
