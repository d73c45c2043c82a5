//! The benchmark page of `bench` and `stress`: `charts/*.svg`, `charts/*.csv`, and `report.html` with all of them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_report::chart::file_name;
use dvr_report::{Page, Section};

/// A page in the making.
pub struct BenchmarkPage {
    folder: PathBuf,
    sections: Vec<Section>,
}

impl BenchmarkPage {
    /// A page without sections, for this folder.
    pub fn new(folder: &Path) -> Result<Self> {
        let charts = folder.join("charts");
        std::fs::create_dir_all(&charts).with_context(|| charts.display().to_string())?;
        Ok(Self { folder: folder.to_owned(), sections: Vec::new() })
    }

    /// Adds a section of HTML.
    pub fn push(&mut self, title: &str, html: String) {
        self.sections.push(Section::new(title, html));
    }

    /// Writes a chart under its name.
    pub fn save_chart(&self, name: &str, svg: &str, csv: &str) -> Result<()> {
        let path = self.folder.join("charts").join(file_name(name));
        write_bytes_atomically(&path.with_extension("svg"), svg.as_bytes())?;
        Ok(write_bytes_atomically(&path.with_extension("csv"), csv.as_bytes())?)
    }

    /// Writes the page; `origin` says where its figures come from.
    pub fn save(self, title: &str, origin: &str) -> Result<()> {
        let footer = "This file is complete: it loads nothing from the network.".to_owned();
        let page = Page { title: title.into(), subtitle: origin.into(), sections: self.sections, footer };
        Ok(write_bytes_atomically(&self.folder.join("report.html"), page.to_html().as_bytes())?)
    }
}
