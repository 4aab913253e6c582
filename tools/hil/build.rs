//! Notes the source that the program is built from, for the provenance of its recordings.

fn main() {
    hil_origin::note();
}
