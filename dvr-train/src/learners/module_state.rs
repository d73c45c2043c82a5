//! Modules and optimisers as bytes.

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::{ModuleRecord, RecordError};
use burn::tensor::Bytes;

use crate::error::{Error, Result};
use crate::learners::learner::LearnerState;

/// A module's parameters as bytes.
pub(crate) fn module_bytes<M: Module>(module: M) -> Result<Vec<u8>> {
    Ok(module.into_record().into_bytes().map_err(not_stored)?.to_vec())
}

fn not_stored(error: RecordError) -> Error {
    Error::NotStored { problem: error.to_string() }
}

/// A module and its optimiser as bytes.
pub(crate) fn module_state<M: Module>(module: M, optimizer: &ModuleOptimizer) -> Result<LearnerState> {
    let training = optimizer.into_bytes().map_err(not_stored)?.to_vec();
    Ok(LearnerState { model: module_bytes(module)?, training })
}

/// Refuses a configuration of more numbers than its stored parameters have bytes, before a module is made of it.
///
/// # Errors
/// With both figures.
pub(crate) fn check_holds(bytes: &[u8], parameters: u64) -> Result<()> {
    if parameters <= bytes.len() as u64 {
        return Ok(());
    }
    let problem = format!("it asks for {parameters} numbers, and the parameters have {} bytes", bytes.len());
    Err(Error::Misfit { problem })
}

/// Puts stored parameters into a module.
///
/// # Errors
/// When their names or shapes are not those of the module.
pub(crate) fn restore_module<M: Module>(bytes: &[u8], module: M) -> Result<M> {
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec()));
    record.and_then(|record| module.try_load_record(record)).map_err(|e| Error::Misfit { problem: e.to_string() })
}

/// Puts a stored state into an optimiser.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn restore_optimizer(bytes: &[u8], optimizer: ModuleOptimizer) -> Result<ModuleOptimizer> {
    optimizer
        .from_bytes(Bytes::from_bytes_vec(bytes.to_vec()))
        .map_err(|e| Error::Damaged { what: "the optimiser's state", problem: e.to_string() })
}
