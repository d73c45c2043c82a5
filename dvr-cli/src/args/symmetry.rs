//! `--symmetry`.

use clap::ValueEnum;

/// Whether objects are taken for their own mirror images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SymmetryArg {
    /// A shape is the mean of what is said of a point and of its mirror image
    On,
    /// A shape is what is said of its points
    Off,
}

impl SymmetryArg {
    /// Whether they are.
    pub fn is_on(self) -> bool {
        self == Self::On
    }

    /// As it is written.
    pub fn name(self) -> &'static str {
        if self.is_on() { "on" } else { "off" }
    }
}
