//! A run that meets a full disk, or is killed, at each of its operations on files in turn: what lies in its folder is
//! whole, and the run that goes on ends with the same bytes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use dvr_core::Scene;
use dvr_core::files::fault::{Fault, inject};
use dvr_core::mesh::{TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_train::{
    Checkpoint, MeshOptions, Method, Result, RunFolder, RunOptions, Supervision, finish, load_model, method_by_name,
    train,
};
use safetensors::SafeTensors;

/// Starts a run or goes on with it, to its end.
fn run(scene: &Scene, method: &dyn Method, root: &Path) -> Result<()> {
    let folder = RunFolder::new(root);
    let has_checkpoint = folder.last().exists();
    let _writing = if has_checkpoint { folder.resume()? } else { folder.create()? };
    let checkpoint = has_checkpoint.then(|| Checkpoint::load(&folder.last())).transpose()?;
    let options = RunOptions::new(folder.clone(), Device::flex());
    let mut scene = scene.clone();
    let trained = train(&mut scene, method, checkpoint.as_ref(), &options, &mut ())?;
    finish(&scene, method, &trained, &folder, &MeshOptions::with_resolution(16), &mut ())?;
    Ok(())
}

/// What a run leaves, without times.
fn results(root: &Path) -> BTreeMap<&'static str, Vec<u8>> {
    let folder = RunFolder::new(root);
    let file = |path: PathBuf| std::fs::read(path).unwrap();
    // Checkpoints also hold the names by which burn tells parameters apart, which are drawn at random, and the head of a
    // network's file is in random order.
    let network = |path: PathBuf| {
        let exported = root.with_extension("safetensors");
        let model = load_model(&Checkpoint::load(&path).unwrap(), &Device::flex()).unwrap();
        model.save_network(&exported).unwrap();
        let file = file(exported);
        let tensors = SafeTensors::deserialize(&file).unwrap();
        let sorted: BTreeMap<&str, _> = tensors.iter().collect();
        sorted.iter().flat_map(|(name, tensor)| [name.as_bytes(), tensor.data()].concat()).collect()
    };
    let csv = String::from_utf8(file(folder.metrics_csv())).unwrap();
    let steps: Vec<&str> = csv.lines().filter_map(|line| line.split(',').next()).collect();
    BTreeMap::from([
        // Without a surface there is none, and then there must be none.
        ("mesh.ply", std::fs::read(folder.mesh_ply()).unwrap_or_default()),
        ("mesh.glb", std::fs::read(folder.mesh_glb()).unwrap_or_default()),
        ("preview.png", file(folder.preview())),
        ("last.ckpt", network(folder.last())),
        ("best.ckpt", network(folder.best())),
        ("steps of metrics.csv", steps.join(",").into_bytes()),
    ])
}

/// Names of temporary files in a folder.
fn temporary_files(root: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.ends_with(".dvr-tmp") || name.ends_with(".lock")).collect()
}

#[test]
fn a_run_ends_with_the_same_bytes_whichever_operation_on_files_is_refused_or_its_last() {
    let folder = tempfile::tempdir().unwrap();
    let ball = TexturedMesh { mesh: shapes::icosphere(2, 1.0), ..TexturedMesh::default() };
    let few = SynthConfig {
        views: 12,
        width: 16,
        height: 16,
        surface_points: 100,
        occupancy_points: 100,
        ..Default::default()
    };
    render_dataset(&ball, "ball", "balls", folder.path(), &few, &|_, _| ()).unwrap();
    let mut scene = Scene::read(folder.path().join("balls/ball")).unwrap();
    // The best step goes by views for validation.
    scene.hold_out(8);
    let small = serde_json::json!({
        "steps": 6, "rays": 16, "validate_every": 2, "checkpoint_every": 3,
        "model": { "hidden": 16, "octaves": 2 },
        "hull": { "resolution": 16, "warm_start_steps": 40, "warm_start_points": 256 },
    });
    let method = method_by_name("network", Supervision::Rgb).unwrap().overridden(&small).unwrap();
    let whole = folder.path().join("whole");
    run(&scene, method.as_ref(), &whole).unwrap();
    let expected = results(&whole);
    for fault in [Fault::Refused, Fault::Killed] {
        let mut operations = 0;
        loop {
            let root = folder.path().join(format!("{fault:?}{operations}"));
            let injected = inject(fault, operations);
            let ended = run(&scene, method.as_ref(), &root);
            let has_struck = injected.has_struck();
            drop(injected);
            let at = format!("{fault:?} at operation {operations}");
            assert_eq!(ended.is_err(), has_struck, "{at}: {ended:?}");
            if fault == Fault::Refused {
                assert_eq!(temporary_files(&root), [""; 0], "{at}");
            }
            run(&scene, method.as_ref(), &root).unwrap_or_else(|error| panic!("{at}: {error}"));
            assert_eq!(temporary_files(&root), [""; 0], "{at}, resumed");
            for (name, bytes) in results(&root) {
                assert!(bytes == expected[name], "{at}: {name} differs");
            }
            std::fs::remove_dir_all(&root).unwrap();
            if !has_struck {
                break;
            }
            operations += 1;
        }
        assert!(operations > 60, "{operations} operations");
    }
}
