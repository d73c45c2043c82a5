//! Methods and their size by name.

use std::sync::LazyLock;

use clap::ValueEnum;
use clap::builder::PossibleValue;
use dvr_train::METHODS;

/// The name of a method of the registry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MethodName(pub &'static str);

impl ValueEnum for MethodName {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: LazyLock<Vec<MethodName>> =
            LazyLock::new(|| METHODS.iter().map(|entry| MethodName(entry.name)).collect());
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let entry = METHODS.iter().find(|entry| entry.name == self.0);
        entry.map(|entry| PossibleValue::new(entry.name).help(entry.about))
    }
}

/// Values of `--capacity`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CapacityArg {
    /// As fine as validation views justify.
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
