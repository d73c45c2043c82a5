//! Ray marching without gradients: where does each ray first cross the surface? (DVR, section 3.2.)

pub(crate) mod host_rays;
pub(crate) mod marcher;
pub(crate) mod rays;
pub(crate) mod root;
pub(crate) mod snapshot;
pub(crate) mod tensor;

pub use host_rays::HostRays;
pub use marcher::{Hits, March, MarchSettings, Marcher, RayStatus};
pub use rays::Rays;
pub use root::{Bracket, RootMethod};
pub use snapshot::SnapshotMarcher;
pub use tensor::TensorMarcher;
