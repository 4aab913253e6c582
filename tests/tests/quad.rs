//! The quadcopter of `examples/quad`.

use crate::support::programs::test_example;

#[test]
fn the_quadcopter_obeys_closed_forms_and_conserves_what_it_should() {
    test_example("quad");
}
