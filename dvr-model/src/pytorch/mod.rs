//! Checkpoints of DVR's reference code, and torchvision's pretrained ResNet-18: PyTorch files, zip and legacy, without PyTorch.
//!
//! A checkpoint (`im2mesh/checkpoints.py`) is a dictionary with the state dict `model` (names `decoder.*`,
//! `encoder.*`), in most files the state of Adam as `optimizer`, and the numbers `epoch_it`, `it` and `loss_val_best`.
//! It does not hold the configuration: that follows from the tensors' shapes, but for whether the decoder is `leaky`.

mod architecture;
mod checkpoint;
mod file;
mod optimizer;
mod pretrained;

pub use checkpoint::{Imported, ImportedNetwork, PytorchCheckpoint, read_pytorch};
pub use optimizer::AdamMoments;
pub use pretrained::load_pretrained;
