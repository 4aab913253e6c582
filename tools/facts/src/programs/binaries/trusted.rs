//! Files that only this user and root can have written; only programs named by such files are run.
//!
//! Follows the path component by component, including links, so that nobody else can replace the file before it is
//! run. Programs named on the command line are not checked, except for the folder of a campaign, which names
//! programs itself.

use std::ffi::OsString;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::{Component, Path, PathBuf};

use rustix::fs::lgetxattr;
use rustix::process::geteuid;

/// Maximum number of links in a path, as in the kernel.
const MOST_LINKS: u32 = 40;
/// Mode bits: writable by group or others.
const WRITABLE: u32 = 0o022;
/// Mode bit: only owners may remove entries.
const STICKY: u32 = 0o1000;
/// Mode bits: runs as another user or group.
const SETS_ID: u32 = 0o6000;

/// Resolves the path of a program, if nobody but this user and root can have created it.
///
/// # Errors
/// If the program is not trusted, with the reason.
pub fn program(path: &Path) -> Result<PathBuf, String> {
    let (path, metadata) = file(path)?;
    if metadata.mode() & SETS_ID != 0 {
        let path_text = path.display();
        return Err(format!(
            "{path_text} runs as another user or group (setuid or setgid)"
        ));
    }
    Ok(path)
}

/// Resolves the path of a regular file, if nobody but this user and root can have written it.
///
/// # Errors
/// If the file is not trusted, with the reason.
pub fn file(path: &Path) -> Result<(PathBuf, Metadata), String> {
    let path = std::path::absolute(path).map_err(|error| error.to_string())?;
    let (path, metadata) = walk(&path)?;
    match metadata.is_file() {
        true => Ok((path, metadata)),
        false if metadata.is_dir() => Err(format!("{} is a folder", path.display())),
        false => Err(format!("{} is not a regular file", path.display())),
    }
}

/// Resolves the path of a folder, if nobody but this user and root can add entries.
///
/// # Errors
/// If the folder is not trusted, with the reason.
pub fn folder(path: &Path) -> Result<PathBuf, String> {
    let path = std::path::absolute(path).map_err(|error| error.to_string())?;
    let (path, metadata) = walk(&path)?;
    match metadata.is_dir() {
        true => Ok(path),
        false => Err(format!("{} is not a folder", path.display())),
    }
}

/// Resolves an absolute path.
fn walk(path: &Path) -> Result<(PathBuf, Metadata), String> {
    let mut at = PathBuf::from("/");
    let mut ahead = parts(path);
    let mut links = 0;
    while let Some(part) = ahead.pop() {
        looked_at(&at)?;
        if part == ".." {
            at.pop();
            continue;
        }
        let next = at.join(&part);
        if !looked_at(&next)?.is_symlink() {
            at = next;
            continue;
        }
        links += 1;
        if links > MOST_LINKS {
            return Err(format!("{} contains too many links", path.display()));
        }
        let target = fs::read_link(&next).map_err(|error| describe(&next, &error))?;
        if target.is_absolute() {
            at = PathBuf::from("/");
        }
        ahead.extend(parts(&target));
    }
    let metadata = looked_at(&at)?;
    Ok((at, metadata))
}

/// Returns the components of a path, the last one first.
fn parts(path: &Path) -> Vec<OsString> {
    let named = path.components().filter_map(|part| match part {
        Component::Normal(_) | Component::ParentDir => Some(part.as_os_str().to_owned()),
        _ => None,
    });
    let mut parts: Vec<OsString> = named.collect();
    parts.reverse();
    parts
}

fn describe(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}", path.display())
}

/// Returns the metadata of a path, if only this user and root can have created the entry.
fn looked_at(path: &Path) -> Result<Metadata, String> {
    let metadata = fs::symlink_metadata(path).map_err(|error| describe(path, &error))?;
    let (path_text, user) = (path.display(), geteuid().as_raw());
    let owner = metadata.uid();
    if owner != user && owner != 0 {
        return Err(format!("{path_text} belongs to another user ({owner})"));
    }
    // The mode of a link has no meaning.
    let (mode, is_shared) = (
        metadata.mode(),
        metadata.is_dir() && metadata.mode() & STICKY != 0,
    );
    if metadata.is_symlink() || mode & WRITABLE == 0 || is_shared {
        return Ok(metadata);
    }
    let by_group_alone = mode & 0o002 == 0;
    if by_group_alone && is_private(metadata.gid(), user) && !has_list(path) {
        return Ok(metadata);
    }
    let mode = mode & 0o7777;
    Err(format!(
        "{path_text} can be written by others (mode {mode:04o})"
    ))
}

/// Returns `true` if an access control list grants rights to additional users.
fn has_list(path: &Path) -> bool {
    lgetxattr(path, "system.posix_acl_access", &mut [0_u8; 0]).is_ok()
}

/// Returns `true` if a group has this user as its only member.
fn is_private(group: u32, user: u32) -> bool {
    let read = |path| fs::read_to_string(path).unwrap_or_default();
    is_group_of_one(group, user, &read("/etc/passwd"), &read("/etc/group"))
}

/// Evaluates the files of users and groups: the group must be the primary group of this user and of nobody else, have
/// the user's name, and have no other members.
fn is_group_of_one(group: u32, user: u32, users: &str, groups: &str) -> bool {
    let (group, user) = (group.to_string(), user.to_string());
    let split = |line: &str| line.split(':').map(str::to_owned).collect::<Vec<_>>();
    let firsts = users.lines().map(split);
    let firsts: Vec<Vec<String>> = firsts
        .filter(|entry| entry.get(3) == Some(&group))
        .collect();
    let [own] = &firsts[..] else {
        return false;
    };
    let groups: Vec<Vec<String>> = (groups.lines().map(split))
        .filter(|entry| entry.get(2) == Some(&group))
        .collect();
    let [entry] = &groups[..] else {
        return false;
    };
    let members = entry.get(3).map_or("", String::as_str);
    own.get(2) == Some(&user) && own[0] == entry[0] && (members.is_empty() || members == own[0])
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use tempfile::TempDir;

    use super::*;

    /// Creates a folder with a program in a subfolder.
    fn place() -> (TempDir, PathBuf) {
        let place = TempDir::new().expect("a folder");
        let bin = place.path().join("bin");
        fs::create_dir(&bin).expect("a folder");
        set(&bin, 0o755);
        let program = bin.join("program");
        fs::write(&program, "#!/bin/sh\n").expect("a file");
        set(&program, 0o755);
        (place, program)
    }

    fn set(path: &Path, mode: u32) {
        fs::set_permissions(path, Permissions::from_mode(mode)).expect("it is ours");
    }

    fn refused(path: &Path, fragment: &str) {
        let why = program(path).expect_err(fragment);
        assert!(why.contains(fragment), "{why}");
    }

    #[test]
    fn the_path_of_an_own_program_is_resolved() {
        let (place, own) = place();
        let own = fs::canonicalize(own).expect("it is there");
        let (link, folder) = (place.path().join("link"), place.path().join("folder"));
        symlink("bin/program", &link).expect("a link");
        symlink(place.path().join("bin"), &folder).expect("a link");
        for path in [
            own.clone(),
            link,
            folder.join("program"),
            folder.join("../bin/./program"),
        ] {
            assert_eq!(program(&path), Ok(own.clone()), "{path:?}");
        }
    }

    #[test]
    fn a_program_that_others_can_write_is_refused() {
        let (_place, own) = place();
        for mode in [0o757, 0o777] {
            set(&own, mode);
            refused(&own, "can be written by others");
        }
    }

    #[test]
    fn a_program_in_a_folder_that_others_can_write_is_refused() {
        let (place, own) = place();
        let bin = place.path().join("bin");
        set(&bin, 0o777);
        refused(&own, "bin can be written by others (mode 0777)");
        // As in /tmp, nobody else can remove or rename it there.
        set(&bin, 0o1777);
        program(&own).expect("it cannot be replaced");
        set(&bin, 0o755);
        set(place.path(), 0o777);
        refused(&own, "can be written by others");
    }

    #[test]
    fn a_link_in_a_folder_that_others_can_write_is_refused_wherever_it_leads() {
        let (place, own) = place();
        let open = place.path().join("open");
        fs::create_dir(&open).expect("a folder");
        symlink(&own, open.join("link")).expect("a link");
        set(&open, 0o777);
        refused(&open.join("link"), "open can be written by others");
    }

    #[test]
    fn a_path_without_a_program_is_refused() {
        let (place, own) = place();
        refused(place.path(), "is a folder");
        refused(&place.path().join("bin/.."), "is a folder");
        refused(Path::new("/dev/null"), "/dev/null");
        refused(&place.path().join("none"), "No such file");
        refused(&own.join("below"), "Not a directory");
        symlink("round", place.path().join("round")).expect("a link");
        refused(&place.path().join("round"), "too many links");
        set(&own, 0o4755);
        refused(&own, "setuid");
        set(&own, 0o2755);
        refused(&own, "setgid");
    }

    #[test]
    fn a_program_of_another_user_is_refused() {
        let (_place, own) = place();
        // Only root can give it away.
        if geteuid().is_root() {
            std::os::unix::fs::chown(&own, Some(12345), None).expect("as root");
            refused(&own, "belongs to another user (12345)");
        }
    }

    #[test]
    fn a_group_is_private_if_it_has_a_single_user() {
        let users = "root:x:0:0::/root:/bin/sh\nann:x:1000:1000::/home/ann:/bin/sh\nbob:x:1001:100::/home/bob:/bin/sh\n";
        let groups = "root:x:0:\nann:x:1000:\nusers:x:100:\n";
        assert!(is_group_of_one(1000, 1000, users, groups));
        let with = |members: &str| groups.replace("ann:x:1000:", &format!("ann:x:1000:{members}"));
        assert!(is_group_of_one(1000, 1000, users, &with("ann")));
        assert!(!is_group_of_one(1000, 1000, users, &with("ann,bob")));
        assert!(!is_group_of_one(1000, 1000, users, &with("bob")));
        assert!(
            !is_group_of_one(1000, 1001, users, groups),
            "not the own one"
        );
        assert!(
            !is_group_of_one(100, 1001, users, groups),
            "of another name"
        );
        let two = users.replace("bob:x:1001:100", "bob:x:1001:1000");
        assert!(!is_group_of_one(1000, 1000, &two, groups));
        assert!(!is_group_of_one(1000, 1000, users, ""));
    }
}
