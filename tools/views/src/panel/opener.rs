//! Opens the page in the user's browser.
//!
//! The address contains the secret, and every user can read the arguments of a process. Therefore the opener gets a
//! file that only this user can read and that redirects to the address.

use std::io::Write;
use std::process::{Command, Stdio};

use maud::{DOCTYPE, html};
use tempfile::NamedTempFile;

/// Program that opens a file in the user's preferred application.
const OPENER: &str = "xdg-open";

/// Opens an address, if this machine has a screen and an opener; dropping the returned file removes it.
pub(super) fn open(url: &str) -> Option<NamedTempFile> {
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"]
        .iter()
        .any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if !has_screen {
        return None;
    }
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="referrer" content="no-referrer";
                meta http-equiv="refresh" content={ "0; url=" (url) };
                title { "hil panel" }
            }
        }
    };
    // Temporary files are readable by their owner only.
    let file = tempfile::Builder::new()
        .prefix("hil-panel-")
        .suffix(".html")
        .tempfile();
    let mut file = file.ok()?;
    file.write_all(page.into_string().as_bytes()).ok()?;
    file.flush().ok()?;
    let mut opener = Command::new(OPENER)
        .arg(file.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    std::thread::spawn(move || opener.wait());
    Some(file)
}
