//! Reconstruction with a multi-resolution voxel grid: photographs with masks and cameras in, a field out.
//!
//! The field is an occupancy logit and a colour, interpolated between the nodes of two grids. It starts from the visual
//! hull, with hollows carved where a plane sweep shows them. Rays meet its surface exactly, at the first root of the
//! cubic that a trilinear cell is along a ray; the gradients of all losses are analytic, and move parameters on nested
//! grids from coarse to fine. Stages of twice the cells follow while the NCC of validation views gains,
//! or is no worse and their pictures gain.
//!
//! A mesh is rendered from a few sides here, and reconstructed:
//!
//! ```
//! use dvr_core::dataset::{ReadOptions, read_scene};
//! use dvr_core::mesh::{TexturedMesh, shapes};
//! use dvr_core::synth::{SynthConfig, render_dataset};
//! use dvr_core::ViewSplit;
//! use dvr_grid::{Capacity, GridConfig, GridTrainer};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = std::env::temp_dir().join(format!("dvr-grid-{}", std::process::id()));
//! let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.45, 32, 16), ..TexturedMesh::default() };
//! let config = SynthConfig { views: 12, width: 32, height: 32, ..SynthConfig::default() };
//! render_dataset(&torus, "torus", "rings", &folder, &config, &|_, _| ())?;
//! let mut scene = read_scene(&folder.join("rings/torus"), &ReadOptions::default())?;
//!
//! let config = GridConfig { steps: 50, capacity: Capacity::Cells(32), ..GridConfig::default() };
//! scene.hold_out(config.hold_out_every);
//! let views = ViewSplit::of(&scene)?;
//! let mut trainer = GridTrainer::new(views.train, views.validation, config)?;
//! while trainer.steps_done() < trainer.total_steps() {
//!     trainer.step()?;
//! }
//! let metrics = trainer.validate(10_000).expect("a view validates");
//! println!("{:.1} dB, IoU {:.3}", metrics.psnr, metrics.mask_iou);
//! assert!(metrics.mask_iou > 0.8);
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok(())
//! # }
//! ```
//!
//! To add a loss term, see [`losses`].

#![warn(missing_docs)]

mod accelerator;
mod active;
mod bricks;
mod clock;
mod color;
mod color_trust;
mod config;
mod config_ranges;
mod constants;
mod cubic;
mod error;
mod exact;
mod exposure;
pub mod field;
#[cfg(feature = "gpu")]
mod gpu;
mod growth;
pub mod losses;
mod memory_estimate;
mod multires;
mod occupancy;
mod patch;
mod picture_pyramid;
mod pixel_order;
mod plane_patch;
mod refinement;
mod report;
mod start;
mod state;
mod step;
mod stereo;
mod surface;
mod trainer;
mod validation_ncc;
mod views;
mod wrong_masks;

pub use active::ActiveNodes;
pub use clock::{Part, PartTimes};
pub use config::{Capacity, ColorTrust, DisagreeingViews, ExposureCorrection, GridConfig};
pub use error::{Error, Result};
#[cfg(feature = "gpu")]
pub use field::GpuGridField;
pub use field::{GridField, GridValues, file as grid_file};
pub use losses::GridLosses;
pub use occupancy::OccupancyBitmask;
pub use report::{StepReport, TrainerState};
pub use trainer::{GridTrainer, Rates, stereo_depths};
