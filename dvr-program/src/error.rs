//! How a program comes to no good end.

use dvr_core::Cancelled;

/// Why a program did not end with success.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// Somebody wanted the work to end, and the program was ended.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
    /// It could not be started.
    #[error("it could not be started: {0}")]
    NotStarted(std::io::Error),
    /// It was started, and the system does not say how it ended.
    #[error("its end was not heard: {0}")]
    NotHeard(std::io::Error),
    /// All its threads waited for each other, and it was ended.
    #[error("it hung: all its threads waited for each other")]
    Deadlocked,
    /// It ended without success.
    #[error("{0}")]
    Failed(std::process::ExitStatus),
}
