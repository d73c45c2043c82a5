//! Methods and their size by name.

use clap::ValueEnum;

/// Reconstruction methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Multi-resolution voxel grid: seconds
    Grid,
    /// The paper's network, initialised with the visual hull: minutes; for datasets of objects, a network for a few cores:
    /// an hour
    Network,
    /// The network with the paper's settings: minutes for 600 steps (the paper: 300 000); for datasets of objects: months
    /// without a GPU
    Classic,
    /// The visual hull of the masks, coloured by the photographs: no training
    Hull,
}

/// Values of `--capacity`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CapacityArg {
    /// As fine as held-out views justify.
    Auto,
    /// Cells per edge.
    Cells(usize),
}

/// Reads `auto` or a number of cells.
pub(super) fn parse_capacity(text: &str) -> Result<CapacityArg, String> {
    if text == "auto" {
        return Ok(CapacityArg::Auto);
    }
    let cells = text.parse::<usize>().ok().filter(|n| n.is_power_of_two() && (32..=512).contains(n));
    cells.map(CapacityArg::Cells).ok_or_else(|| format!("{text:?}: write auto, or a power of two from 32 to 512"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_capacity_is_auto_or_a_power_of_two() {
        assert_eq!((parse_capacity("64"), parse_capacity("auto")), (Ok(CapacityArg::Cells(64)), Ok(CapacityArg::Auto)));
        assert!(parse_capacity("65").is_err() && parse_capacity("much").is_err());
    }
}
