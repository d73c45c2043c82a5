//! The lattice decoder against plain tensors in double precision.

use dvr_tests::{double_precision_devices, lattice_suite};

#[test]
fn the_lattice_decoder_is_trilinear_interpolation_with_exact_derivatives() {
    for (name, device) in double_precision_devices() {
        println!("{name}");
        lattice_suite::agrees_with_plain_tensors(&device, 1e-12);
    }
}
