//! The real size of a run: known lengths of arguments, and what the run keeps of them.

use std::path::Path;

use anyhow::{Context, Error, Result, bail};
use dvr_core::Scene;
use dvr_core::dataset::{ReadOptions, places_in_view};
use dvr_core::files::{read_text, write_bytes_atomically};
use dvr_core::mesh::Mesh;
use dvr_train::{CheckpointHeader, KnownLength, RealSize, RunFolder, RunMetrics};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::SceneReading;
use crate::args::{KnownLengthArg, ScaleArg};

/// Known lengths in the views of the scene at `path`, read with `options`.
///
/// # Errors
/// Where there is no such picture, or a pixel is outside of it.
pub fn known_lengths<'a>(
    lengths: impl IntoIterator<Item = &'a KnownLengthArg>,
    path: &Path,
    options: &ReadOptions,
) -> Result<Vec<KnownLength>> {
    let known = lengths.into_iter().map(|KnownLengthArg { text, picture, pixels, metres }| {
        let found = places_in_view(path, options, picture, pixels).with_context(|| format!("--scale {text}"))?;
        let [first, second] = found.places[..] else { bail!("--scale {text}: two pixels are needed") };
        Ok(KnownLength {
            text: text.clone(),
            view: found.view,
            places: [first.to_array(), second.to_array()],
            metres: *metres,
        })
    });
    known.collect()
}

/// What a run keeps.
pub struct KeptSize {
    /// Of its figures, where it has some.
    kept: Option<Option<RealSize>>,
    /// What it began with: all that is known of a run that was stopped before its results.
    lengths: Vec<KnownLength>,
}

/// The part of a run's figures that is read here; runs of other versions may have others beside.
#[derive(Deserialize)]
struct Figures {
    #[serde(default)]
    real_size: Option<RealSize>,
}

impl KeptSize {
    /// Of the run of one scene in a folder.
    ///
    /// # Errors
    /// Where its figures are damaged.
    pub fn of(folder: &RunFolder, header: &CheckpointHeader) -> Result<Self> {
        let path = folder.metrics_json();
        let figures: Option<Figures> = path.is_file().then(|| read_figures(&path)).transpose()?;
        Ok(Self { kept: figures.map(|figures| figures.real_size), lengths: header.lengths.clone() })
    }

    /// The real size of a mesh in object space: by the arguments, else the factor that the run keeps, else by the lengths that
    /// it began with. `scene` is where it was read from and how, with the scene.
    ///
    /// # Errors
    /// Where known lengths cannot be measured.
    pub fn real_size(
        &self,
        args: &[ScaleArg],
        mesh: &Mesh,
        scene: Option<(&Path, &SceneReading, &Scene)>,
        header: &CheckpointHeader,
    ) -> Result<Option<RealSize>> {
        let given = args.iter().filter_map(|arg| match arg {
            ScaleArg::Length(length) => Some(length),
            ScaleArg::Off => None,
        });
        if args.contains(&ScaleArg::Off) {
            return if args.len() == 1 { Ok(None) } else { bail!("--scale off takes no length beside it") };
        }
        if let (Some(kept), true) = (self.kept.clone(), args.is_empty()) {
            return Ok(kept.map(|mut size| {
                let object_to_world = scene.map_or(header.object_to_world, |(.., scene)| scene.object_to_world);
                size.look_at(mesh, &object_to_world);
                size
            }));
        }
        if args.is_empty() && self.lengths.is_empty() {
            return Ok(None);
        }
        let Some((path, reading, scene)) = scene else {
            bail!("known lengths (--scale) need the photographs of the run: give the scene's folder with --data");
        };
        let lengths = match args.is_empty() {
            true => self.lengths.clone(),
            false => known_lengths(given, path, &reading.options)?,
        };
        Ok(Some(RealSize::measure(&lengths, mesh, scene)?))
    }

    /// What a run that goes on measures at its end: the lengths of its figures, which `dvr mesh` may have replaced, else those
    /// that it began with.
    ///
    /// # Errors
    /// Where the figures' lengths cannot be found in the scene at `path`.
    pub fn lengths(self, path: &Path, options: &ReadOptions) -> Result<Vec<KnownLength>> {
        let Some(kept) = self.kept else { return Ok(self.lengths) };
        let texts: Vec<String> = kept.iter().flat_map(|size| &size.lengths).map(|length| length.text.clone()).collect();
        if texts.iter().eq(self.lengths.iter().map(|length| &length.text)) {
            return Ok(self.lengths);
        }
        let parsed = texts.iter().map(|text| text.parse::<KnownLengthArg>().map_err(Error::msg));
        known_lengths(&parsed.collect::<Result<Vec<_>>>()?, path, options)
    }

    /// Keeps the real size of the mesh that was written in place of the run's.
    ///
    /// # Errors
    /// Where the figures cannot be written.
    pub fn keep(self, size: Option<RealSize>, folder: &RunFolder) -> Result<()> {
        if self.kept.is_none_or(|kept| kept == size) {
            return Ok(());
        }
        let path = folder.metrics_json();
        let figures: RunMetrics = read_figures(&path)?;
        let json = serde_json::to_string_pretty(&RunMetrics { real_size: size, ..figures })?;
        Ok(write_bytes_atomically(&path, json.as_bytes())?)
    }

    /// Whether the run has figures to keep it in.
    pub fn has_figures(&self) -> bool {
        self.kept.is_some()
    }
}

/// Refuses a run's own mesh where it is in metres: whoever compares it with the scene takes it for one in the scene's units.
///
/// # Errors
/// Names the mesh and how to write another.
pub fn refuse_metres(mesh: &Path) -> Result<()> {
    let Some(run) = mesh.parent() else { return Ok(()) };
    let folder = RunFolder::new(run.to_owned());
    let is_own = [folder.mesh_ply(), folder.mesh_glb()].iter().any(|own| own.file_name() == mesh.file_name());
    let figures = folder.metrics_json();
    if !is_own || !figures.is_file() {
        return Ok(());
    }
    let size = read_text(&figures).ok().and_then(|text| serde_json::from_str::<Figures>(&text).ok());
    if size.is_some_and(|figures| figures.real_size.is_some()) {
        let run = if run.as_os_str().is_empty() { Path::new(".") } else { run };
        bail!(
            "{}: this mesh is in metres (--scale), and the scene is not. Give the run instead, or write a mesh in the units of \
             the scene: dvr mesh {} --scale off --out FILE",
            mesh.display(),
            run.display()
        );
    }
    Ok(())
}

fn read_figures<T: DeserializeOwned>(path: &Path) -> Result<T> {
    serde_json::from_str(&read_text(path)?)
        .with_context(|| format!("{}: these are no figures of a run", path.display()))
}
