//! Records the source revision of the program for the provenance of its recordings.

fn main() {
    hil_origin::note();
}
