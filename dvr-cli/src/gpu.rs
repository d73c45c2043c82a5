//! GPUs: opening one, and the error message when it fails.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind, set_hook};
use std::process::ExitCode;
use std::sync::{Mutex, Once, PoisonError};

use anyhow::{Result, anyhow};
use burn::tensor::Device;
use dvr_gpu::{Adapter, AdapterKind, Gpu};

/// The open device, for messages.
static OPEN: Mutex<Option<String>> = Mutex::new(None);

/// The first panic since then: its message and place.
static FIRST_PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Opens one of the GPUs that `dvr devices` lists, and warns of software adapters.
pub fn open(index: usize) -> Result<Device> {
    let Gpu { device, adapter } = dvr_gpu::open(index)?;
    static SHOWN: Once = Once::new();
    SHOWN.call_once(|| {
        eprintln!("computing on gpu:{index}, {} ({})", adapter.name, adapter.api);
        if adapter.kind == AdapterKind::Software {
            eprintln!("warning: this is a software adapter, far slower than --backend cpu");
        }
        keep_panics(format!("gpu:{index} ({})", adapter.name));
    });
    Ok(device)
}

/// Opens an NVIDIA GPU through CUDA.
#[cfg(feature = "cuda")]
pub fn open_cuda(index: usize) -> Result<Device> {
    let device = dvr_gpu::open_cuda(index)?;
    static SHOWN: Once = Once::new();
    SHOWN.call_once(|| keep_panics(format!("cuda:{index}")));
    Ok(device)
}

/// One adapter as a line of text.
pub fn describe(adapter: &Adapter) -> String {
    let driver = if adapter.driver.is_empty() { String::new() } else { format!(", driver {}", adapter.driver) };
    let kind = match adapter.kind {
        AdapterKind::Software => "software adapter, for tests".to_owned(),
        kind => format!("{kind} GPU"),
    };
    let mebibytes = adapter.max_buffer_bytes >> 20;
    format!(
        "gpu:{:<3} {} ({kind}, {}{driver}; at most {mebibytes} MiB per tensor, {} KiB of shared memory per workgroup)",
        adapter.index,
        adapter.name,
        adapter.api,
        adapter.shared_memory_bytes >> 10,
    )
}

/// From here on, a panic is kept for [`guarded`] instead of being printed with its trace: a lost or full device panics
/// where its numbers are read next.
fn keep_panics(device: String) {
    *OPEN.lock().unwrap_or_else(PoisonError::into_inner) = Some(device);
    set_hook(Box::new(|panic| {
        let place = panic.location().map(|place| format!(" ({}:{})", place.file(), place.line())).unwrap_or_default();
        let mut first = FIRST_PANIC.lock().unwrap_or_else(PoisonError::into_inner);
        first.get_or_insert_with(|| format!("{}{place}", root_cause(&message(panic.payload()))));
    }));
}

/// The message of a panic.
fn message(payload: &(dyn Any + Send)) -> String {
    match (payload.downcast_ref::<String>(), payload.downcast_ref::<&str>()) {
        (Some(text), _) => text.clone(),
        (None, Some(text)) => (*text).to_owned(),
        (None, None) => "unknown reason".to_owned(),
    }
}

/// The root cause of a message with a chain of causes and a trace, on one line.
fn root_cause(message: &str) -> String {
    let root = message.rsplit("Caused by:").next().unwrap_or(message);
    let root = ["No backtrace", "Backtrace:"].iter().fold(root, |root, end| root.split(end).next().unwrap_or(root));
    let line = root.split_whitespace().collect::<Vec<_>>().join(" ");
    line.chars().take(MAX_CAUSE).collect()
}

/// Longest cause that is shown, characters.
const MAX_CAUSE: usize = 300;

/// Runs a command. A device that fails in the middle of it is an error like any other.
pub fn guarded(command: impl FnOnce() -> Result<ExitCode>) -> Result<ExitCode> {
    let payload = match catch_unwind(AssertUnwindSafe(command)) {
        Ok(result) => return result,
        Err(payload) => payload,
    };
    let Some(device) = OPEN.lock().unwrap_or_else(PoisonError::into_inner).take() else { resume_unwind(payload) };
    let first = FIRST_PANIC.lock().unwrap_or_else(PoisonError::into_inner).take();
    let problem = first.unwrap_or_else(|| root_cause(&message(payload.as_ref())));
    Err(anyhow!("{}", failure(&device, &problem)))
}

/// The error message for a device that failed.
fn failure(device: &str, problem: &str) -> String {
    let lower = problem.to_lowercase();
    let what = if ["out of memory", "allocate buffer", "buffer too big", "exceeds the max"]
        .iter()
        .any(|sign| lower.contains(sign))
    {
        "does not have enough memory: fewer rays per step (--set rays=N) need less"
    } else if ["device lost", "device is lost", "parent device", "poisoned"].iter().any(|sign| lower.contains(sign)) {
        "was lost: it was reset, removed, or took longer for a kernel than its driver allows"
    } else {
        "failed"
    };
    format!(
        "{device} {what}. The last checkpoint of a training is kept: resume with --resume, or use --backend cpu. Message: {problem}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_failure_of_a_device_becomes_one_sentence_with_a_remedy() {
        for (message, what) in [
            ("can't allocate buffer of size: 536870912", "enough memory"),
            ("Parent device is lost", "was lost"),
            ("index out of bounds", "failed"),
        ] {
            let failure = failure("gpu:0 (Card)", message);
            for part in ["gpu:0 (Card)", what, message, "--backend cpu", "--resume"] {
                assert!(failure.contains(part), "{part:?} is missing in: {failure}");
            }
        }
    }

    #[test]
    fn of_a_chain_of_causes_the_root_is_shown_on_one_line() {
        let chain = "reading: (An error\nCaused by:\n  An IO error\nCaused by:\n  can't allocate\n  buffer\nNo backtrace available)";
        assert_eq!(root_cause(chain), "can't allocate buffer");
        assert_eq!(root_cause(&message(&"plain")), "plain");
        assert_eq!(message(&7), "unknown reason");
    }
}
