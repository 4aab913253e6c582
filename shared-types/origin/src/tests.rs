use std::process;

use super::*;

const HEX: usize = 40;

/// Temporary folder, removed on drop. Does not use `tempfile`: build scripts depend on this package, and an added
/// dependency would make a test build recompile `iceoryx2` and everything above it.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        let folders = (0..).map(|number| {
            let name = format!("hil-origin-{}-{number}", process::id());
            std::env::temp_dir().join(name)
        });
        let mut folders = folders.take(1000);
        Self(
            folders
                .find(|new| fs::create_dir(new).is_ok())
                .expect("a folder"),
        )
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Two packages in `a` and `b`; one depends on the other by path.
fn two() -> Folder {
    let folder = Folder::new();
    for (name, dependencies) in [
        ("a", "[dependencies]\nb = { path = \"../b\" }\n"),
        ("b", ""),
    ] {
        let package = folder.path().join(name);
        fs::create_dir_all(package.join("src")).expect("a folder");
        fs::write(package.join("src/lib.rs"), "").expect("written");
        let manifest = format!(
            "[package]\nname = \"{name}\"\nversion = \"1.0.0\"\nedition = \"2024\"\n{dependencies}[workspace]\n"
        );
        fs::write(package.join("Cargo.toml"), manifest).expect("written");
    }
    fs::write(folder.path().join("a/Cargo.lock"), "version = 4\n").expect("written");
    folder
}

fn commit(folder: &Path) -> String {
    git(folder, &["init", "-q"]).expect("git");
    git(folder, &["add", "."]).expect("git");
    let person = ["-c", "user.name=a", "-c", "user.email=a@b"];
    let commit = ["commit", "-q", "--no-gpg-sign", "-m", "all"];
    git(folder, &[&person[..], &commit].concat()).expect("git");
    git(folder, &["rev-parse", "HEAD"]).expect("a commit")
}

#[test]
fn only_the_sources_of_both_packages_count() {
    let folder = two();
    let hash = commit(folder.path());
    let package = folder.path().join("a");
    let clean = Origin::of(&package);
    assert_eq!((clean.commit(), clean.is_modified), (hash.clone(), false));
    assert_eq!(clean.lock, Some(package.join("Cargo.lock")));
    let is_watched =
        |origin: &Origin, file: &str| origin.watched.contains(&folder.path().join(file));
    for watched in ["a/src", "b/src", "b/Cargo.toml", "a/Cargo.lock"] {
        assert!(is_watched(&clean, watched), "{clean:?}");
    }
    // A file beside the sources leaves the build unchanged.
    fs::write(folder.path().join("README.md"), "text").expect("written");
    assert_ne!(commit(folder.path()), hash);
    let same = Origin::of(&package);
    assert_eq!((same.commit(), same.is_modified), (hash.clone(), false));
    assert!(!is_watched(&same, ".git/HEAD"), "{same:?}");
    // An untracked file of the dependency.
    fs::write(folder.path().join("b/src/more.rs"), "").expect("written");
    let changed = Origin::of(&package);
    assert_eq!((changed.commit(), changed.is_modified), (hash, true));
    // The next commit contains the file without any source changing.
    assert!(is_watched(&changed, ".git/logs/HEAD"), "{changed:?}");
    let next = commit(folder.path());
    let clean = Origin::of(&package);
    assert_eq!((clean.commit(), clean.is_modified), (next, false));
}

#[test]
fn packages_of_two_repositories_have_two_commits_or_unknown() {
    let folder = two();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let theirs = commit(&b);
    let origin = Origin::of(&a);
    assert_eq!(origin.commit(), format!("{UNKNOWN}+{theirs}"));
    let own = commit(&a);
    assert_eq!(Origin::of(&a).commit(), format!("{own}+{theirs}"));
    assert_eq!(own.len(), HEX);
}

#[test]
fn an_untracked_package_inside_a_repository_has_no_commit() {
    let folder = two();
    fs::write(folder.path().join(".gitignore"), "/a\n/b\n").expect("written");
    commit(folder.path());
    let origin = Origin::of(&folder.path().join("a"));
    assert_eq!(
        (origin.commit(), origin.is_modified),
        (UNKNOWN.into(), false)
    );
    let text = origin.expression("1.0.0");
    assert!(text.contains("commit: None, modified: false"), "{text}");
}
