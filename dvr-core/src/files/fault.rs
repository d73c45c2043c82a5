//! Faults on demand, for tests: the n-th operation on files of this thread is refused, or is where the process is as good
//! as dead.
//!
//! Only tests ask for faults. Without, an operation looks at a cell of its thread and goes on.

use std::cell::Cell;
use std::io::{Error, ErrorKind, Result};

/// What happens at the chosen operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The system refuses this one operation, as where the disk is full or the folder read-only.
    Refused,
    /// The process is killed: this operation and all after it do not happen, and nothing is tidied up.
    Killed,
}

#[derive(Clone, Copy)]
enum Plan {
    None,
    Waiting { fault: Fault, operations: usize },
    Struck(Fault),
}

thread_local! {
    static PLAN: Cell<Plan> = const { Cell::new(Plan::None) };
}

/// A fault in waiting; it is called off when this value is dropped.
#[derive(Debug)]
#[must_use]
pub struct Injected(());

/// Lets so many operations on files succeed on this thread; the next one meets `fault`.
pub fn inject(fault: Fault, operations: usize) -> Injected {
    PLAN.set(Plan::Waiting { fault, operations });
    Injected(())
}

impl Injected {
    /// Whether there were enough operations for the fault to strike.
    pub fn has_struck(&self) -> bool {
        matches!(PLAN.get(), Plan::Struck(_))
    }
}

impl Drop for Injected {
    fn drop(&mut self) {
        PLAN.set(Plan::None);
    }
}

/// An operation on files is about to happen.
pub(super) fn point() -> Result<()> {
    match PLAN.get() {
        Plan::None | Plan::Struck(Fault::Refused) => return Ok(()),
        Plan::Waiting { fault, operations: 0 } => PLAN.set(Plan::Struck(fault)),
        Plan::Waiting { fault, operations } => {
            PLAN.set(Plan::Waiting { fault, operations: operations - 1 });
            return Ok(());
        }
        Plan::Struck(Fault::Killed) => {}
    }
    Err(Error::new(ErrorKind::StorageFull, "a fault that a test asked for"))
}

/// Whether the process counts as killed: then nothing is tidied up.
pub(super) fn is_dead() -> bool {
    matches!(PLAN.get(), Plan::Struck(Fault::Killed))
}
