//! What to say where a graphics processor cannot.

use dvr_gpu::FastError;

use crate::error::Error;

/// A device's refusal, with what to do; `less` says what would take less memory.
pub(crate) fn refused(problem: FastError, less: &str) -> Error {
    let remedy = match problem {
        FastError::OverLimit { what, bytes, held, allowed } => {
            let (what, remedy) =
                (format!("{what} and what is there take"), format!("allow more with --memory; {less}"));
            return Error::Memory { what, bytes: held + bytes, allowed, remedy };
        }
        FastError::TooLarge { .. } => format!("{less}; --backend cpu has no such bound"),
        FastError::NoGpu | FastError::TooFewBindings { .. } | FastError::Device(_) => {
            "--backend cpu does without".into()
        }
    };
    Error::Config(format!("{problem}. {remedy}"))
}
