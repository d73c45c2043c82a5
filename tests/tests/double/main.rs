//! Against DVR's reference code in double precision, which holds for the whole process.

mod depth_fixtures;
mod depth_gradients;
mod encoder_gradients;
