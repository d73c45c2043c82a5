//! Masks of rendered photographs.

mod on_a_table;
mod on_a_wall;
