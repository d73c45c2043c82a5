//! What to say where a graphics processor cannot.

use dvr_gpu::DeviceError;

use crate::error::Error;

/// A device's refusal, with what to do; `less` says what would take less memory.
pub(crate) fn refused(problem: DeviceError, less: &str) -> Error {
    let remedy = match problem {
        DeviceError::OverLimit { what, bytes, held, allowed } => {
            let (what, remedy) =
                (format!("{what} and what is there take"), format!("allow more with --memory; {less}"));
            return Error::Memory { what, bytes: held + bytes, allowed, remedy };
        }
        DeviceError::TooLarge { .. } => format!("{less}; --backend cpu has no such bound"),
        DeviceError::NoGpu | DeviceError::TooFewBindings { .. } | DeviceError::Device(_) => {
            "--backend cpu does without".into()
        }
    };
    Error::Config(format!("{problem}. {remedy}"))
}
