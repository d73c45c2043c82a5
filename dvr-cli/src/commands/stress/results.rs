//! Cells as they are stored.

use anyhow::Result;
use dvr_core::record::RecordKey;
use dvr_stress::{Cell, Group};
use serde::Serialize;

use crate::commands::provenance::{KeyColumns, origin};

/// `results.json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Results {
    /// One for each axis, difficulty, method and seed.
    pub cells: Vec<Row>,
}

/// A cell, and what it was made of.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The cell.
    #[serde(flatten)]
    pub cell: Cell,
    /// What it was made of.
    pub key: RecordKey,
}

#[cfg(test)]
impl Row {
    /// A cell as if this program had made it.
    pub fn of_this_program(cell: Cell) -> Self {
        use crate::commands::provenance::record_key;
        let scene = dvr_core::record::Digest::of_bytes(cell.axis.as_bytes());
        Self { cell, key: record_key(scene, &serde_json::Value::Null, "cpu").unwrap() }
    }
}

impl Results {
    /// The cells without their keys.
    pub fn cells(&self) -> impl Iterator<Item = &Cell> {
        self.cells.iter().map(|row| &row.cell)
    }

    /// Where they come from.
    pub fn origin(&self) -> String {
        origin(self.cells.iter().map(|row| Some(&row.key)))
    }
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
        Group::Photographs => "photographs",
        Group::Gradients => "gradients",
    }
}

/// A row of `results.csv`.
#[derive(Serialize)]
struct Columns<'a> {
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
pub fn csv(rows: &[Row]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for Row { cell, key } in rows {
        let figures = cell.figures.as_ref();
        let columns = Columns {
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
        };
        writer.serialize((columns, KeyColumns::of(Some(key))))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
