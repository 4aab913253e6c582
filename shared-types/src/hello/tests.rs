//! Agreement of plant and controller, and refusals.

use super::*;

fn field(name: &str) -> Field {
    Field::signal(name, "rad", "x")
}

fn hello() -> Hello {
    Hello {
        measured: vec![field("angle_rad")],
        commands: Some(vec![field("spare_rad"), field("drive_rad")]),
        internals: vec![field("integral_rad")],
        ..Hello::new(5, "pid")
    }
}

fn answer(hello: &Hello) -> Result<Welcome, Refused> {
    agree(
        hello,
        &Offer {
            session: 5,
            epoch: 1,
            rate: Rate::new(10.0).expect("legal"),
            steps: 3,
            first: Step(0),
            against_clock: false,
            measured: &[field("extra_rad"), field("angle_rad")],
            reference: &[field("angle_rad")],
            commands: &[field("drive_rad")],
        },
    )
}

#[test]
fn surplus_signals_are_accepted() {
    let welcome = answer(&hello()).expect("agreed");
    welcome.check(&hello()).expect("checks");
    assert_eq!((welcome.sample.len(), welcome.command.len()), (3, 3));
}

#[test]
fn the_laws_own_commands_begin_as_the_plant_declares() {
    let drive = Field {
        default: Some(7.0),
        ..field("drive_rad")
    };
    for own in [None, Some(vec![field("spare_rad"), field("drive_rad")])] {
        let hello = Hello {
            commands: own.clone(),
            ..hello()
        };
        let offer = Offer {
            session: 5,
            epoch: 1,
            rate: Rate::new(10.0).expect("legal"),
            steps: 3,
            first: Step(0),
            against_clock: false,
            measured: &[field("angle_rad")],
            reference: &[],
            commands: std::slice::from_ref(&drive),
        };
        let welcome = agree(&hello, &offer).expect("agreed");
        let starts: Vec<Option<f64>> = (welcome.command.fields(SignalKind::Command).iter())
            .map(|field| field.default)
            .collect();
        let expected = own.map_or(vec![Some(7.0)], |_| vec![None, Some(7.0)]);
        assert_eq!(starts, expected);
    }
}

#[test]
fn everything_missing_is_named_at_once() {
    let mut hello = hello();
    hello.measured.push(field("angel_rad"));
    hello.commands = Some(vec![]);
    let text = answer(&hello).unwrap_err().to_string();
    assert!(
        text.contains("no signal `angel_rad`, nearest: angle_rad"),
        "{text}"
    );
    assert!(text.contains("no signal `drive_rad`"), "{text}");
}

#[test]
fn unusable_names_are_refused_on_both_sides() {
    let with = |names: &[&str]| Hello {
        internals: names.iter().map(|name| field(name)).collect(),
        ..hello()
    };
    let numbered: Vec<String> = (0..600).map(|number| format!("x{number}_rad")).collect();
    let many: Vec<&str> = numbered.iter().map(String::as_str).collect();
    for (names, expected) in [
        (&["a rad"][..], "internal: \"a rad\" is not a name"),
        (&["a_rad", "a_rad"], "internal: `a_rad` is defined twice"),
        (
            &many,
            "internal: there are 600 entries, but at most 512 are allowed",
        ),
        (&many[..511], "513 signals in one direction"),
    ] {
        let text = answer(&with(names)).unwrap_err().to_string();
        assert!(text.starts_with(expected), "{text}");
        let mut welcome = answer(&hello()).expect("agreed");
        welcome.command = SignalTable::of(SignalKind::Command, &hello().commands.expect("some"))
            .and(SignalKind::Internal, &with(names).internals);
        welcome.layout = layout_hash(&welcome.sample, &welcome.command);
        let text = welcome.check(&hello()).unwrap_err().to_string();
        assert!(text.starts_with(expected), "{text}");
    }
    let law = "pid\u{1b}[2J".into();
    let text = answer(&Hello { law, ..hello() }).unwrap_err().to_string();
    assert!(
        text.starts_with("law: \"pid\\u{1b}[2J\" is not a name"),
        "{text}"
    );
}

#[test]
fn a_hello_that_differs_from_the_description_is_refused() {
    let greeting = hello();
    let described = |change: &dyn Fn(&mut LawDescription)| {
        let mut law = LawDescription {
            name: greeting.law.clone(),
            summary: String::new(),
            plants: vec![],
            parameters: vec![],
            model: vec![],
            measured: greeting.measured.clone(),
            reference: greeting.reference.clone(),
            commands: greeting.commands.clone(),
            internals: greeting.internals.clone(),
            saves: false,
            state: None,
            tuning: String::new(),
        };
        change(&mut law);
        (greeting.check_described(&law)).map_err(|error| error.to_string())
    };
    assert_eq!(described(&|_| ()), Ok(()));
    assert_eq!(
        described(&|law| law.name = "pd".into()),
        Err("its hello says law \"pid\"; its --describe says \"pd\"".into())
    );
    assert_eq!(
        described(&|law| law.measured.clear()),
        Err("its hello says 1 measured signals; its --describe says 0".into())
    );
    assert_eq!(
        described(&|law| law.internals[0].unit = "m".into()),
        Err(
            "its hello says the internal signal \"integral_rad\" in \"rad\"; \
             its --describe says \"integral_rad\" in \"m\""
                .into()
        )
    );
    assert!(described(&|law| law.commands = None).is_err());
}

#[test]
fn a_law_for_any_plant_gets_the_plants_commands() {
    let welcome = answer(&Hello {
        commands: None,
        ..hello()
    })
    .expect("agreed");
    assert_eq!(
        welcome.command.fields(SignalKind::Command),
        [field("drive_rad")]
    );
}

#[test]
fn foreign_versions_and_sessions_are_refused() {
    let error = answer(&Hello {
        protocol: 99,
        ..hello()
    });
    assert_eq!(
        error,
        Err(Refused::Protocol {
            theirs: 99,
            ours: PROTOCOL
        })
    );
    assert_eq!(
        answer(&Hello {
            session: 6,
            ..hello()
        }),
        Err(Refused::Session)
    );
    let mut welcome = answer(&hello()).expect("agreed");
    welcome.sample.0.pop();
    assert_eq!(welcome.check(&hello()), Err(Refused::Layout));
}

#[test]
fn messages_survive_the_wire() {
    let message = Control::Welcome(Box::new(answer(&hello()).expect("agreed")));
    assert_eq!(Control::from_bytes(&message.to_bytes()), Ok(message));
    assert!(Control::from_bytes(b"\xff{").is_err());
}
