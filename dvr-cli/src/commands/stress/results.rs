//! Cells as they are stored.

use anyhow::Result;
use dvr_stress::{Cell, Group};
use serde::{Deserialize, Serialize};

use crate::commands::machine::Machine;

/// `results.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// The machine and the program.
    pub machine: Machine,
    /// One for each axis, difficulty, method and seed.
    pub cells: Vec<Cell>,
}

/// Name of a group.
pub fn group_name(group: Group) -> &'static str {
    match group {
        Group::Shape => "shape",
        Group::Texture => "texture",
        Group::Views => "views",
        Group::Masks => "masks",
        Group::Cameras => "cameras",
        Group::Pictures => "pictures",
        Group::Gradients => "gradients",
    }
}

/// A row of `results.csv`.
#[derive(Serialize)]
struct Row<'a> {
    axis: &'a str,
    difficulty: f64,
    method: &'a str,
    seed: u64,
    verdict: &'static str,
    value: Option<f64>,
    chamfer_l1: Option<f64>,
    floor: Option<f64>,
    faces: Option<usize>,
    closed: Option<bool>,
    components: Option<usize>,
    handles: Option<i64>,
    part_distance: Option<f64>,
    note: Option<&'a str>,
}

/// All cells, one per line.
pub fn csv(cells: &[Cell]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for cell in cells {
        let figures = cell.figures.as_ref();
        writer.serialize(Row {
            axis: &cell.axis,
            difficulty: cell.difficulty,
            method: &cell.method,
            seed: cell.seed,
            verdict: cell.verdict.name(),
            value: cell.value,
            chamfer_l1: figures.and_then(|f| f.chamfer_l1),
            floor: figures.map(|f| f.floor),
            faces: figures.map(|f| f.faces),
            closed: figures.map(|f| f.topology.closed),
            components: figures.map(|f| f.topology.components),
            handles: figures.and_then(|f| f.topology.handles()),
            part_distance: figures.and_then(|f| f.part_distance),
            note: cell.note.as_deref(),
        })?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
