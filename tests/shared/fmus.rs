//! FMUs that tests and benches run, built with the machine's C compiler: the Reference-FMUs, whose sources are in
//! `tests/third-party`, and those of `tests/fmus`. An archive is written here, with stored entries.

use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) type Entries = Vec<(String, Vec<u8>)>;

/// The Reference-FMUs with co-simulation, each with its version of FMI and the rate of its own steps.
pub(crate) const REFERENCE: [(&str, u32, f64); 14] = [
    ("BouncingBall", 2, 1000.0),
    ("BouncingBall", 3, 1000.0),
    ("Dahlquist", 2, 10.0),
    ("Dahlquist", 3, 10.0),
    ("Feedthrough", 2, 10.0),
    ("Feedthrough", 3, 10.0),
    ("Resource", 2, 1.0),
    ("Resource", 3, 1.0),
    ("Roberts", 3, 1000.0),
    ("Stair", 2, 5.0),
    ("Stair", 3, 5.0),
    ("StateSpace", 3, 1.0),
    ("VanDerPol", 2, 100.0),
    ("VanDerPol", 3, 100.0),
];

/// Returns the folder of the libraries for this machine.
pub(crate) fn platform(version: u32) -> &'static str {
    match (version, cfg!(target_arch = "x86_64")) {
        (2, true) => "linux64",
        (_, true) => "x86_64-linux",
        (_, false) => "aarch64-linux",
    }
}

/// Returns true if a C compiler is available.
pub(crate) fn has_compiler() -> bool {
    let asked = Command::new("cc").arg("--version").output();
    asked.is_ok_and(|output| output.status.success())
}

/// Compiles sources with these options into a library; returns its bytes.
pub(crate) fn compiled(name: &str, sources: &[PathBuf], options: &[&str]) -> Vec<u8> {
    linked(name, sources, options, &["-lm"])
}

/// Compiles the same, linked with other libraries than libm.
pub(crate) fn linked(
    name: &str,
    sources: &[PathBuf],
    options: &[&str],
    libraries: &[&str],
) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let library = folder.path().join(format!("{name}.so"));
    let include = third_party().join("include");
    let mut cc = Command::new("cc");
    // A fused product would round once: the numbers of a machine would be its own.
    cc.args(["-shared", "-fPIC", "-O1", "-ffp-contract=off", "-I"])
        .arg(include);
    cc.args(options)
        .args(sources)
        .arg("-o")
        .arg(&library)
        .args(libraries);
    let output = cc.output().expect("a C compiler");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{cc:?} failed:\n{said}");
    std::fs::read(&library).expect("it was built")
}

fn third_party() -> PathBuf {
    tests().join("third-party/reference-fmus")
}

fn tests() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Returns a Reference-FMU, as entries of its archive.
pub(crate) fn reference(model: &str, version: u32) -> Entries {
    let place = third_party();
    let source = |name: &str| place.join(name);
    let sources = [
        source(&format!("{model}/model.c")),
        source(&format!("src/fmi{version}Functions.c")),
        source("src/cosimulation.c"),
    ];
    let (own, number) = (source(model), format!("-DFMI_VERSION={version}"));
    let own = format!("-I{}", own.display());
    let library = compiled(
        model,
        &sources,
        &[&number, "-DDISABLE_PREFIX", "-fvisibility=hidden", &own],
    );
    let read = |name: &str| std::fs::read(source(name)).expect("it is vendored");
    let mut entries = vec![
        (
            "modelDescription.xml".into(),
            read(&format!("{model}/FMI{version}.xml")),
        ),
        (
            format!("binaries/{}/{model}.so", platform(version)),
            library,
        ),
    ];
    if model == "Resource" {
        entries.push(("resources/y.txt".into(), read("Resource/y.txt")));
    }
    entries
}

/// The FMU of `tests/fmus` that is a controller and can misbehave, as entries of its archive.
pub(crate) fn proportional() -> Entries {
    own("proportional")
}

/// The FMU of `tests/fmus` that is a plant in millimetres and kilonewtons, as entries of its archive.
pub(crate) fn slider() -> Entries {
    own("slider")
}

fn own(name: &str) -> Entries {
    let place = tests().join("fmus");
    let description = std::fs::read(place.join(format!("{name}.xml"))).expect("it is there");
    entries(name, 3, description, &[])
}

/// Returns an FMU built from a source of `tests/fmus`, as entries of its archive.
pub(crate) fn entries(name: &str, version: u32, description: Vec<u8>, options: &[&str]) -> Entries {
    built(&[name], version, description, options)
}

/// Returns the same entries for FMPy, which looks up every function of the standard.
pub(crate) fn entries_for_fmpy(
    name: &str,
    version: u32,
    description: Vec<u8>,
    options: &[&str],
) -> Entries {
    built(&[name, "every_function"], version, description, options)
}

fn built(names: &[&str], version: u32, description: Vec<u8>, options: &[&str]) -> Entries {
    let name = names[0];
    let source = |name: &&str| tests().join(format!("fmus/{name}.c"));
    let sources: Vec<PathBuf> = names.iter().map(source).collect();
    let version_of = format!("-DFMI_VERSION={version}");
    let library = compiled(name, &sources, &[&[version_of.as_str()], options].concat());
    vec![
        ("modelDescription.xml".into(), description),
        (format!("binaries/{}/{name}.so", platform(version)), library),
    ]
}

/// An entry ready to be written into an archive.
pub(crate) struct Packed {
    pub(crate) name: String,
    /// Packed content, and the method of compression.
    pub(crate) bytes: Vec<u8>,
    pub(crate) method: u8,
    pub(crate) crc: u32,
    pub(crate) size: usize,
}

impl Packed {
    /// Packs an entry without compression.
    pub(crate) fn stored((name, content): &(String, Vec<u8>)) -> Self {
        Self {
            name: name.clone(),
            bytes: content.clone(),
            method: 0,
            crc: crc32fast::hash(content),
            size: content.len(),
        }
    }
}

/// Writes an archive of stored entries.
pub(crate) fn write(path: &Path, entries: &[(String, Vec<u8>)]) {
    let packed: Vec<Packed> = entries.iter().map(Packed::stored).collect();
    write_packed(path, &packed);
}

/// Writes an archive.
pub(crate) fn write_packed(path: &Path, entries: &[Packed]) {
    let size = |number: usize| u32::try_from(number).expect("small").to_le_bytes();
    let (mut bytes, mut list) = (Vec::new(), Vec::new());
    for entry in entries {
        let name = &entry.name;
        let length = u16::try_from(name.len()).expect("short").to_le_bytes();
        let mut middle = vec![0, 0, entry.method, 0, 0, 0, 0, 0];
        middle.extend(entry.crc.to_le_bytes());
        middle.extend(size(entry.bytes.len()));
        middle.extend(size(entry.size));
        middle.extend(length);
        middle.extend([0; 2]);
        let head = bytes.len();
        bytes.extend(b"PK\x03\x04\x14\0");
        bytes.extend(&middle);
        bytes.extend(name.as_bytes());
        bytes.extend(&entry.bytes);
        list.extend(b"PK\x01\x02\x14\x03\x14\0");
        list.extend(&middle);
        list.extend([0; 6]);
        list.extend((0o100_644_u32 << 16).to_le_bytes());
        list.extend(size(head));
        list.extend(name.as_bytes());
    }
    let count = u16::try_from(entries.len()).expect("few").to_le_bytes();
    let place = bytes.len();
    bytes.extend(&list);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend(count);
    bytes.extend(count);
    bytes.extend(size(list.len()));
    bytes.extend(size(place));
    bytes.extend([0; 2]);
    std::fs::write(path, bytes).expect("written");
}
