//! Extraction of meshes.

mod extract_dual;
mod extract_failures;
mod extract_reference;
mod extract_shapes;
mod support;
