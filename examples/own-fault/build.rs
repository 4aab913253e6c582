//! Embeds the provenance of the program, for `--describe`.

fn main() {
    hil_origin::note();
}
