//! Scenarios with very many parts: 40 times as many cost about 40 times as much.

use std::time::Duration;

use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_config::problem::Problems;
use rustix::time::{ClockId, clock_gettime};

use crate::descriptions::{self, Checked};
use crate::{BASE, base_with, base_with_faults, parse};

/// Parts of the smaller scenario.
const FEW: usize = 500;
/// Parts of the larger scenario, as a multiple of `FEW`.
const TIMES: usize = 40;
/// Maximum cost ratio of the larger scenario to the smaller one; 40 would be proportional, cache misses double that,
/// and comparing every part with all others would cost 1600 times as much.
const MOST: f64 = 160.0;

/// Returns the processor time of this thread, which does not depend on the machine's load.
fn spent() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec as u32)
}

fn check(text: &str, flags: &[String]) -> Result<Plan, Problems> {
    parse(text)?.set(flags).checked()
}

/// Checks a scenario and prepares its evaluation; returns the time taken.
fn cost(input: impl Fn(usize) -> (String, Vec<String>), count: usize, is_right: bool) -> Duration {
    let (text, flags) = input(count);
    let since = spent();
    let checked = check(&text, &flags);
    assert_eq!(checked.is_ok(), is_right, "{:?}", checked.err());
    if let Ok(plan) = checked {
        let plants = descriptions::plants();
        let plant = plants.iter().find(|plant| plant.name == plan.plant.model);
        let laws = descriptions::laws();
        let law = laws.iter().find(|law| law.name == plan.controller.law);
        let internals = &law.expect("it is there").internals;
        let columns = Columns::of(plant.expect("it is there"), &plan.stimuli, internals);
        Evaluation::new(&plan, &columns).expect("what was checked can be evaluated");
    } else if let Err(problems) = check(&text, &flags) {
        assert!(problems.0.len() <= 100);
        assert!(problems.to_string().len() < 1 << 20);
    }
    spent() - since
}

/// Concatenates a text for each number up to a count.
fn many(count: usize, one: impl Fn(usize) -> String) -> String {
    (0..count).map(one).collect()
}

/// Checks that at least one of five tries is proportional: other processes that occupy caches and memory make some
/// tries slower, but none makes a quadratic check fast.
fn is_near_linear(what: &str, is_right: bool, input: impl Fn(usize) -> (String, Vec<String>)) {
    let ratio = || {
        let few = cost(&input, FEW, is_right);
        let many = cost(&input, FEW * TIMES, is_right);
        many.as_secs_f64() / few.as_secs_f64()
    };
    let mut tries = Vec::new();
    while tries.len() < 5 && tries.last().is_none_or(|ratio| *ratio >= MOST) {
        tries.push(ratio());
    }
    assert!(
        tries.last().is_some_and(|ratio| *ratio < MOST),
        "{what}: {tries:.1?}"
    );
}

fn text(text: String) -> (String, Vec<String>) {
    (text, Vec::new())
}

#[test]
fn very_many_requirements_and_signals_cost_in_proportion() {
    let requirement = |name: &str, formula: &str| {
        format!("[[requirements]]\nname = \"{name}\"\nformula = \"{formula}\"\n")
    };
    let small = "truth.surface_angle_rad < 1";
    let derived = |name: usize, expression: &str| {
        format!("[[derived]]\nname = \"d{name}\"\nexpression = \"{expression}\"\n")
    };
    is_near_linear("requirements", true, |count| {
        let more = many(count, |n| requirement(&format!("r{n}"), small));
        text(format!("{BASE}\n{more}"))
    });
    is_near_linear("requirements of one name", false, |count| {
        let more = many(count, |_| requirement("again", small));
        text(format!("{BASE}\n{more}"))
    });
    is_near_linear("requirements of unknown signals", false, |count| {
        let more = many(count, |n| {
            requirement(&format!("r{n}"), &format!("truth.no{n} < 1"))
        });
        text(format!("{BASE}\n{more}"))
    });
    is_near_linear("a requirement of many comparisons", true, |count| {
        let formula = vec![small; count].join(" and ");
        text(format!("{BASE}\n{}", requirement("long", &formula)))
    });
    is_near_linear("a requirement of many unknown signals", false, |count| {
        let formula = many(count, |n| format!("truth.no{n} < 1 or "));
        let formula = format!("{formula}{small}");
        text(format!("{BASE}\n{}", requirement("long", &formula)))
    });
    is_near_linear("derived signals, each of the one before", true, |count| {
        let first = derived(0, "command.actuator1_valve_current_a");
        let more = many(count, |n| derived(n + 1, &format!("d{n} + 1")));
        let last = requirement("last", &format!("eventually d{count} < 1"));
        text(format!("{BASE}\n{first}{more}{last}"))
    });
    is_near_linear("derived signals with a requirement each", true, |count| {
        let signals = many(count / 2, |n| derived(n, "truth.surface_angle_rad"));
        let more = many(count / 2, |n| {
            requirement(&format!("r{n}"), &format!("d{n} < 1"))
        });
        text(format!("{BASE}\n{signals}{more}"))
    });
    is_near_linear("metrics", true, |count| {
        let more = many(count, |n| {
            format!("[[metrics]]\nname = \"m{n}\"\nexpression = \"max(truth.surface_angle_rad)\"\n")
        });
        text(format!("{BASE}\n{more}"))
    });
    is_near_linear("stimuli", true, |count| {
        let more = many(count, |n| {
            format!(
                "[[stimuli]]\ntarget = \"s{n}_m\"\nkind = \"sine\"\namplitude = 1.0\nfrequency_hz = 1.0\n"
            )
        });
        text(format!("{BASE}\n{more}"))
    });
    is_near_linear("plots", true, |count| {
        let more = many(count, |n| {
            format!("[[plots]]\ntitle = \"{n}\"\nsignals = [\"truth.surface_angle_rad\"]\n")
        });
        text(format!("{BASE}\n{more}"))
    });
}

#[test]
fn very_many_faults_cost_in_proportion() {
    let fault = |name: usize, trigger: &str| {
        format!(
            "[[faults]]\nname = \"f{name}\"\nkind = \"leakage\"\n{trigger}\n\
             effects = [{{ actuator = 1, coefficient_m3ps_per_sqrt_pa = 0.0, speed_per_s = 10.0 }}]\n"
        )
    };
    let after = |name: usize| format!("after = \"f{name}\"");
    is_near_linear("faults", true, |count| {
        text(base_with_faults(&many(count, |n| fault(n, "at_s = 1.0"))))
    });
    is_near_linear("faults on conditions", true, |count| {
        let one = |n| fault(n, "when = \"error_rad > 1\"");
        text(base_with_faults(&many(count, one)))
    });
    is_near_linear("faults, each after the one before", true, |count| {
        let first = fault(0, "at_s = 1.0");
        let more = many(count, |n| fault(n + 1, &after(n)));
        text(base_with_faults(&format!("{first}{more}")))
    });
    is_near_linear("faults, each after the one behind", true, |count| {
        let more = many(count, |n| fault(n, &after(n + 1)));
        let last = fault(count, "at_s = 1.0");
        text(base_with_faults(&format!("{more}{last}")))
    });
    is_near_linear("faults in a circle", false, |count| {
        let one = |n| fault(n, &after((n + 1) % count));
        text(base_with_faults(&many(count, one)))
    });
    is_near_linear("faults after one that there is not", false, |count| {
        text(base_with_faults(&many(count, |n| {
            fault(n, "after = \"no\"")
        })))
    });
    is_near_linear("faults of one name", false, |count| {
        text(base_with_faults(&many(count, |_| fault(0, "at_s = 1.0"))))
    });
}

#[test]
fn very_many_flags_cost_in_proportion() {
    let flags = |count: usize, one: fn(usize) -> String| {
        (
            BASE.to_owned(),
            (0..count).map(one).collect::<Vec<String>>(),
        )
    };
    is_near_linear("flags that set one value", false, |count| {
        flags(count, |n| format!("run.seed={n}"))
    });
    is_near_linear("flags that are none", false, |count| {
        flags(count, |n| format!("no{n}"))
    });
    is_near_linear("flags of unknown keys", false, |count| {
        flags(count, |n| format!("no{n}=1"))
    });
    is_near_linear("flags into a list", true, |count| {
        let requirement =
            "[[requirements]]\nname = \"x\"\nformula = \"truth.surface_angle_rad < 1\"\n";
        let flag = |n| format!("requirements[{}].name=r{n}", n + 1);
        let text = format!("{BASE}\n{}", requirement.repeat(count));
        (text, (0..count).map(flag).collect())
    });
}

#[test]
fn only_the_first_of_very_many_names_are_listed() {
    let faults: String = (0..150)
        .map(|n| format!("[[faults]]\nname = \"f{n}\"\nkind = \"leakage\"\nat_s = 1.0\n"))
        .collect();
    let text = base_with_faults(&faults).replace("at_s = 1.0\n[[derived]]", "[[derived]]");
    let text = text.replacen("at_s = 1.0", "after = \"no\"", 1);
    let problems = check(&text, &[]).expect_err("there is no such event");
    let expected = problems.0.iter().find_map(|problem| {
        let expected = problem.expected.as_deref()?;
        expected.contains("`f0`").then_some(expected)
    });
    let expected = expected.expect("the names are told");
    assert!(expected.contains("`f99` and 50 more"), "{expected}");
    assert!(!expected.contains("`f100`"), "{expected}");
}

#[test]
fn events_that_wait_for_each_other_are_reported_once_without_their_followers() {
    let event = |name: &str, after: &str| {
        format!(
            "[[faults]]\nname = \"{name}\"\nkind = \"leakage\"\nafter = \"{after}\"\n\
             effects = [{{ actuator = 1, coefficient_m3ps_per_sqrt_pa = 0.0, speed_per_s = 10.0 }}]\n"
        )
    };
    // `a` leads into the circle `b`, `d`, `c`; `e` waits for itself.
    let faults = [("a", "d"), ("b", "d"), ("c", "b"), ("d", "c"), ("e", "e")];
    let faults: String = faults
        .iter()
        .map(|(name, after)| event(name, after))
        .collect();
    let problems = check(&base_with_faults(&faults), &[]).expect_err("circles");
    let messages: Vec<(&str, &str)> = (problems.0.iter())
        .map(|problem| (problem.key.as_str(), problem.message.as_str()))
        .collect();
    let expected = [
        ("faults[1].after", "`b`, `d`, `c` wait for each other"),
        ("faults[4].after", "`e` waits for itself"),
    ];
    assert_eq!(messages, expected);
    // Unique names, and the base as it is, are valid.
    assert!(check(&base_with("seed = 7", "seed = 8"), &[]).is_ok());
}
