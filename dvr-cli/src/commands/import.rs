//! `dvr import`: a checkpoint of DVR's reference code as a run.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::Similarity;
use dvr_core::dataset::{Normalise, ObjectOptions, is_object_dataset, read_scene};
use dvr_core::files::check_beside_data;
use dvr_core::npz::NpzFile;
use dvr_model::{ImportedNetwork, PytorchCheckpoint, read_pytorch};
use dvr_train::{ImportOptions, ImportedScene, ReferenceConfig, RunFolder, import};

use super::{SceneReading, print_notes};
use crate::args::ImportArgs;
use crate::backend::Backend;

/// Reads, translates, writes.
pub fn run(args: &ImportArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    let device = Backend::Cpu.device()?;
    let folder = RunFolder::new(&args.out);
    folder.check(args.overwrite)?;
    if let Some(data) = &args.data {
        check_beside_data(&args.out, data)?;
    }
    let config = args.yaml.as_deref().map(ReferenceConfig::read).transpose()?;
    let leaky = args.leaky || config.as_ref().is_some_and(|config| config.train.model.leaky);
    let file = || args.file.display().to_string();
    let mut found = read_pytorch(&args.file, leaky, &device).with_context(file)?;
    let codes = args.codes.as_deref().map(read_codes).transpose()?;
    let scene = args.data.as_deref().map(|data| scene_of(data, args, config.as_ref(), cancellation)).transpose()?;
    let checkpoint = import(&mut found, ImportOptions { config, scene, codes }, &device).with_context(file)?;

    let _writing = if args.overwrite { folder.replace()? } else { folder.create()? };
    dvr_core::files::write_bytes_atomically(&folder.config(), checkpoint.header.method.pretty().as_bytes())?;
    checkpoint.save(&folder.last())?;
    print_notes(&found.notes);
    println!("{}", summary(&found));
    println!("wrote {} after {} steps", folder.last().display(), checkpoint.header.step);
    println!("next: {}", next(&found, args));
    Ok(ExitCode::SUCCESS)
}

/// The checkpoint in one line.
fn summary(found: &PytorchCheckpoint) -> String {
    let (decoder, encoder, has_moments) = match &found.network {
        ImportedNetwork::Decoder(network) => (&network.config, None, network.adam.is_some()),
        ImportedNetwork::ImageModel(network) => {
            (&network.config.decoder, Some(&network.config.encoder), network.adam.is_some())
        }
    };
    format!(
        "decoder of {} blocks of width {}, codes of length {}, {}, {} the state of Adam",
        decoder.blocks,
        decoder.hidden,
        decoder.code_dim,
        encoder.map_or("no encoder".into(), |encoder| format!("{encoder:?}")),
        if has_moments { "with" } else { "without" },
    )
}

/// The command to try next.
fn next(found: &PytorchCheckpoint, args: &ImportArgs) -> String {
    let out = args.out.display();
    match &found.network {
        ImportedNetwork::ImageModel(network) if network.config.encoder.image_size().is_some() => {
            format!("dvr predict {out} IMAGE --out DIR")
        }
        ImportedNetwork::ImageModel(_) => format!("dvr mesh {out} --object 0 --out mesh.glb"),
        ImportedNetwork::Decoder(_) if args.codes.is_some() => {
            format!("dvr mesh {out} --object 0 --out mesh.glb")
        }
        ImportedNetwork::Decoder(_) => format!("dvr mesh {out}"),
    }
}

/// The codes of objects: the array `codes` of an NPZ file, or its only one, `[objects, length]`.
fn read_codes(path: &Path) -> Result<Vec<Vec<f32>>> {
    let mut file = NpzFile::open(path)?;
    let name = match file.names() {
        names if names.iter().any(|name| name == "codes") => "codes".to_owned(),
        [only] => only.clone(),
        names => bail!("{}: there is no array \"codes\" among {}", path.display(), names.join(", ")),
    };
    let array = file.read(&name)?;
    let [_, length] = array.shape[..] else {
        bail!("{}: {name} has the shape {:?}; one row per object is expected", path.display(), array.shape);
    };
    if length == 0 {
        bail!("{}: {name} has rows of length 0", path.display());
    }
    let values = array.to_f64();
    if values.iter().any(|value| !value.is_finite()) {
        bail!("{}: {name} has values that are not finite", path.display());
    }
    Ok(values.chunks_exact(length).map(|row| row.iter().map(|&value| value as f32).collect()).collect())
}

/// The scene or dataset of the run. Object space is that of the files, as in DVR's reference code.
fn scene_of(
    data: &Path,
    args: &ImportArgs,
    config: Option<&ReferenceConfig>,
    cancellation: &Cancellation,
) -> Result<ImportedScene> {
    let mut reading = SceneReading::of_arguments(&args.reading);
    let options = &mut reading.options;
    options.normalise = Normalise::Files;
    options.cancellation = cancellation.clone();
    if let Some(config) = config {
        options.visual_hull_depth |= config.reading.visual_hull_depth;
        options.ignored_views.extend(config.reading.ignored_views.clone());
    }
    let path = data.to_owned();
    if is_object_dataset(data)? {
        let options = ObjectOptions { visual_hull_depth: options.visual_hull_depth, ..ObjectOptions::default() };
        return Ok(ImportedScene {
            path,
            reading: serde_json::to_value(options)?,
            object_to_world: Similarity::default(),
        });
    }
    let object_to_world = read_scene(data, options)?.object_to_world;
    Ok(ImportedScene { path, reading: serde_json::to_value(reading)?, object_to_world })
}
