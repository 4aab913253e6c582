use super::*;

fn draws(text: &str) -> Draws {
    let text = format!("schema = 1\nscenario = \"a.toml\"\n{text}");
    let study = Study::parse(&text, "demo.toml").unwrap_or_else(|problems| panic!("{problems}"));
    Draws::new(study).unwrap_or_else(|problems| panic!("{problems}"))
}

const TWO: &str = r#"
[[vary]]
key = "a.x"
kind = "uniform"
min = 2.0
max = 4.0
[[vary]]
key = "a.n"
kind = "normal"
mean = 10.0
deviation = 2.0
[[vary]]
key = "a.double"
kind = "expression"
expression = "2 * x + n"
[[vary]]
key = "a.law"
kind = "list"
values = ["pid", "ftsc"]
[[variants]]
name = "one"
[[variants]]
name = "two"
set = ["b.c=3"]
"#;

fn numbers(draws: &Draws, draw: u64) -> Vec<f64> {
    draws.values(draw).iter().map(Drawn::number).collect()
}

#[test]
fn variants_have_the_same_draws_and_their_own_flags() {
    let draws = draws(&format!("cases = 5\nset = [\"z=1\"]\n{TWO}"));
    assert_eq!((draws.of_case(6), draws.of_case(7)), ((3, 0), (3, 1)));
    let (one, two) = (draws.flags(6), draws.flags(7));
    assert_eq!((&*one[0], &*two[0], &*two[1]), ("z=1", "z=1", "b.c=3"));
    assert_eq!(one[1..], two[2..]);
    let [x, n, double, _] = numbers(&draws, 3)[..] else {
        panic!("four values")
    };
    assert_eq!(double, 2.0 * x + n);
    assert_eq!(one[1], format!("a.x={x:?}"));
    assert!(one[4] == "a.law=\"pid\"" || one[4] == "a.law=\"ftsc\"");
    assert_eq!(one[5], format!("run.seed={}", draws.seed(3)));
}

#[test]
fn a_seed_set_by_the_study_is_not_drawn() {
    let draws = draws(&format!("cases = 5\nset = [\"run.seed=7\"]\n{TWO}"));
    assert_eq!(
        draws
            .flags(0)
            .iter()
            .filter(|flag| flag.starts_with("run.seed"))
            .count(),
        1
    );
}

#[test]
fn the_seed_of_a_case_is_the_one_that_the_scenario_reads() {
    for (value, seed) in [("7", 7), ("1_000", 1000)] {
        let draws = draws(&format!("cases = 5\nset = [\"run.seed={value}\"]\n{TWO}"));
        assert_eq!(draws.seed_of(0, 3, &draws.values(0)), seed, "{value}");
    }
    let draws = draws(&format!("cases = 5\n{TWO}"));
    assert_eq!(draws.seed_of(0, 3, &draws.values(0)), 3);
}

#[test]
fn growing_a_campaign_keeps_independent_and_sobol_draws_but_not_those_of_a_hypercube() {
    for (sampling, stays) in [
        ("independent", true),
        ("sobol", true),
        ("latin-hypercube", false),
    ] {
        let of = |cases: u64| {
            draws(&format!(
                "cases = {cases}\nsampling = \"{sampling}\"\n{TWO}"
            ))
        };
        let (few, many) = (of(100), of(1000));
        let same = (0..100).all(|draw| few.values(draw) == many.values(draw));
        assert_eq!(same, stays, "{sampling}");
    }
}

#[test]
fn seeds_and_varied_values_have_independent_streams() {
    let of = |seed: u64| draws(&format!("cases = 9\nseed = {seed}\n{TWO}"));
    assert_ne!(of(1).values(0), of(2).values(0));
    assert_ne!(of(1).values(0), of(1).values(1));
    assert_ne!(of(1).seed(0), of(1).seed(1));
}

#[test]
fn a_hypercube_has_exactly_one_draw_per_stratum() {
    let draws = draws(&format!(
        "cases = 1000\nsampling = \"latin-hypercube\"\n{TWO}"
    ));
    let mut counts = [0; 1000];
    for draw in 0..1000 {
        let x = numbers(&draws, draw)[0];
        counts[((x - 2.0) / 2.0 * 1000.0) as usize] += 1;
    }
    assert_eq!(counts, [1; 1000]);
}

#[test]
fn shifted_sobol_points_fill_each_dyadic_range_once() {
    let draws = draws(&format!("cases = 256\nsampling = \"sobol\"\n{TWO}"));
    let mut counts = [0; 256];
    for draw in 0..256 {
        counts[((numbers(&draws, draw)[0] - 2.0) * 128.0) as usize] += 1;
    }
    assert_eq!(counts, [1; 256]);
}

#[test]
fn a_grid_has_every_combination_once_and_its_last_value_changes_fastest() {
    let draws = draws(
        "sampling = \"grid\"\n[[vary]]\nkey = \"a.b\"\nkind = \"grid\"\nmin = 0\nmax = 2\npoints = 3\n\
         [[vary]]\nkey = \"a.c\"\nkind = \"list\"\nvalues = [true, false]\n",
    );
    let all: Vec<String> = (0..6)
        .map(|case| draws.flags(case)[..2].join(" "))
        .collect();
    assert_eq!(
        all,
        [
            "a.b=0.0 a.c=true",
            "a.b=0.0 a.c=false",
            "a.b=1.0 a.c=true",
            "a.b=1.0 a.c=false",
            "a.b=2.0 a.c=true",
            "a.b=2.0 a.c=false"
        ]
    );
}

/// Means, standard deviations and correlation of the first two numbers of 20,000 draws.
fn moments(draws: &Draws) -> ([f64; 2], [f64; 2], f64) {
    let all: Vec<Vec<f64>> = (0..20_000).map(|draw| numbers(draws, draw)).collect();
    let count = all.len() as f64;
    let mean = [0, 1].map(|one| all.iter().map(|row| row[one]).sum::<f64>() / count);
    let product = |a: usize, b: usize| {
        let of = |row: &Vec<f64>| (row[a] - mean[a]) * (row[b] - mean[b]);
        all.iter().map(of).sum::<f64>() / count
    };
    let deviation = [product(0, 0).sqrt(), product(1, 1).sqrt()];
    (mean, deviation, product(0, 1) / deviation[0] / deviation[1])
}

#[test]
fn moments_and_correlations_match_the_distributions() {
    let text = |coefficient: f64| {
        format!(
            "cases = 20000\n[[vary]]\nname = \"a\"\nkind = \"normal\"\nmean = 5\ndeviation = 2\n\
             [[vary]]\nname = \"b\"\nkind = \"normal\"\nmean = -1\ndeviation = 0.5\n\
             [[correlate]]\nnames = [\"b\", \"a\"]\ncoefficient = {coefficient}\n"
        )
    };
    for coefficient in [0.8, -0.5] {
        // Five standard errors of 20,000 draws.
        let (mean, deviation, correlation) = moments(&draws(&text(coefficient)));
        assert!(
            (mean[0] - 5.0).abs() < 0.071 && (mean[1] + 1.0).abs() < 0.018,
            "{mean:?}"
        );
        assert!((deviation[0] - 2.0).abs() < 0.05 && (deviation[1] - 0.5).abs() < 0.0125);
        assert!((correlation - coefficient).abs() < 0.027, "{correlation}");
    }
    let (mean, deviation, correlation) = moments(&draws(&format!("cases = 20000\n{TWO}")));
    assert!((mean[0] - 3.0).abs() < 0.0205 && (deviation[0] - 1.0 / 3.0_f64.sqrt()).abs() < 0.01);
    assert!((mean[1] - 10.0).abs() < 0.071 && correlation.abs() < 0.036);
}

#[test]
fn lognormal_values_agree_with_scipy() {
    // scipy.stats.lognorm.ppf(u, sigma, scale=median)
    for (median, sigma, u, expected) in [
        (2.0, 0.5, 0.5, 2.0),
        (2.0, 0.5, 0.975, 5.328816523105796),
        (1e-3, 1.5, 0.01, 3.051546083870337e-5),
    ] {
        let within = [0.0, f64::INFINITY];
        let actual = value(
            &Spread::Lognormal {
                median,
                sigma,
                within,
            },
            u,
        );
        assert!((actual - expected).abs() <= 2e-14 * expected, "{actual:e}");
    }
}

#[test]
fn impossible_correlations_are_refused_with_their_location() {
    let one = |name: &str| {
        format!("[[vary]]\nkey = \"a.{name}\"\nkind = \"normal\"\nmean = 0\ndeviation = 1\n")
    };
    let with = |a: &str, b: &str, c: f64| {
        format!("[[correlate]]\nnames = [\"{a}\", \"{b}\"]\ncoefficient = {c}\n")
    };
    let text = format!(
        "schema = 1\nscenario = \"a.toml\"\ncases = 2\n{}{}{}{}{}{}",
        one("x"),
        one("y"),
        one("z"),
        with("x", "y", 0.9),
        with("y", "z", 0.9),
        with("x", "z", -0.9),
    );
    let study = Study::parse(&text, "demo.toml").unwrap_or_else(|problems| panic!("{problems}"));
    let message = Draws::new(study).err().expect("refused").to_string();
    assert!(
        message.contains("not positive definite") && message.contains("a.z"),
        "{message}"
    );
}

#[test]
fn integers_are_equally_frequent_or_rounded_and_formatted_without_a_point() {
    let draws = draws(
        r#"
cases = 512
sampling = "sobol"
[[vary]]
key = "a.n"
kind = "uniform"
min = -3
max = 4
whole = true
[[vary]]
key = "a.m"
kind = "normal"
mean = 0
deviation = 2
min = -2
max = 3
whole = true
[[vary]]
key = "a.half"
kind = "expression"
expression = "n / 2"
whole = true
"#,
    );
    let mut uniform = [0; 8];
    let mut normal = [0; 6];
    for draw in 0..512 {
        let [n, m, half] = numbers(&draws, draw)[..] else {
            panic!("three values")
        };
        uniform[(n + 3.0) as usize] += 1;
        normal[(m + 2.0) as usize] += 1;
        // Halves away from zero: -3/2 is -2, -1/2 is -1, 1/2 is 1.
        let expected = [-2.0, -1.0, -1.0, 0.0, 1.0, 1.0, 2.0, 2.0][(n + 3.0) as usize];
        assert_eq!(half, expected);
        let flags = draws.flags(draw);
        assert_eq!(flags[0], format!("a.n={}", n as i64));
        assert_eq!(flags[2], format!("a.half={}", half as i64));
    }
    // 512 points of a Sobol' sequence fill each of eight equal parts with 64.
    assert_eq!(uniform, [64; 8]);
    // Normal values between -2 and 3, rounded: Phi at the halves, by SciPy's norm.cdf.
    let cdf = [
        0.158_655_25, // -2
        0.226_627_35, // -1.5
        0.401_293_67, // -0.5
        0.598_706_33, // 0.5
        0.773_372_65, // 1.5
        0.894_350_23, // 2.5
        0.933_192_80, // 3
    ];
    for (count, edges) in normal.into_iter().zip(cdf.windows(2)) {
        let expected = 512.0 * (edges[1] - edges[0]) / (cdf[6] - cdf[0]);
        assert!(
            (f64::from(count) - expected).abs() < 2.0,
            "{count} {expected}"
        );
    }
}

#[test]
fn a_row_of_saltellis_scheme_mixes_two_points_value_by_value() {
    let one = "[[vary]]\nkey = \"a.x\"\nkind = \"uniform\"\nmin = 0\nmax = 1\n";
    let text = format!("{one}{}", one.replace("a.x", "a.y"));
    let draws = draws(&format!("cases = 3\nsampling = \"saltelli\"\n{text}"));
    assert_eq!(draws.study().draws, 12);
    for row in 0..3 {
        let [a, b, first, second] = [0, 1, 2, 3].map(|part| numbers(&draws, 4 * row + part));
        assert!(a[0] != b[0] && a[1] != b[1], "{a:?} {b:?}");
        assert_eq!((first, second), (vec![b[0], a[1]], vec![a[0], b[1]]));
    }
}
