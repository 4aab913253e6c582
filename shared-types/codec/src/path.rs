//! Paths in a JSON text, and the tree that paths form together.

use std::fmt;

/// Path in a JSON text, for example `imu.gyro[0]`; empty for the text itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Path(pub(crate) Vec<Part>);

/// Part of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Key(String),
    Index(usize),
}

/// Largest depth of a JSON text.
pub(crate) const DEEPEST: usize = 16;
/// Largest index in a path.
const LARGEST_INDEX: usize = 511;

impl Path {
    /// Parses a path: keys of letters, digits, `_` and `-` with dots between them, each followed by any indices.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut parts = Vec::new();
        let mut rest = text;
        while !rest.is_empty() {
            if let Some(index) = rest.strip_prefix('[') {
                let (digits, behind) = index.split_once(']')?;
                let is_number = !digits.is_empty() && digits.bytes().all(|c| c.is_ascii_digit());
                let index = digits
                    .parse()
                    .ok()
                    .filter(|index| *index <= LARGEST_INDEX)?;
                if !is_number {
                    return None;
                }
                parts.push(Part::Index(index));
                rest = behind;
                continue;
            }
            if !parts.is_empty() {
                rest = rest.strip_prefix('.')?;
            }
            let is_of_key = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-');
            let end = rest.find(|c| !is_of_key(c)).unwrap_or(rest.len());
            let (key, behind) = rest.split_at(end);
            if key.is_empty() {
                return None;
            }
            parts.push(Part::Key(key.into()));
            rest = behind;
        }
        (parts.len() <= DEEPEST).then_some(Self(parts))
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, part) in self.0.iter().enumerate() {
            match part {
                Part::Key(key) if place > 0 => write!(f, ".{key}")?,
                Part::Key(key) => f.write_str(key)?,
                Part::Index(index) => write!(f, "[{index}]")?,
            }
        }
        Ok(())
    }
}

/// Part of a JSON text: a field by its place, an object or an array.
pub(crate) enum Node {
    Leaf(usize),
    Object(Vec<(String, Node)>),
    Array(Vec<Option<Node>>),
}

/// Inserts a field; `false` if its place is occupied or of another kind, or has an index of at least `end`.
fn insert(slot: &mut Option<Node>, path: &[Part], field: usize, end: usize) -> bool {
    let Some((part, rest)) = path.split_first() else {
        let is_free = slot.is_none();
        if is_free {
            *slot = Some(Node::Leaf(field));
        }
        return is_free;
    };
    match (part, &mut *slot) {
        (Part::Index(index), _) if *index >= end => false,
        (Part::Key(key), None) => {
            let mut inner = None;
            let is_free = insert(&mut inner, rest, field, end);
            *slot = inner.map(|inner| Node::Object(vec![(key.clone(), inner)]));
            is_free
        }
        (Part::Key(key), Some(Node::Object(entries))) => {
            let place = entries.iter().position(|(name, _)| name == key);
            let mut inner = place.map(|place| entries.swap_remove(place).1);
            let is_free = insert(&mut inner, rest, field, end);
            entries.extend(inner.map(|inner| (key.clone(), inner)));
            // The order of the file.
            if let Some(place) = place {
                let last = entries.len() - 1;
                entries.swap(place, last);
            }
            is_free
        }
        (Part::Index(index), None) => {
            let mut items: Vec<Option<Node>> = (0..=*index).map(|_| None).collect();
            let is_free = insert(&mut items[*index], rest, field, end);
            *slot = Some(Node::Array(items));
            is_free
        }
        (Part::Index(index), Some(Node::Array(items))) => {
            while items.len() <= *index {
                items.push(None);
            }
            insert(&mut items[*index], rest, field, end)
        }
        _ => false,
    }
}

/// Finds an array with a gap, and returns a field behind it.
fn gap(node: &Node) -> Option<usize> {
    match node {
        Node::Leaf(_) => None,
        Node::Object(entries) => entries.iter().find_map(|(_, inner)| gap(inner)),
        Node::Array(items) => {
            let last = items.iter().flatten().last().and_then(any_field);
            let has_gap = items.iter().any(Option::is_none);
            last.filter(|_| has_gap)
                .or_else(|| items.iter().flatten().find_map(gap))
        }
    }
}

fn any_field(node: &Node) -> Option<usize> {
    match node {
        Node::Leaf(field) => Some(*field),
        Node::Object(entries) => entries.iter().find_map(|(_, inner)| any_field(inner)),
        Node::Array(items) => items.iter().flatten().find_map(any_field),
    }
}

/// Lists the places of the paths that cannot stand in one text.
pub(crate) fn misplaced(paths: &[&Path]) -> Vec<usize> {
    let mut root = None;
    // A list without gaps has no index beyond the number of fields.
    let end = paths.len();
    let is_misplaced = |field: &usize| !insert(&mut root, &paths[*field].0, *field, end);
    let mut wrong: Vec<usize> = (0..end).filter(is_misplaced).collect();
    if wrong.is_empty() {
        wrong.extend(root.as_ref().and_then(gap));
    }
    wrong
}

/// Returns the tree of paths that stand in one text.
pub(crate) fn tree(paths: &[&Path]) -> Option<Node> {
    let mut root = None;
    for (field, path) in paths.iter().enumerate() {
        insert(&mut root, &path.0, field, paths.len());
    }
    root
}

#[cfg(test)]
mod tests {
    use super::Path;

    #[test]
    fn paths_print_as_they_are_written() {
        for text in ["", "a", "imu.gyro[0]", "[2].x-y[0][1]", "a_1.b"] {
            assert_eq!(Path::parse(text).expect(text).to_string(), text);
        }
        for text in [
            ".", "a.", ".a", "a..b", "a[", "a[]", "a[x]", "a[-1]", "a[512]", "a b", "a]", "a[+1]",
        ] {
            assert_eq!(Path::parse(text), None, "{text}");
        }
        assert_eq!(Path::parse(&"[0]".repeat(17)), None);
    }
}
