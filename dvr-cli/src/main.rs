//! dvr
fn main() {}
