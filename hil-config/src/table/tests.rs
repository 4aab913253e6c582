use super::*;

fn points(time_s: &[f64], columns: &[&[f64]]) -> Points {
    let columns = columns.iter().map(|column| column.to_vec()).collect();
    Points::new(time_s.to_vec(), columns).expect("rows")
}

fn table(points: Points, interpolation: Interpolation, repeat: bool) -> Table {
    Table::new(points, interpolation, repeat, AfterEnd::Hold).expect("a table")
}

fn row(table: &Table, time_s: f64) -> Vec<f64> {
    let mut row = vec![f64::NAN; 1 + table.derivatives()];
    table.evaluate(time_s, &mut row);
    row
}

#[test]
fn a_table_is_straight_between_its_points_and_constant_outside() {
    let table = Table::linear(points(&[1.0, 2.0, 4.0], &[&[10.0, 20.0, 0.0]]));
    assert_eq!(row(&table, 0.0), [10.0, 0.0]);
    assert_eq!(row(&table, 1.0), [10.0, 10.0]);
    assert_eq!(row(&table, 1.25), [12.5, 10.0]);
    assert_eq!(row(&table, 2.0), [20.0, -10.0]);
    assert_eq!(row(&table, 3.5), [5.0, -10.0]);
    assert_eq!(row(&table, 4.0), [0.0, 0.0]);
    assert_eq!(row(&table, 9.0), [0.0, 0.0]);
}

#[test]
fn a_table_of_one_point_is_a_constant() {
    for interpolation in Interpolation::ALL {
        let table = table(points(&[1.0], &[&[7.0]]), interpolation, false);
        for time_s in [0.0, 1.0, 2.0] {
            let row = row(&table, time_s);
            assert_eq!(row[0], 7.0);
            assert!(row[1..].iter().all(|derivative| *derivative == 0.0));
        }
    }
}

#[test]
fn a_held_table_jumps_at_its_rows_in_spite_of_rounding() {
    let table = table(
        points(&[0.0, 0.3, 0.7], &[&[1.0, 2.0, 3.0]]),
        Interpolation::Hold,
        false,
    );
    assert_eq!(row(&table, 0.3 - 1e-6), [1.0]);
    // 3 * 0.1 is above 0.3, and 0.1 + 0.2 - 1e-16 below.
    for time_s in [0.3, 3.0 * 0.1, 0.3 - 1e-16] {
        assert_eq!(row(&table, time_s), [2.0]);
    }
    assert_eq!(row(&table, 9.0), [3.0]);
}

#[test]
fn a_negative_zero_is_reproduced() {
    let table = Table::linear(points(&[0.0, 1.0], &[&[-0.0, 1.0]]));
    assert!(row(&table, 0.0)[0].is_sign_negative());
}

const TIMES: [f64; 5] = [0.0, 0.5, 1.25, 2.0, 4.0];

fn assert_close(row: &[f64], expected: [f64; 4]) {
    for (order, (value, expected)) in row.iter().zip(expected).enumerate() {
        let error = (value - expected).abs();
        assert!(error < 1e-12, "order {order}: {value} is not {expected}");
    }
    assert_eq!(row[4..], [0.0, 0.0]);
}

// SciPy 1.17.1: s = CubicSpline([0, 0.5, 1.25, 2, 4], [1, -2.5, 0.25, 3, -1], bc_type="natural"), s(t, order)
#[test]
fn a_cubic_table_is_the_natural_spline_of_scipy() {
    let values: &[f64] = &[1.0, -2.5, 0.25, 3.0, -1.0];
    let table = table(points(&TIMES, &[values]), Interpolation::Cubic, false);
    #[rustfmt::skip]
    let expected = [
        (0.0, [1.0, -9.26955782312925, 0.0, 54.46938775510206]),
        (0.3, [-1.5357551020408162, -6.81843537414966, 16.34081632653061, 54.46938775510206]),
        (0.5, [-2.5, -2.4608843537414966, 27.234693877551017, -43.578231292516996]),
        (1.0, [-1.2339852607709751, 5.709183673469387, 5.445578231292519, -43.578231292516996]),
        (1.9, [2.8102188208616776, 2.1697959183673468, -5.440136054421768, 0.01360544217687713]),
        (3.75, [-0.05385044642857206, -3.727944302721088, -0.6798469387755102, 2.7193877551020407]),
    ];
    for (time_s, expected) in expected {
        assert_close(&row(&table, time_s), expected);
    }
    assert_eq!(row(&table, 5.0), [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
}

// SciPy 1.17.1: s = CubicSpline([0, 0.5, 1.25, 2, 4], [1, -2.5, 0.25, 3, 1], bc_type="periodic"), s(t, order)
#[test]
fn a_cubic_table_that_repeats_is_the_periodic_spline_of_scipy() {
    let values: &[f64] = &[1.0, -2.5, 0.25, 3.0, 1.0];
    let table = table(points(&TIMES, &[values]), Interpolation::Cubic, true);
    #[rustfmt::skip]
    let expected = [
        (0.0, [1.0, -7.817023920472198, -9.998136067101573, 79.59739049394219]),
        (0.3, [-1.4368350419384899, -7.234582168375271, 13.881081081081081, 79.59739049394219]),
        (1.0, [-1.239722481101791, 5.844361602982293, 5.0425598011804915, -49.51599875737807]),
        (3.75, [2.6542404473438967, -5.466604535570054, -8.805219012115565, -4.771668219944084]),
    ];
    for (time_s, expected) in expected {
        assert_close(&row(&table, time_s), expected);
        assert_close(&row(&table, time_s + 8.0), expected);
    }
    // SciPy 1.17.1: CubicSpline([0, 1, 3], [1, 2, 1], bc_type="periodic")(0.5, order)
    let short = points(&[0.0, 1.0, 3.0], &[&[1.0, 2.0, 1.0]]);
    let short = super::Table::new(short, Interpolation::Cubic, true, AfterEnd::Hold);
    assert_close(&row(&short.expect("a table"), 0.5), [1.5, 1.25, 0.0, -6.0]);
}

#[test]
fn a_cubic_table_of_a_line_is_the_line() {
    let times = [0.0, 0.1, 1.0, 3.0];
    let values = times.map(|t| 2.0 - 0.5 * t);
    let table = table(points(&times, &[&values]), Interpolation::Cubic, false);
    for time_s in [0.0, 0.05, 0.7, 2.9] {
        assert_close(&row(&table, time_s), [2.0 - 0.5 * time_s, -0.5, 0.0, 0.0]);
    }
}

#[test]
fn columns_of_derivatives_are_interpolated_like_the_values() {
    let both = || points(&[0.0, 1.0, 2.0], &[&[1.0, 3.0, 2.0], &[0.0, 8.0, 4.0]]);
    let linear = table(both(), Interpolation::Linear, false);
    assert_eq!(row(&linear, 0.25), [1.5, 2.0]);
    assert_eq!(row(&linear, 2.0), [2.0, 4.0]);
    assert_eq!(row(&linear, 3.0), [2.0, 0.0]);
    assert_eq!(row(&linear, -1.0), [1.0, 0.0]);
    let held = table(both(), Interpolation::Hold, false);
    assert_eq!(row(&held, 1.75), [3.0, 8.0]);
}

#[test]
fn a_table_that_repeats_begins_anew_at_its_last_row() {
    let table = table(
        points(&[1.0, 2.0, 3.0], &[&[0.0, 4.0, 6.0]]),
        Interpolation::Linear,
        true,
    );
    assert_eq!(row(&table, 0.0), [0.0, 0.0]);
    assert_eq!(row(&table, 2.5), [5.0, 2.0]);
    assert_eq!(row(&table, 3.0), [0.0, 4.0]);
    assert_eq!(row(&table, 7.25), [1.0, 4.0]);
}

#[test]
fn a_table_may_be_zero_after_its_end() {
    let table = Table::new(
        points(&[0.0, 1.0], &[&[5.0, 6.0]]),
        Interpolation::Linear,
        false,
        AfterEnd::Zero,
    );
    let table = table.expect("a table");
    assert_eq!(row(&table, 1.0)[0], 6.0);
    assert_eq!(row(&table, 1.5), [0.0, 0.0]);
}

#[test]
fn a_table_that_repeats_shows_its_first_row_at_every_wrap_in_spite_of_rounding() {
    // Times of rows and number of steps of 1 ms between two wraps.
    let cases: [(&[f64], u32); 3] = [
        (&[0.0, 0.1, 0.2, 0.3], 300),
        (&[0.0, 0.7], 700),
        (&[0.05, 0.05 + 0.1, 0.05 + 0.25, 0.05 + 0.7], 700),
    ];
    for (time_s, period) in cases {
        let last = time_s.len() - 1;
        let begin = (time_s[0] * 1000.0).round() as u32;
        for interpolation in Interpolation::ALL {
            let mut values = vec![0.0; time_s.len()];
            values[last] = match interpolation {
                Interpolation::Cubic => 0.0,
                Interpolation::Linear | Interpolation::Hold => 3.0,
            };
            let table = table(points(time_s, &[&values]), interpolation, true);
            for wrap in 1..200 {
                let step = begin + wrap * period;
                let value = table.value(f64::from(step) / 1000.0);
                assert!(
                    value.abs() < 1e-9,
                    "{interpolation:?}: step {step}: {value}"
                );
            }
        }
    }
}

#[test]
fn the_last_row_precedes_the_zero_after_the_end_in_spite_of_rounding() {
    let times_s = [0.1, 0.15, 0.3];
    for interpolation in Interpolation::ALL {
        let points = points(&times_s, &[&[4.0, 5.0, 6.0]]);
        let table = Table::new(points, interpolation, false, AfterEnd::Zero).expect("a table");
        // 0.1 + 0.2 is above 0.3.
        for time_s in [0.3 - 1e-16, 0.3, 0.1 + 0.2] {
            assert!(
                (table.value(time_s) - 6.0).abs() < 1e-9,
                "{interpolation:?}"
            );
        }
        assert_eq!(table.value(0.301), 0.0);
    }
}

#[test]
fn the_slope_begins_at_the_first_row_in_spite_of_rounding() {
    let first_s = 0.1 + 0.2;
    let table = Table::linear(points(&[first_s, 1.0 + first_s], &[&[7.0, 9.0]]));
    assert!(0.3 < first_s);
    assert_eq!(row(&table, 0.3), [7.0, 2.0]);
    assert_eq!(row(&table, 0.299), [7.0, 0.0]);
}

#[test]
fn combinations_without_a_meaning_are_refused() {
    let refused = |points: Points, interpolation, repeat| {
        Table::new(points, interpolation, repeat, AfterEnd::Hold).expect_err("no meaning")
    };
    let uneven = points(&[0.0, 1.0], &[&[1.0, 2.0]]);
    assert!(refused(uneven, Interpolation::Cubic, true).contains("last row is the first row"));
    let short = points(&[0.0], &[&[1.0]]);
    assert!(refused(short, Interpolation::Linear, true).contains("cannot repeat"));
    let both = points(&[0.0, 1.0], &[&[1.0, 2.0], &[1.0, 1.0]]);
    assert!(refused(both, Interpolation::Cubic, false).contains("computes its derivatives"));
}

#[test]
fn a_table_survives_the_plants_job() {
    let table = Table::new(
        points(&[0.0, 0.1], &[&[-0.0, 0.1 + 0.2], &[1e-300, 5.0]]),
        Interpolation::Hold,
        true,
        AfterEnd::Hold,
    );
    let table = table.expect("a table");
    let text = serde_json::to_string(&table).expect("serialises");
    assert_eq!(
        serde_json::from_str::<Table>(&text).expect("a table"),
        table
    );
}

#[test]
fn a_packed_file_gives_the_same_points_and_is_checked_by_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let times: Vec<f64> = (0..20_000).map(|row| f64::from(row) * 0.1).collect();
    let values: Vec<f64> = times.iter().map(|time| libm::sin(*time)).collect();
    let mut packed = points(&times, &[&values]);
    let path = folder.path().join(packed.packed_name());
    let mut bytes = Vec::new();
    packed.write(&mut bytes).expect("memory");
    assert_eq!(bytes.len(), 24 + 16 * times.len());
    std::fs::write(&path, &bytes).expect("a file");
    assert_eq!(Points::read(&path).expect("points"), packed);

    // A text names the file and has no numbers.
    packed.refer_to(path.clone());
    let text = serde_json::to_string(&packed).expect("serialises");
    assert!(text.len() < 200, "{text}");
    assert_eq!(
        serde_json::from_str::<Points>(&text).expect("points"),
        packed
    );

    bytes[1000] ^= 1;
    std::fs::write(&path, &bytes).expect("a file");
    let error = Points::read(&path).expect_err("changed");
    assert!(
        error.to_string().contains("the content has changed"),
        "{error}"
    );
    for damaged in [&bytes[..100], b"time_s,value\n0,1\n0,1\n0,1\n", &[]] {
        std::fs::write(&path, damaged).expect("a file");
        assert!(Points::read(&path).is_err());
    }
}
