//! What a run has learned, ready to be rendered, extracted and stored.

use std::path::Path;

use dvr_render::Shader;
use dvr_render::extract::ScalarField;

use crate::error::{Error, Result};

/// A trained field, whatever the method: its surface through [`ScalarField`], its pictures through [`Shader`].
pub trait TrainedModel: ScalarField + Send {
    /// What rays see of it; a field that is sampled is sampled at so many points across the cube, and not where a
    /// coarse grid says that it is empty.
    fn shader(&self, samples: usize) -> Box<dyn Shader + '_>;

    /// The same, but a sampled field is sampled everywhere: for parts that the grid of [`TrainedModel::shader`] misses.
    fn thorough_shader(&self) -> Box<dyn Shader + '_>;

    /// How many numbers it consists of.
    fn parameters(&self) -> usize;

    /// Writes the network for other programs, as safetensors.
    ///
    /// # Errors
    /// When there is no network, or the file cannot be written.
    fn save_network(&self, path: &Path) -> Result<()> {
        let _ = path;
        Err(Error::NoNetwork)
    }
}
