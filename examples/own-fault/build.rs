//! Notes the source that the program is built from, for `--describe`.

fn main() {
    hil_origin::note();
}
