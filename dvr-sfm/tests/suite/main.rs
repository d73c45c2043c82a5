//! Cameras, by COLMAP and by a program in its place.

#[cfg(unix)]
mod clips;
#[cfg(unix)]
mod fake_engine;
mod real_engine;
mod support;
