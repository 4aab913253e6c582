//! FMUs as shipped by vendors: libraries that rely on their host, documents in other encodings, crowded archives,
//! and values not foreseen by the standard. Each gives the number of its closed form, or is refused with the cause.

use std::path::PathBuf;
use std::process::Command;

use super::{Place, scenario};
use crate::support::fmus::{Entries, Packed, linked, platform, reference, write_packed};
use crate::support::harness::Run;
use crate::support::mcap_reader::Recording;
use crate::support::programs::workspace;

pub(super) const OUTPUT: &str =
    "<ScalarVariable name=\"y\" valueReference=\"1\" causality=\"output\"><Real/></ScalarVariable>";
/// Value of the output that needs libm.
const SINE: &str = "-DVALUE=sin(n * 0.1) + sqrt(2.0 + 0.0 * n)";
pub(super) const COUNTED: &str = "-DVALUE=n";

fn source() -> PathBuf {
    workspace().join("tests/fmus/odd.c")
}

/// Compiles `odd.c` with these options in place of libm.
pub(super) fn library(options: &[&str]) -> Vec<u8> {
    // Not the compiler's built-in `sin`: the call is what is tested.
    let all = [&["-fno-builtin"], options].concat();
    linked("odd", &[source()], &all, &[])
}

/// Describes `odd.c` with these variables, in the style of a vendor.
pub(super) fn description(token: &str, variables: &str, attributes: &str) -> String {
    let types = "<TypeDefinitions><SimpleType name=\"gear\"><Enumeration><Item name=\"P\" value=\"1\"/><Item name=\"R\" value=\"2\"/><Item name=\"D\" value=\"5\"/></Enumeration></SimpleType></TypeDefinitions>";
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><fmiModelDescription fmiVersion=\"2.0\" modelName=\"odd\" guid=\"{token}\"><CoSimulation modelIdentifier=\"odd\" {attributes}/>{types}<ModelVariables>{variables}</ModelVariables></fmiModelDescription>"
    )
}

pub(super) fn fmu(description: impl Into<Vec<u8>>, library: &[u8]) -> Entries {
    vec![
        ("modelDescription.xml".into(), description.into()),
        (format!("binaries/{}/odd.so", platform(2)), library.to_vec()),
    ]
}

pub(super) fn odd() -> String {
    scenario("odd", "odd.fmu", 100.0, 100.0)
}

fn last(run: &Run, signal: &str) -> f64 {
    let column = Recording::open(&run.recording()).column(signal);
    *column.last().expect("a record")
}

/// Compresses an entry of zeros, a multiple of 258 plus one, by a factor of 158: a block of fixed codes (RFC 1951).
fn with_zeros(name: &str, least: usize) -> Packed {
    let (mut bytes, mut bits, mut count) = (Vec::new(), 0_u32, 0);
    let mut put = |code: u32, length: u32| {
        bits |= code << count;
        count += length;
        while count >= 8 {
            bytes.push(bits as u8);
            (bits, count) = (bits >> 8, count - 8);
        }
    };
    // The last block, of fixed codes; codes have their highest bit first.
    put(0b011, 3);
    put(0b0000_1100, 8);
    let repeats = least.div_ceil(258);
    for _ in 0..repeats {
        put(0b1010_0011, 8);
        put(0, 5);
    }
    put(0, 7);
    put(0, 7); // up to a byte boundary
    let size = repeats * 258 + 1;
    Packed {
        name: name.into(),
        bytes,
        method: 8,
        crc: crc32fast::hash(&vec![0; size]),
        size,
    }
}

#[test]
fn a_library_that_relies_on_its_host_for_libm_runs() {
    let Some(place) = Place::new() else { return };
    let library = library(&[SINE]);
    place.fmu("odd.fmu", &fmu(description("t", OUTPUT, ""), &library));
    let run = place.run(&odd(), "").expect(0);
    let expected = libm::sin(10.0) + 2.0_f64.sqrt();
    assert!((last(&run, "truth.y") - expected).abs() < 1e-12);
    let needs = place.hil(&["describe", "odd.fmu", "--load"]).expect(0);
    for line in ["missing libraries: none", "undefined symbols: none"] {
        assert!(needs.stdout.contains(line), "{}", needs.stdout);
    }
}

#[test]
fn missing_symbols_and_libraries_are_listed_before_the_run() {
    let Some(place) = Place::new() else { return };
    // A function that is never defined nor called: a program in C would run it.
    let calls = "-DVALUE=n < 0.0 ? no_such_function(n) : n";
    let uncalled = linked("odd", &[source()], &[calls], &["-Wl,-z,lazy"]);
    place.fmu("odd.fmu", &fmu(description("t", OUTPUT, ""), &uncalled));
    assert_eq!(last(&place.run(&odd(), "").expect(0), "truth.y"), 100.0);
    let lacks = place.hil(&["describe", "odd.fmu", "--load"]).expect(0);
    let line = "undefined symbols: no_such_function";
    assert!(lacks.stdout.contains(line), "{}", lacks.stdout);
    // A missing library that it names.
    let absent = place.rig.path("libabsent_part.so");
    let empty = place.rig.write("empty.c", "int part(void) { return 1; }");
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC"])
        .arg(&empty)
        .arg("-o")
        .arg(&absent);
    assert!(cc.status().expect("a C compiler").success());
    let folder = format!("-L{}", place.rig.path("").display());
    let links = ["-Wl,--no-as-needed", &folder, "-labsent_part"];
    let named = linked("odd", &[source()], &[COUNTED], &links);
    place.fmu("odd.fmu", &fmu(description("t", OUTPUT, ""), &named));
    let lacks = place.hil(&["describe", "odd.fmu", "--load"]).expect(2);
    let line = "missing libraries: libabsent_part.so";
    assert!(lacks.stdout.contains(line), "{}", lacks.stdout);
    place
        .run(&odd(), "")
        .expect(2)
        .says(&["libabsent_part.so", "--load"]);
}

#[test]
fn a_description_in_any_common_encoding_gives_the_same_run() {
    let Some(place) = Place::new() else { return };
    let library = library(&[COUNTED]);
    let text = description("t", &OUTPUT.replace("/>", " unit=\"\u{b0}\"/>"), "");
    let declared = |name: &str| text.replace("UTF-8", name);
    let latin = |name: &str| -> Vec<u8> {
        let text = declared(name);
        text.chars()
            .map(|c| u8::try_from(c).expect("latin"))
            .collect()
    };
    let wide = |unit: fn(u16) -> [u8; 2]| -> Vec<u8> {
        let text = format!("\u{feff}{}", declared("UTF-16"));
        text.encode_utf16().flat_map(unit).collect()
    };
    let plain = declared("Shift_JIS").replace('\u{b0}', "deg").into_bytes();
    let mut digests = Vec::new();
    for bytes in [
        text.clone().into_bytes(),
        latin("ISO-8859-1"),
        latin("windows-1252"),
        wide(u16::to_le_bytes),
        wide(u16::to_be_bytes),
        plain,
    ] {
        place.fmu("odd.fmu", &fmu(bytes, &library));
        let run = place.run(&odd(), "").expect(0);
        assert_eq!(last(&run, "truth.y"), 100.0);
        digests.push(run.digest());
    }
    digests.dedup();
    assert_eq!(digests.len(), 1, "{digests:?}");
    let unknown = latin("Shift_JIS");
    place.fmu("odd.fmu", &fmu(unknown, &library));
    place.run(&odd(), "").expect(2).says(&["Shift_JIS"]);
}

#[test]
fn duplicate_entries_are_accepted_if_their_bytes_are_equal() {
    let Some(place) = Place::new() else { return };
    let mut entries = reference("Resource", 3);
    entries.push(("resources/y.txt".into(), entries[2].1.clone()));
    place.fmu("r.fmu", &entries);
    let text = scenario("Resource", "r.fmu", 1.0, 10.0);
    place.run(&text, "").expect(0);
    entries[3].1 = b"b".to_vec();
    place.fmu("r.fmu", &entries);
    place
        .run(&text, "")
        .expect(2)
        .says(&["resources/y.txt", "occurs twice"]);
}

#[test]
fn a_highly_compressed_archive_runs_if_the_scenario_trusts_it() {
    let Some(place) = Place::new() else { return };
    let entries = fmu(description("t", OUTPUT, ""), &library(&[COUNTED]));
    let mut packed: Vec<Packed> = entries.iter().map(Packed::stored).collect();
    packed.push(with_zeros("resources/table.bin", 40 << 20));
    let path = place.rig.path("odd.fmu");
    write_packed(&path, &packed);
    place
        .run(&odd(), "")
        .expect(2)
        .says(&["plant.trust_archive = true"]);
    place.hil(&["describe", "odd.fmu"]).expect(2);
    place
        .hil(&["describe", "odd.fmu", "--trust-archive"])
        .expect(0);
    let trusting = odd().replace("[plant]", "[plant]\ntrust_archive = true");
    let run = place.run(&trusting, "").expect(0);
    assert_eq!(last(&run, "truth.y"), 100.0);
    let again = place.rig.path("again");
    let arguments = ["rerun", run.folder.to_str().expect("text"), "--out"];
    place
        .hil(&[&arguments[..], &[again.to_str().expect("text")]].concat())
        .expect(0);
}

#[test]
fn an_fmu_that_needs_its_tool_runs_if_the_scenario_allows_it() {
    let Some(place) = Place::new() else { return };
    let needs = description("t", OUTPUT, "needsExecutionTool=\"true\"");
    place.fmu("odd.fmu", &fmu(needs, &library(&[COUNTED])));
    let key = "plant.allow_execution_tool";
    place
        .run(&odd(), "")
        .expect(2)
        .says(&["needsExecutionTool", key]);
    let run = place.run(&odd(), &format!("--set {key}=true")).expect(0);
    assert_eq!(last(&run, "truth.y"), 100.0);
    // For a controller the key is the controller's, and a plant that is not an FMU accepts none.
    let law = "schema = 1\nname = \"c\"\n[run]\nduration_s = 0.1\nrate_hz = 100\n[plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"odd\"\nprogram = \"odd.fmu\"\n";
    place
        .run(law, "")
        .expect(2)
        .says(&["controller.allow_execution_tool"]);
    place
        .run(
            law,
            &format!("--set {key}=true --set controller.allow_execution_tool=true"),
        )
        .expect(2)
        .says(&["is not an FMU", key]);
}

#[test]
fn an_enumeration_accepts_its_items_and_no_number_between_them() {
    let Some(place) = Place::new() else { return };
    let of = |name: &str, reference: u32, rest: &str, start: u32| {
        format!(
            "<ScalarVariable name=\"{name}\" valueReference=\"{reference}\" {rest} variability=\"discrete\"><Enumeration declaredType=\"gear\" start=\"{start}\"/></ScalarVariable>"
        )
    };
    let variables = [
        "<ScalarVariable name=\"y\" valueReference=\"1\" causality=\"output\" variability=\"discrete\"><Integer/></ScalarVariable>".into(),
        of("gear", 2, "causality=\"input\"", 1),
        of("mode", 3, "causality=\"parameter\"", 2),
    ]
    .concat();
    place.fmu(
        "odd.fmu",
        &fmu(description("t", &variables, ""), &library(&[COUNTED])),
    );
    for (item, code) in [(1, 0), (2, 0), (5, 0), (3, 3), (4, 3)] {
        let text = odd().replace("value = 1.0", &format!("value = {item}"));
        let run = place.run(&text, "").expect(code);
        if code == 0 {
            assert_eq!(last(&run, "truth.y"), f64::from(item));
        } else {
            run.says(&["not an item of its enumeration; use one of 1, 2, 5"]);
        }
    }
    for (item, code) in [(1, 0), (5, 0), (3, 2), (4, 2)] {
        place
            .run(&odd(), &format!("--set plant.parameters.mode={item}"))
            .expect(code);
    }
}

#[test]
fn a_boolean_is_true_for_any_nonzero_number() {
    let Some(place) = Place::new() else { return };
    let variables = "<ScalarVariable name=\"b\" valueReference=\"1\" causality=\"output\" variability=\"discrete\"><Boolean/></ScalarVariable>";
    place.fmu(
        "odd.fmu",
        &fmu(description("t", variables, ""), &library(&[COUNTED])),
    );
    let run = place.run(&odd(), "").expect(0);
    let flags = Recording::open(&run.recording()).column("truth.b");
    let expected = (0..=100_u8).map(|step| f64::from(step % 2));
    assert_eq!(flags, expected.collect::<Vec<_>>());
}

#[test]
fn a_start_value_outside_its_range_must_be_set() {
    let Some(place) = Place::new() else { return };
    let variables = format!(
        "{OUTPUT}<ScalarVariable name=\"p\" valueReference=\"3\" causality=\"parameter\"><Real start=\"7\" min=\"0\" max=\"5\"/></ScalarVariable>"
    );
    let library = library(&["-DVALUE=one->real[P] + 0.0 * n"]);
    place.fmu("odd.fmu", &fmu(description("t", &variables, ""), &library));
    place
        .run(&odd(), "")
        .expect(2)
        .says(&["`plant.parameters.p` is missing"]);
    let run = place.run(&odd(), "--set plant.parameters.p=5").expect(0);
    assert_eq!(last(&run, "truth.y"), 5.0);
    place.run(&odd(), "--set plant.parameters.p=7").expect(2);
}

#[test]
fn an_unusable_local_variable_is_omitted_and_listed() {
    let Some(place) = Place::new() else { return };
    let long = "v".repeat(300);
    let inner = |name: &str, reference: u32, start: &str| {
        format!(
            "<ScalarVariable name=\"{name}\" valueReference=\"{reference}\"><Real {start}/></ScalarVariable>"
        )
    };
    let unusable = inner("w", 3, "start=\"1,5\"");
    let variables = [unusable, OUTPUT.into(), inner(&long, 4, "")].concat();
    place.fmu(
        "odd.fmu",
        &fmu(description("t", &variables, ""), &library(&[COUNTED])),
    );
    for locals in ["", "--set plant.locals=[\"*\"]"] {
        let run = place.run(&odd(), locals).expect(0);
        assert_eq!(last(&run, "truth.y"), 100.0);
    }
    let listed = place.hil(&["describe", "odd.fmu"]).expect(0).stdout;
    for fragment in ["  w: `start` of Real", "has 300 bytes"] {
        assert!(listed.contains(fragment), "{fragment} is not in {listed}");
    }
}

#[test]
fn a_missing_library_is_named_with_the_existing_ones() {
    let Some(place) = Place::new() else { return };
    let library = library(&[COUNTED]);
    let described = description("t", OUTPUT, "");
    let with = |name: &str| {
        let mut entries = fmu(described.clone(), &library);
        entries[1].0 = name.into();
        entries
    };
    let own = format!("binaries/{}/Other.so", platform(2));
    for (name, fragments) in [
        (own.as_str(), ["odd.so", "Other.so"]),
        ("binaries/win64/odd.dll", ["odd.so", "win64"]),
        ("sources/odd.c", ["odd.so", "fmpy compile"]),
        ("resources/odd.txt", ["odd.so", "no library at all"]),
    ] {
        place.fmu("odd.fmu", &with(name));
        place.run(&odd(), "").expect(2).says(&fragments);
    }
}

#[test]
fn a_crash_of_an_fmu_is_reported_with_signal_and_call() {
    let Some(place) = Place::new() else { return };
    let library = library(&[COUNTED]);
    for call in [
        "fmi2Instantiate",
        "fmi2SetupExperiment",
        "fmi2EnterInitializationMode",
        "fmi2ExitInitializationMode",
        "fmi2GetReal",
        "fmi2DoStep",
        "fmi2Terminate",
        "fmi2FreeInstance",
    ] {
        let token = format!("crash {call}");
        place.fmu("odd.fmu", &fmu(description(&token, OUTPUT, ""), &library));
        let run = place.run(&odd(), "").expect(3);
        let words = format!("{}{}", run.stdout, run.stderr);
        let named = format!("SIGSEGV in {call}");
        assert!(words.contains(&named), "{call}: {words}");
        assert!(
            words.contains("was killed by SIGSEGV (11)"),
            "{call}: {words}"
        );
    }
}

#[test]
fn an_exit_of_an_fmu_is_reported_with_exit_code_and_call() {
    let Some(place) = Place::new() else { return };
    // A function that is called before there is an instance.
    let early = library(&[COUNTED, "-DEXITS_AT_VERSION"]);
    let library = library(&[COUNTED]);
    for (call, code) in [
        ("fmi2GetVersion", 2),
        ("fmi2Instantiate", 2),
        ("fmi2SetupExperiment", 2),
        ("fmi2EnterInitializationMode", 2),
        ("fmi2ExitInitializationMode", 2),
        ("fmi2GetReal", 2),
        ("fmi2DoStep", 3),
        ("fmi2Terminate", 3),
        ("fmi2FreeInstance", 3),
    ] {
        let token = format!("exit {call}");
        let library = match call {
            "fmi2GetVersion" => &early,
            _ => &library,
        };
        place.fmu("odd.fmu", &fmu(description(&token, OUTPUT, ""), library));
        let run = place.run(&odd(), "").expect(code);
        let words = format!("{}{}", run.stdout, run.stderr);
        let named = format!("exit(7) was called in {call}");
        for fragment in [named.as_str(), "no license for the hydraulics library"] {
            assert!(words.contains(fragment), "{call}: {words}");
        }
    }
}

#[test]
fn an_fmu_may_take_long_to_free_after_a_complete_run() {
    let Some(place) = Place::new() else { return };
    let late = description("late 3000", OUTPUT, "");
    place.fmu("odd.fmu", &fmu(late, &library(&[COUNTED])));
    let run = place.run(&odd(), "--wait-limit 60").expect(0);
    assert_eq!(last(&run, "truth.y"), 100.0);
}

#[test]
fn a_message_passed_by_its_text_argument_is_the_reason_of_the_end() {
    let Some(place) = Place::new() else { return };
    // Some libraries pass a constant instead of the environment they were given.
    for token in ["say the tank is empty", "lost the tank is empty"] {
        place.fmu(
            "odd.fmu",
            &fmu(description(token, OUTPUT, ""), &library(&[COUNTED])),
        );
        let run = place.run(&odd(), "").expect(3);
        run.says(&["answered DoStep with Error: the tank is empty"]);
    }
}

#[test]
fn an_fmu_that_can_be_freed_only_after_a_step_runs() {
    let Some(place) = Place::new() else { return };
    let described = description("unstepped", OUTPUT, "");
    place.fmu("odd.fmu", &fmu(described, &library(&[COUNTED])));
    let run = place.run(&odd(), "").expect(0);
    assert_eq!(last(&run, "truth.y"), 100.0);
}

#[test]
fn an_fmu_may_take_longer_to_start_than_a_step_may() {
    let Some(place) = Place::new() else { return };
    let slow = description("slow 1500", OUTPUT, "");
    place.fmu("odd.fmu", &fmu(slow, &library(&[COUNTED])));
    let run = place.run(&odd(), "--wait-limit 0.5").expect(0);
    assert_eq!(last(&run, "truth.y"), 100.0);
}
