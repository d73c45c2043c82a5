//! How a scene is reconstructed.

use std::path::PathBuf;
use std::time::Duration;

use burn::tensor::Device;
use dvr_core::Supervision;
use dvr_train::{MeshOptions, Method, grid, method_by_name};
use serde_json::Value;

use crate::error::Result;

/// Cells along an edge of the object cube of a mesh, at most, where nothing is said.
const RESOLUTION: usize = 256;

/// How a scene is reconstructed. The defaults are those of `dvr train`: a grid, from photographs, on the CPU.
pub struct Options {
    /// The method with its configuration: seed, steps, supervision and all else. See [`Options::method`] and
    /// [`Options::set`]; any value that implements [`Method`] is as good.
    pub method: Box<dyn Method>,
    /// What computes, without autodiff.
    pub device: Device,
    /// How the field is made a mesh.
    pub mesh: MeshOptions,
    /// Whether small mistakes in the masks are corrected first.
    pub refine_masks: bool,
    /// Rounds, at most, in which cameras are moved to where they fit together first; 0 believes the files.
    pub refine_cameras: usize,
    /// Wall time after which training stops as if its steps were done.
    pub time_limit: Option<Duration>,
    /// Where checkpoints, curves and results are kept; `None` keeps nothing.
    pub folder: Option<PathBuf>,
}

impl Default for Options {
    fn default() -> Self {
        Self::of(Box::new(grid(Supervision::Rgb)))
    }
}

impl Options {
    /// The defaults with a method of one's own.
    pub fn of(method: Box<dyn Method>) -> Self {
        Self {
            method,
            device: Device::flex(),
            mesh: MeshOptions::within_resolution(RESOLUTION),
            refine_masks: true,
            refine_cameras: 0,
            time_limit: None,
            folder: None,
        }
    }

    /// The defaults with a method by its name; [`crate::METHODS`] lists them.
    ///
    /// # Errors
    /// Names the methods that there are.
    pub fn method(name: &str, supervision: Supervision) -> Result<Self> {
        Ok(Self::of(method_by_name(name, supervision)?))
    }

    /// Replaces settings of the method by those of a JSON object, nested like its configuration.
    ///
    /// # Errors
    /// Names the first key that does not exist, or the value that has the wrong type or is out of range.
    pub fn set(&mut self, settings: Value) -> Result<()> {
        self.method = self.method.overridden(&settings)?;
        Ok(())
    }
}
