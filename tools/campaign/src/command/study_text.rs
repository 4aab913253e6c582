//! Text of a study, edited in place: comments and order are preserved.

use toml_edit::{DocumentMut, Value};

/// Returns a study with another number of draws and otherwise the same text; `None` if the study does not set `cases`.
pub(super) fn with_cases(text: &str, draws: u64) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    let value = document.get_mut("cases")?.as_value_mut()?;
    let decor = value.decor().clone();
    *value = Value::from(i64::try_from(draws).ok()?);
    *value.decor_mut() = decor;
    Some(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::with_cases;

    #[test]
    fn changing_the_number_of_cases_keeps_the_rest_of_the_study() {
        let text = "schema = 1\ncases  =  200 # draws\n\n[[vary]] # one\nkey = \"a\"\n";
        let more = with_cases(text, 3000);
        assert_eq!(more, Some(text.replace("200", "3000")));
        assert_eq!(with_cases("schema = 1\n", 3000), None);
    }
}
