//! The ways to reconstruct a scene, or to learn from many: the list of those that are known by name.
//!
//! A new one is a file beside these, with a function that makes it, and a line in [`METHODS`]. One that is not in the
//! list works as well, but for checkpoints that are to be opened by name.

pub(crate) mod classic;
pub(crate) mod field_method;
mod field_model;
pub(crate) mod grid;
mod grid_model;
pub(crate) mod host_memory;
pub(crate) mod hull;
pub(crate) mod memory_estimate;
pub(crate) mod method;
pub(crate) mod network;
pub(crate) mod object_model;
pub(crate) mod objects;
pub(crate) mod overrides;
pub(crate) mod record;
pub(crate) mod systems;
pub(crate) mod trained_model;

use burn::tensor::Device;
use dvr_core::Supervision;

use crate::error::{Error, Result};
use crate::methods::systems::SystemMethod;
use crate::objects::ObjectsConfig;
use crate::objects::systems::config::System;
use crate::run::checkpoint::Checkpoint;
use method::Method;
use record::MethodRecord;
use trained_model::TrainedModel;

/// A method that is known by name.
pub struct MethodEntry {
    /// Its name.
    pub name: &'static str,
    /// What it is, for people.
    pub about: &'static str,
    /// Whether it learns from a dataset of many objects rather than from one scene.
    pub learns_objects: bool,
    /// What it can learn from; the first is its default.
    pub supervisions: &'static [Supervision],
    /// Makes it with its defaults.
    pub new: fn(Supervision) -> Box<dyn Method>,
}

/// What DVR learns from.
const ANY: &[Supervision] = &[Supervision::Rgb, Supervision::Depth, Supervision::RgbDepth, Supervision::Occupancy];

/// 3D.
const OCCUPANCY: &[Supervision] = &[Supervision::Occupancy];

/// All methods. The first of each kind is the default.
#[rustfmt::skip]
pub static METHODS: &[MethodEntry] = &[
    scene("grid", "a multi-resolution voxel grid: seconds", |s| Box::new(grid::grid(s))),
    scene("network", "DVR's network, started from the visual hull: minutes", |s| Box::new(network::network(s))),
    scene("classic", "DVR's network with the paper's settings: minutes for 600 steps (the paper: 300 000)", |s| Box::new(classic::classic(s))),
    scene("hull", "the visual hull of the masks, coloured by the photographs: no training", |s| Box::new(hull::hull(s))),
    dataset("objects", ANY, "one network for many objects, of a size for a few cores: an hour", |s| Box::new(objects::objects(s))),
    dataset("objects-classic", ANY, "the same with the paper's settings: months without a GPU", |s| Box::new(objects::objects_classic(s))),
    dataset("onet", OCCUPANCY, "Occupancy Networks (Mescheder et al. 2019): fields, from 3D", |_| Box::new(objects::onet())),
    system(System::R2n2, "3D-R2N2 (Choy et al. 2016), of one picture: voxels, from 3D", |s| Box::new(SystemMethod::new(System::R2n2, s))),
    system(System::Psgn, "Point Set Generation (Fan et al. 2017): points, from 3D", |s| Box::new(SystemMethod::new(System::Psgn, s))),
    system(System::AtlasNet, "AtlasNet (Groueix et al. 2018): pieces of surface, from 3D", |s| Box::new(SystemMethod::new(System::AtlasNet, s))),
    system(System::Pixel2Mesh, "Pixel2Mesh (Wang et al. 2018): a ball, deformed by features of the picture, from 3D", |s| Box::new(SystemMethod::new(System::Pixel2Mesh, s))),
    system(System::Drc, "Differentiable Ray Consistency (Tulsiani et al. 2017): voxels, from masks or depth maps", |s| Box::new(SystemMethod::new(System::Drc, s))),
    system(System::SoftRas, "Soft Rasterizer (Liu et al. 2019): a deformed sphere, from masks", |s| Box::new(SystemMethod::new(System::SoftRas, s))),
];

const fn scene(name: &'static str, about: &'static str, new: fn(Supervision) -> Box<dyn Method>) -> MethodEntry {
    MethodEntry { name, about, learns_objects: false, supervisions: ANY, new }
}

const fn dataset(
    name: &'static str,
    supervisions: &'static [Supervision],
    about: &'static str,
    new: fn(Supervision) -> Box<dyn Method>,
) -> MethodEntry {
    MethodEntry { name, about, learns_objects: true, supervisions, new }
}

const fn system(system: System, about: &'static str, new: fn(Supervision) -> Box<dyn Method>) -> MethodEntry {
    dataset(system.name(), system.supervisions(), about, new)
}

/// The method of a name, with its defaults; without a supervision, with its own.
///
/// # Errors
/// Names the methods that there are, or what the method learns from.
pub fn method_by_name(name: &str, supervision: impl Into<Option<Supervision>>) -> Result<Box<dyn Method>> {
    let entry = METHODS.iter().find(|entry| entry.name == name);
    let entry = entry.ok_or_else(|| Error::UnknownMethod {
        name: name.to_owned(),
        known: METHODS.iter().map(|entry| entry.name).collect(),
    })?;
    let supervision = supervision.into().unwrap_or(entry.supervisions[0]);
    if !entry.supervisions.contains(&supervision) {
        return Err(Error::OtherSupervision { method: entry.name, supervision, known: entry.supervisions });
    }
    Ok((entry.new)(supervision))
}

/// The method that a checkpoint names, with its configuration.
///
/// # Errors
/// When there is no method of that name, or it does not take the configuration.
pub fn method_of(record: &MethodRecord) -> Result<Box<dyn Method>> {
    method_by_name(&record.method, None)?.with_overrides(&ObjectsConfig::completed(&record.config))
}

/// The field that a checkpoint holds.
///
/// # Errors
/// When the method is not known by name, or its model is damaged.
pub fn load_model(checkpoint: &Checkpoint, device: &Device) -> Result<Box<dyn TrainedModel>> {
    method_of(&checkpoint.header.method)?.load(&checkpoint.state.model, device)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn every_method_is_found_by_its_name_and_survives_a_record() {
        for entry in METHODS {
            for &supervision in entry.supervisions {
                if !entry.learns_objects && supervision == Supervision::Occupancy {
                    continue;
                }
                let method = method_by_name(entry.name, supervision).unwrap();
                if entry.name != "hull" {
                    assert_eq!(method.common().supervision, supervision);
                }
                assert_eq!((method.name(), method.objects().is_some()), (entry.name, entry.learns_objects));
                method.check().unwrap();
                let record = method.overridden(&json!({"seed": 7, "steps": 3})).unwrap().record().unwrap();
                let again = method_of(&record).unwrap();
                assert_eq!(again.record().unwrap(), record);
                assert_eq!((again.common().seed, again.common().steps), (7, 3));
            }
        }
        let unknown = method_by_name("nerf", Supervision::Rgb).unwrap_err();
        assert!(unknown.to_string().contains("grid"), "{unknown}");
        let refused = method_by_name("psgn", Supervision::Depth).unwrap_err();
        assert!(refused.to_string().contains("occupancy"), "{refused}");
        assert_eq!(method_by_name("psgn", None).unwrap().common().supervision, Supervision::Occupancy);
    }
}
