//! What the tests of every crate share. It depends on none of them, so that unit tests can use it too.
//!
//! [`gpu`], [`scene`], [`fixture`] and [`browser`] give what a machine may lack. Where it is missing, the test prints
//! why it is skipped and returns; where `DVR_REQUIRE` lists it, the test fails instead:
//!
//! ```text
//! DVR_REQUIRE=gpu,browser,scenes,fixtures  what must be there
//! DVR_SCENES=DIR                           where scenes lie; fixtures lie in DIR/../fixtures
//! ```
//!
//! [`max_difference`] and its relatives compare numbers and panic at NaN and infinity: a maximum taken with `f64::max`
//! drops NaN, and a test with it passes when every number is NaN.
//!
//! ```
//! use dvr_test_support::{max_difference, scene};
//!
//! assert!(max_difference(&[1.0, 2.0], &[1.0, 2.5]) <= 0.5);
//! let Some(folder) = scene("dtu_scan65") else { return };
//! assert!(folder.is_dir());
//! ```

mod compare;
mod need;

pub use compare::{largest, max_difference, relative_difference};
pub use need::{browser, fixture, gpu, scene};
