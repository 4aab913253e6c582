//! Text of a study, edited in place: comments and order are preserved.

use toml_edit::{Array, DocumentMut, Item, TableLike, Value};

/// Returns a study with another number of draws and otherwise the same text; `None` if the study does not set `cases`.
pub(super) fn with_cases(text: &str, draws: u64) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let value = document.get_mut("cases")?.as_value_mut()?;
    let decor = value.decor().clone();
    *value = Value::from(i64::try_from(draws).ok()?);
    *value.decor_mut() = decor;
    Some(document.to_string())
}

/// Returns a study with targets added to the kinds of faults that have none; `None` if it has no such list of kinds.
pub(super) fn with_targets(text: &str, targets: &[Option<Vec<String>>]) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let kinds = document.get_mut("faults")?.get_mut("kinds")?;
    let tables: Vec<&mut dyn TableLike> = match kinds {
        Item::ArrayOfTables(all) => all
            .iter_mut()
            .map(|one| one as &mut dyn TableLike)
            .collect(),
        Item::Value(Value::Array(all)) => (all.iter_mut())
            .filter_map(|one| Some(one.as_inline_table_mut()? as &mut dyn TableLike))
            .collect(),
        _ => return None,
    };
    for (table, targets) in tables.into_iter().zip(targets) {
        if let Some(targets) = targets {
            let list: Array = targets.iter().collect();
            table.insert("targets", Item::Value(Value::Array(list)));
        }
    }
    Some(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::{DocumentMut, with_cases, with_targets};

    #[test]
    fn open_targets_are_added_to_kinds_in_both_notations() {
        let open = [Some(vec!["measured.a".to_owned()]), None];
        for text in [
            "[[faults.kinds]] # one\nkind = \"bias\"\n[[faults.kinds]]\nkind = \"noise\"\n",
            "# one\nfaults = { kinds = [{ kind = \"bias\" }, { kind = \"noise\" }] }\n",
        ] {
            let complete = with_targets(text, &open).expect("a list of kinds");
            assert!(complete.contains("# one"), "{complete}");
            let study: DocumentMut = complete.parse().expect("TOML");
            let kinds = &study["faults"]["kinds"];
            assert_eq!(kinds[0]["targets"][0].as_str(), Some("measured.a"));
            assert!(kinds[1].get("targets").is_none(), "{complete}");
        }
        assert_eq!(with_targets("schema = 1\n", &open), None);
    }

    #[test]
    fn changing_the_number_of_cases_keeps_the_rest_of_the_study() {
        let text = "schema = 1\ncases  =  200 # draws\n\n[[vary]] # one\nkey = \"a\"\n";
        let more = with_cases(text, 3000);
        assert_eq!(more, Some(text.replace("200", "3000")));
        assert_eq!(with_cases("schema = 1\n", 3000), None);
    }
}
