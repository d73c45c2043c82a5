//! A method as data: what a checkpoint says of it.

use dvr_core::Supervision;
use serde::{Deserialize, Serialize};

/// The name of a method and its configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodRecord {
    /// The method's name.
    pub method: String,
    /// Its configuration, keys as in the method's own documentation.
    pub config: serde_json::Value,
}

/// The settings that every method has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CommonSettings {
    /// Which measurements the shape is learned from.
    pub supervision: Supervision,
    /// Seed of all random choices.
    pub seed: u64,
    /// Optimiser steps, those of a stage where a method has stages.
    pub steps: usize,
    /// One view in this many is for testing, and one in twice as many for validation, where the dataset does not say
    /// ([`dvr_core::Scene::hold_out`]); 0 trains on all.
    pub hold_out_every: usize,
}

impl MethodRecord {
    /// The configuration as indented JSON, for people.
    pub fn pretty(&self) -> String {
        format!("{:#}", self.config)
    }
}
