//! Comparison of the output shown on a page with the current output of the command.
//!
//! Every shown line must occur, in order; more lines may be between. Times, speeds and the names of run folders
//! vary and are not compared; figures, names and digests are.

/// Checks that the output contains all shown lines.
///
/// # Errors
/// If a shown line is missing, with the output.
pub(super) fn compare(name: &str, text: &str) -> Result<(), String> {
    let mut rest = text.lines();
    for line in name.lines() {
        let expected = stable(line);
        if expected.is_empty() || expected == ["..."] {
            continue;
        }
        if !rest.any(|line| stable(line) == expected) {
            return Err(format!("`{line}` is not in order in:\n{text}"));
        }
    }
    Ok(())
}

/// Returns the words of a line that are the same in every run.
fn stable(line: &str) -> Vec<&str> {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    if let Some(start) = ["round trip", "worst:", "late by", "latest:"]
        .into_iter()
        .find(|start| line.trim_start().starts_with(start))
    {
        return vec![start];
    }
    if words.last() == Some(&"waits") {
        return vec!["waits"];
    }
    let unit = |word: &str| ["ns", "us", "ms", "s", "ns,", "us,", "ms,", "s,"].contains(&word);
    (words.iter().enumerate())
        .map(|(place, &word)| {
            let follows = words.get(place + 1).is_some_and(|next| unit(next));
            if follows && word.parse::<f64>().is_ok() {
                "#"
            } else if word
                .strip_suffix('x')
                .is_some_and(|number| number.parse::<f64>().is_ok())
            {
                "#x"
            } else if let Some((name, _)) =
                word.split_once("-20").filter(|_| word.contains("runs/"))
            {
                name
            } else {
                word
            }
        })
        .collect()
}

#[test]
fn times_and_folders_may_differ_and_figures_may_not() {
    let expected = "spring-mass: pass\n  5000 steps, 5 s in 0.02 s, 240.1x real time\n  overshoot_m  0 to 5  4.8417e-4 m\n\n  \
                 round trip 1 us p50: good\n  digest 8df6\n  5001 records in runs/a-20261121T1-s1/run.mcap\n";
    for (message, same) in [
        (
            "spring-mass: pass\n5000 steps, 5 s in 0.44 s, 11.3x real time",
            true,
        ),
        (
            "overshoot_m 0 to 5 4.8417e-4 m\n...\nround trip 9 us p50: usable\ndigest 8df6",
            true,
        ),
        ("5001 records in runs/a-20200101T2-s2/run.mcap", true),
        ("overshoot_m 0 to 5 4.8418e-4 m", false),
        ("digest 8df7", false),
        ("digest 8df6\nspring-mass: pass", false),
        ("5001 records in runs/b-20261121T1-s1/run.mcap", false),
    ] {
        assert_eq!(compare(message, expected).is_ok(), same, "{message}");
    }
}
