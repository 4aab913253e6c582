//! Links that lead out of the pages.

/// Links of a page N folders below `docs` to files outside of it: the built book lies one folder
/// deeper than `docs`.
pub(crate) fn to_source(text: &str, depth: usize) -> String {
    let up = "../".repeat(depth + 1);
    let mut out = String::with_capacity(text.len());
    for (number, piece) in text.split("](").enumerate() {
        if number > 0 {
            out += "](";
            if piece.starts_with(&up) {
                out += "../";
            }
        }
        out += piece;
    }
    out
}

/// Rewrites links of a file at the top of the repository, as if the file were in `docs`.
pub(crate) fn from_top(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for (number, piece) in text.split("](").enumerate() {
        if number > 0 {
            out += "](";
            let (target, _) = piece.split_once(')').unwrap_or((piece, ""));
            match target {
                page if page.starts_with("docs/") => {
                    out += &piece["docs/".len()..];
                    continue;
                }
                here if here.starts_with('#') || here.contains("://") => {}
                _ => out += "../",
            }
        }
        out += piece;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_into_the_source_go_up_once_more() {
        let text = "[a](../tools/src/a.rs) [b](b.md#c) [d](#e)";
        assert_eq!(
            to_source(text, 0),
            "[a](../../tools/src/a.rs) [b](b.md#c) [d](#e)"
        );
        let text = "[a](../faults.md) [b](../../tools)";
        assert_eq!(to_source(text, 1), "[a](../faults.md) [b](../../../tools)");
    }

    #[test]
    fn every_file_at_the_top_is_linked_from_docs() {
        let text = "[a](docs/trust.md) [b](tools/src) [c](#d) [e](https://x.y)";
        assert_eq!(
            from_top(text),
            "[a](trust.md) [b](../tools/src) [c](#d) [e](https://x.y)"
        );
    }
}
