//! What the tests of every crate share. It depends on none of them, so that unit tests can use it too.
//!
//! [`fixture`] gives arrays that DVR's reference code computed; they are in the repository. What a machine may lack is
//! named by [`macro@test_with`] in place of `#[test]`, and given by [`gpu`], [`browser`], [`program`], [`mounts`], [`wait_channels`],
//! [`scene`] and [`large_fixture`]. Where it is missing, the test is `ignored` with the reason:
//!
//! ```text
//! DVR_SCENES=DIR                                  scenes that are not in the repository
//! DVR_LARGE_FIXTURES=DIR                          fixtures that are too large for it
//! DVR_REQUIRE=gpu,browser,colmap,ffmpeg,mounts,wait_channels,scenes,large_fixtures   fail where one of these is missing
//! ```
//!
//! [`mat_file`] makes MATLAB's files.
//!
//! [`max_difference`] and its relatives compare numbers and panic at NaN and infinity: a maximum taken with `f64::max`
//! drops NaN, and a test with it passes when every number is NaN.
//!
//! ```
//! use dvr_test_support::{fixture, max_difference, scene, test_with};
//!
//! assert!(max_difference(&[1.0, 2.0], &[1.0, 2.5]) <= 0.5);
//! assert!(fixture("losses.npz").is_file());
//!
//! #[test_with(scene("dtu_scan65"))]
//! fn the_skull_has_pictures() {
//!     assert!(scene("dtu_scan65").join("image").is_dir());
//! }
//! ```

mod compare;
mod mat;
mod need;

pub use compare::{largest, max_difference, relative_difference};
pub use dvr_test_needs::test_with;
pub use mat::{MatEntry, mat_file, mat_header};
pub use need::{browser, fixture, gpu, large_fixture, mounts, program, scene, wait_channels};
