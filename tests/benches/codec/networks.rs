//! Cost of the second network of a bus in simulation.

use std::collections::BTreeMap;
use std::time::Instant;

use hil_config::plan::BusPlan;
use plant_process::faults::{Bus, FaultBuilder, FaultLayer, kinds};
use shared_types::describe::{PlantDescription, Settings};
use shared_types::frame::VALIDITY_WORDS;
use shared_types::record::RecordLayout;
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

/// Signals of a sample and of a command.
const SIGNALS: [usize; 2] = [22, 4];

/// Bus whose frames have counters and checksums, on one network or two.
pub(super) struct Networks {
    layer: FaultLayer,
    step: u64,
    measured: Vec<f64>,
}

impl Networks {
    pub(super) fn new(count: u8) -> Self {
        let fields = |count| {
            let signal = |index| Field::signal(&format!("s{index}"), "1", "A signal.");
            (0..count).map(signal).collect::<Vec<_>>()
        };
        let plant = PlantDescription {
            name: "plant".into(),
            summary: "A plant.".into(),
            parameters: Vec::new(),
            truth: Vec::new(),
            measured: fields(SIGNALS[0]),
            commands: fields(SIGNALS[1]),
            faults: Vec::new(),
            saves: false,
            port: None,
            state: None,
        };
        let rate = Rate::new(1000.0).expect("a rate");
        let settings = Settings::default();
        let builder = FaultBuilder::new(&plant, &[], &kinds::all(), &settings, (rate, 1), &[]);
        let builder = builder.expect("no parameter").with_networks(count);
        let plan = BusPlan {
            text: port(),
            dbc: BTreeMap::new(),
            networks: count,
            skew_limit_steps: None,
        };
        let bus = Bus::new(&plan, &plant, &[], rate).expect("a sound bus");
        let layer = FaultLayer::new(&builder, &[]).expect("no fault");
        let mut layer = layer.with_bus(Some(bus));
        let layout = RecordLayout {
            measured: plant.measured,
            command_signals: SIGNALS[1],
            command: plant.commands,
            ..RecordLayout::default()
        };
        layer.open(&builder, &layout).expect("signals that are");
        Self {
            layer,
            step: 0,
            measured: vec![0.5; SIGNALS[0]],
        }
    }

    /// Measures a step with a sample and a command, in ns.
    pub(super) fn step_ns(&mut self, rounds: u32) -> f64 {
        let (mut row, mut applied) = ([0.0; SIGNALS[0]], [0.0; SIGNALS[1]]);
        let begin = Instant::now();
        for _ in 0..rounds {
            let step = Step(self.step);
            self.measured[self.step as usize % SIGNALS[0]] += 0.01;
            self.layer.advance(step, None);
            let mut invalid = [0; VALIDITY_WORDS];
            (self.layer).sample(step, (&self.measured, &[]), &mut row, &mut invalid);
            self.layer.timing(step);
            let command = &row[..SIGNALS[1]];
            (self.layer).command(step, (0, 0), (command, &mut invalid), &mut applied);
            assert_eq!(applied, self.measured[..SIGNALS[1]]);
            self.step += 1;
        }
        begin.elapsed().as_nanos() as f64 / f64::from(rounds)
    }
}

/// Returns the text of the port file.
fn port() -> String {
    let frame = |carries: &str, group: &str, count: usize| {
        let signals =
            (0..count).map(|index| format!("{{ signal = \"{group}.s{index}\", type = \"f64\" }}"));
        let fields: Vec<String> = { signals }
            .chain([
                "{ kind = \"counter\", type = \"u8\" }".to_owned(),
                "{ kind = \"checksum\", type = \"u32\", algorithm = \"crc-32/iso-hdlc\" }".into(),
            ])
            .collect();
        let fields = fields.join(",\n");
        format!(
            "[[frames]]\nname = \"{carries}\"\ncarries = \"{carries}\"\nfields = [\n{fields}\n]\n"
        )
    };
    let [sample, command] = SIGNALS;
    let (sample, command) = (
        frame("sample", "measured", sample),
        frame("command", "command", command),
    );
    format!("port = 1\n{sample}{command}")
}
