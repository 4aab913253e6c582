use std::io::Cursor;

use super::*;

/// Writer of valid and invalid archives.
struct Writer {
    bytes: Vec<u8>,
    list: Vec<u8>,
    entries: u16,
}

/// Entry to write.
struct TestEntry<'a> {
    name: &'a str,
    content: &'a [u8],
    flags: u16,
    method: u16,
    mode: u32,
    /// Size according to the list.
    listed_size: usize,
}

impl<'a> TestEntry<'a> {
    fn new(name: &'a str, content: &'a [u8]) -> Self {
        Self {
            name,
            content,
            flags: 0,
            method: DEFLATED,
            mode: FILE | 0o644,
            listed_size: content.len(),
        }
    }
}

impl Writer {
    fn new() -> Self {
        Self {
            bytes: Vec::new(),
            list: Vec::new(),
            entries: 0,
        }
    }

    fn add(mut self, entry: &TestEntry<'_>) -> Self {
        let packed = match entry.method {
            STORED => entry.content.to_vec(),
            _ => miniz_oxide::deflate::compress_to_vec(entry.content, 6),
        };
        let short = |number: usize| u16::try_from(number).expect("short").to_le_bytes();
        let long = |number: usize| u32::try_from(number).expect("long").to_le_bytes();
        let mut middle = Vec::new();
        middle.extend(entry.flags.to_le_bytes());
        middle.extend(entry.method.to_le_bytes());
        middle.extend([0; 4]);
        middle.extend(crc32fast::hash(entry.content).to_le_bytes());
        middle.extend(long(packed.len()));
        middle.extend(long(entry.listed_size));
        middle.extend(short(entry.name.len()));
        middle.extend(short(0));
        let head = self.bytes.len();
        self.bytes.extend(HEAD_MARK);
        self.bytes.extend([20, 0]);
        self.bytes.extend(&middle);
        self.bytes.extend(entry.name.as_bytes());
        self.bytes.extend(packed);
        self.list.extend(LISTED_MARK);
        self.list.extend([20, 3, 20, 0]);
        self.list.extend(&middle);
        self.list.extend([0; 6]);
        self.list.extend((entry.mode << 16).to_le_bytes());
        self.list.extend(long(head));
        self.list.extend(entry.name.as_bytes());
        self.entries += 1;
        self
    }

    fn finish(mut self) -> Vec<u8> {
        let list = u32::try_from(self.bytes.len()).expect("short");
        self.bytes.extend(&self.list);
        self.bytes.extend(END_MARK);
        self.bytes.extend([0; 4]);
        self.bytes.extend(self.entries.to_le_bytes());
        self.bytes.extend(self.entries.to_le_bytes());
        let length = u32::try_from(self.list.len()).expect("short");
        self.bytes.extend(length.to_le_bytes());
        self.bytes.extend(list.to_le_bytes());
        self.bytes.extend([0; 2]);
        self.bytes
    }
}

fn read(bytes: &[u8]) -> Result<Archive<Cursor<&[u8]>>, ArchiveError> {
    Archive::read(Cursor::new(bytes), &LIMITS)
}

fn refused(bytes: &[u8], fragment: &str) {
    let message = read(bytes).expect_err(fragment).to_string();
    assert!(message.contains(fragment), "{message}");
}

fn one(entry: &TestEntry<'_>) -> Vec<u8> {
    Writer::new().add(entry).finish()
}

fn sound() -> Vec<u8> {
    let long = "a line of text\n".repeat(100);
    Writer::new()
        .add(&TestEntry::new("modelDescription.xml", long.as_bytes()))
        .add(&TestEntry {
            mode: FOLDER | 0o755,
            ..TestEntry::new("resources/", b"")
        })
        .add(&TestEntry {
            method: STORED,
            mode: 0,
            ..TestEntry::new("resources/y.txt", b"y")
        })
        .finish()
}

#[test]
fn files_are_read_and_unpacked_unchanged() {
    let bytes = sound();
    let mut archive = read(&bytes).expect("sound");
    let names: Vec<_> = archive.names().collect();
    assert_eq!(names, ["modelDescription.xml", "resources/y.txt"]);
    let content = archive.content("modelDescription.xml", 1 << 20);
    assert_eq!(content.expect("sound").len(), 1500);
    let error = archive
        .content("modelDescription.xml", 1000)
        .expect_err("long");
    assert!(error.to_string().contains("is larger than"), "{error}");
    let error = archive.content("other", 1000).expect_err("none");
    assert_eq!(error.to_string(), "the archive has no other");
    let folder = tempfile::tempdir().expect("a folder");
    assert_eq!(
        archive
            .extract("resources/", folder.path())
            .expect("unpacked"),
        1
    );
    let text = std::fs::read(folder.path().join("resources/y.txt"));
    assert_eq!(text.expect("there"), b"y");
    assert!(!folder.path().join("modelDescription.xml").exists());
}

#[test]
fn names_that_leave_the_archive_are_refused() {
    for name in [
        "../x",
        "a/../../x",
        "/etc/passwd",
        "a//b",
        "a/./b",
        "..",
        ".",
        "",
        "c:/x",
        "a\\b",
        "a\u{1}b",
    ] {
        let bytes = one(&TestEntry::new(name, b""));
        refused(&bytes, "does not name a file inside the archive");
    }
    let deep = "a/".repeat(DEEPEST + 1) + "b";
    refused(&one(&TestEntry::new(&deep, b"")), "does not name a file");
    let long = "a".repeat(LONGEST_NAME + 1);
    refused(&one(&TestEntry::new(&long, b"")), "does not name a file");
}

#[test]
fn an_entry_for_the_root_folder_is_ignored() {
    let folder = TestEntry {
        mode: FOLDER | 0o755,
        method: STORED,
        ..TestEntry::new("./", b"")
    };
    let archive = Writer::new().add(&folder).add(&TestEntry::new("a", b"1"));
    let archive = Archive::read(Cursor::new(archive.finish()), &LIMITS).expect("sound");
    assert_eq!(archive.names().collect::<Vec<_>>(), ["a"]);
    let content = TestEntry {
        method: STORED,
        mode: FOLDER | 0o755,
        ..TestEntry::new("./", b"1")
    };
    refused(&one(&content), "does not name a file");
}

#[test]
fn links_devices_and_conflicting_entries_are_refused() {
    for mode in [0o120_777, 0o020_644, 0o060_644, 0o010_644, 0o140_644] {
        let entry = TestEntry {
            mode,
            ..TestEntry::new("resources/x", b"/etc/passwd")
        };
        refused(&one(&entry), "is a link or a device");
    }
    let twice = Writer::new()
        .add(&TestEntry::new("a", b"1"))
        .add(&TestEntry::new("a", b"2"));
    refused(&twice.finish(), "occurs twice");
    let both = Writer::new()
        .add(&TestEntry::new("a", b"1"))
        .add(&TestEntry::new("a/b", b"2"));
    refused(&both.finish(), "occurs twice");
}

#[test]
fn duplicate_entries_with_equal_content_are_merged() {
    let stored = TestEntry {
        method: STORED,
        ..TestEntry::new("a", b"1")
    };
    let twice = Writer::new()
        .add(&TestEntry::new("a", b"1"))
        .add(&TestEntry::new("b", b"2"))
        .add(&stored);
    let bytes = twice.finish();
    let mut archive = read(&bytes).expect("sound");
    assert_eq!(archive.names().collect::<Vec<_>>(), ["a", "b"]);
    assert_eq!(archive.content("a", 10).expect("there"), b"1");
    let folder = tempfile::tempdir().expect("a folder");
    assert_eq!(archive.extract("a", folder.path()).expect("unpacked"), 1);
    // Same checksum and size but other bytes, so the content itself has to be compared.
    let mut forged = Writer::new()
        .add(&TestEntry {
            method: STORED,
            ..TestEntry::new("a", b"11111111")
        })
        .add(&TestEntry {
            method: STORED,
            ..TestEntry::new("a", b"11111112")
        })
        .finish();
    let sum = crc32fast::hash(b"11111111").to_le_bytes();
    let list = forged.len() - END_BYTES as usize - LISTED_BYTES - 1;
    forged[list + 16..list + 20].copy_from_slice(&sum);
    let reason = read(&forged).expect_err("another content").to_string();
    assert!(reason.contains("is damaged"), "{reason}");
}

#[test]
fn a_trusted_archive_may_have_any_ratio_but_not_any_size() {
    let zeros = vec![0; 40 << 20];
    let table = one(&TestEntry::new("resources/table.csv", &zeros));
    refused(&table, "more than 100 times its size");
    let trusted = |bytes: &[u8]| {
        let archive = Archive::read(Cursor::new(bytes), &TRUSTED);
        archive.map(|archive| archive.names().count())
    };
    assert_eq!(trusted(&table).expect("trusted"), 1);
    let bomb = one(&TestEntry {
        listed_size: 1100 << 20,
        ..TestEntry::new("a", &zeros)
    });
    let reason = trusted(&bomb).expect_err("large").to_string();
    assert!(reason.contains("more than 1024 MiB"), "{reason}");
}

#[test]
fn encryption_other_methods_and_split_archives_are_refused_with_a_reason() {
    let encrypted = TestEntry {
        flags: 1,
        ..TestEntry::new("a", b"1")
    };
    refused(&one(&encrypted), "is encrypted");
    let other = TestEntry {
        method: 14,
        ..TestEntry::new("a", b"1")
    };
    refused(&one(&other), "method 14");
    let mut parts = sound();
    let end = parts.len() - END_BYTES as usize;
    parts[end + 4] = 1;
    refused(&parts, "one part of several");
    let mut large = sound();
    large[end + 16..end + 20].fill(0xff);
    refused(&large, "ZIP64");
}

#[test]
fn bombs_are_refused_before_anything_is_unpacked() {
    let zeros = vec![0; 1 << 20];
    let bomb = Writer::new().add(&TestEntry {
        listed_size: 600 << 20,
        ..TestEntry::new("a", &zeros)
    });
    refused(&bomb.finish(), "times its size");
    let mut many = Writer::new();
    for number in 0..4 {
        let name = format!("a{number}");
        many = many.add(&TestEntry {
            listed_size: 500 << 20,
            ..TestEntry::new(&name, b"")
        });
    }
    refused(&many.finish(), "MiB, more than 1024 MiB");
    let mut crowd = Writer::new();
    for number in 0..=LIMITS.entries {
        crowd = crowd.add(&TestEntry::new(&number.to_string(), b""));
    }
    refused(&crowd.finish(), "entries, more than 10000");
    // Two entries with the same content, as in bombs that unpack each byte many times.
    let shared = Writer::new()
        .add(&TestEntry::new("a", &zeros))
        .add(&TestEntry::new("b", b""));
    let mut bytes = shared.finish();
    let list = bytes.len() - END_BYTES as usize - LISTED_BYTES - 1;
    bytes[list + 42..list + 46].fill(0);
    refused(&bytes, "overlap");
}

#[test]
fn content_that_does_not_match_the_list_is_refused() {
    let longer = TestEntry {
        listed_size: 10,
        ..TestEntry::new("a", b"0123456789 and more")
    };
    let shorter = TestEntry {
        listed_size: 100,
        ..TestEntry::new("a", b"0123456789")
    };
    for entry in [longer, shorter] {
        let bytes = one(&entry);
        let error = read(&bytes).expect("a sound list").content("a", 1000);
        assert!(matches!(error, Err(ArchiveError::Content(_))), "{error:?}");
    }
    let mut bytes = sound();
    let name = b"resources/y.txt";
    let place = { bytes.windows(name.len()) }
        .position(|part| part == name)
        .expect("its head");
    bytes[place + name.len()] ^= 1;
    let mut archive = read(&bytes).expect("a sound list");
    let error = archive
        .content("resources/y.txt", 10)
        .expect_err("another byte");
    assert!(error.to_string().contains("is damaged"), "{error}");
}

#[test]
fn truncated_and_modified_archives_never_cause_a_panic() {
    let whole = sound();
    for length in 0..whole.len() {
        let _ = read(&whole[..length]).expect_err("cut");
    }
    for place in 0..whole.len() {
        let mut other = whole.clone();
        other[place] ^= 0x55;
        if let Ok(mut archive) = read(&other) {
            let names: Vec<String> = archive.names().map(str::to_owned).collect();
            for name in names {
                let _ = archive.content(&name, 1 << 20); // any answer is one
            }
        }
    }
}
