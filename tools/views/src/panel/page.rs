//! HTTP responses of the panel's server, with the security headers for the browser.
//!
//! The page contains no data of the run: all data arrives through the WebSocket, which requires the secret. The
//! page is a single document, so the browser requests nothing else.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::request::Refused;
use crate::offline_page::PAGE;
use crate::pages::{CLOSER, CLOSER_STYLE, LENS, drawer, range_fields};
use crate::report::page::{UPLOT, UPLOT_STYLE};

/// Parts of the page's own script, in order: they are the body of one function.
const SCRIPT: [&str; 5] = [
    include_str!("assets/panel.js"),
    include_str!("assets/closer.js"),
    include_str!("assets/arrange.js"),
    include_str!("assets/branches.js"),
    include_str!("assets/connection.js"),
];
const STYLE: &str = include_str!("assets/panel.css");
/// Returns the page's own script.
fn script() -> String {
    format!("\"use strict\";\n(() => {{\n{}}})();\n", SCRIPT.concat())
}

/// Headers of every response except the WebSocket upgrade.
const HEADERS: &str = "Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\nCross-Origin-Opener-Policy: same-origin\r\nCross-Origin-Resource-Policy: same-origin\r\nConnection: close\r\n";

/// Content security policy of the page: its own script and style, identified by an unguessable nonce, and its own
/// WebSocket.
fn policy(host: &str, nonce: &str) -> String {
    format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src ws://{host}; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
}

/// Returns the page as a response.
pub(super) fn response(host: &str, nonce: &str, wants_body: bool) -> Vec<u8> {
    let page = page(nonce);
    let policy = policy(host, nonce);
    let length = page.len();
    let body = if wants_body { &*page } else { "" };
    format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {length}\r\nContent-Security-Policy: {policy}\r\n{HEADERS}\r\n{body}"
    )
    .into_bytes()
}

/// Returns a refusal as a response.
pub(super) fn refusal(refused: Refused) -> Vec<u8> {
    let Refused { status, reason } = refused;
    let length = reason.len() + 1;
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n{HEADERS}\r\n{reason}\n"
    )
    .into_bytes()
}

/// Returns the response that upgrades the connection to a WebSocket.
pub(super) fn switched(accept: &str) -> Vec<u8> {
    format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
    )
    .into_bytes()
}

fn page(nonce: &str) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "hil panel" }
                link rel="icon" href="data:,";
                style nonce=(nonce) { (PreEscaped(UPLOT_STYLE)) (PreEscaped(CLOSER_STYLE)) (PreEscaped(STYLE)) }
            }
            body {
                a.skip href="#plots" { "Skip to the plots" }
                (head())
                main {
                    section #plots aria-label="Plots" { p.hint #wait { "Waiting for the session." } }
                    aside #aside aria-label="Session" {
                        (arrangement())
                        (readings())
                        (requirements())
                        (occurrences())
                        (branch())
                        (faults())
                        (log())
                        (tune())
                        (inject())
                    }
                }
                (drawer())
                noscript { p.note { "The panel needs a browser with JavaScript." } }
                p #status .toast role="status" aria-live="polite" {}
                p #armed role="alert" hidden {
                    span #armed-verb { "Inject" } " " code #armed-words {} "?" br;
                    kbd { "y" } " " span #armed-does { "injects it" } ", any other key cancels."
                }
                script nonce=(nonce) { (PreEscaped(UPLOT)) }
                script nonce=(nonce) { (PreEscaped(PAGE)) }
                @for script in CLOSER.iter().chain([&LENS]) { script nonce=(nonce) { (PreEscaped(script)) } }
                script nonce=(nonce) { (PreEscaped(script())) }
            }
        }
    };
    page.into_string()
}

fn head() -> Markup {
    html! {
        header.bar {
            div.line {
                div.title {
                    span #state .badge { "connecting" }
                    h1 #scenario { "hil panel" }
                    span #session .hint {}
                    span #over .hint hidden {}
                }
                div.progress {
                    progress #progress .of-session max="1" value="0" aria-label="Progress of the run" {}
                    span #time .n {}
                    span #speed .n.hint {}
                }
            }
            div.line {
                div.controls.clock.of-session role="toolbar" aria-label="Clock" {
                    button #pause type="button" title="Space" disabled { "Pause" }
                    button #step type="button" title="s" disabled { "Step" }
                    button #steps type="button" title="S" disabled { "100 steps" }
                }
                div.controls.view role="toolbar" aria-label="Note and view" {
                    form #mark-form .of-session {
                        label.visually-hidden for="mark" { "Note at this step" }
                        input #mark type="text" maxlength="400" placeholder="Note at this step" title="m" autocomplete="off";
                        button type="submit" { "Mark" }
                    }
                    form #where-form {
                        label.visually-hidden for="where" { "Formula to search for" }
                        input #where type="text" maxlength="4000" title="w" autocomplete="off" spellcheck="false";
                        button type="submit" { "Where" }
                    }
                    label { "Window " select #window title="+ and -" {} }
                    button #look .of-session type="button" { "Look back" }
                    span #range .row hidden {
                        (range_fields())
                        button #follow type="button" title="End" { "Follow" }
                    }
                    button #arrange type="button" title="e" aria-pressed="false" { "Arrange" }
                    button #find type="button" title="Ctrl-K" { "Find" }
                    a #to-aside href="#aside" { "Values" }
                    button #theme type="button" aria-pressed="false" { "Dark" }
                    details.keys {
                        summary { "Keys" }
                        div {
                            kbd { "Space" } " pause, resume; " kbd { "s" } " one step, " kbd { "S" } " 100 steps; " kbd { "m" } " mark; "
                            kbd { "f" } " fault; " kbd { "t" } " tune; " kbd { "+" } " " kbd { "-" } " window; "
                            kbd { "1" } " to " kbd { "9" } ", then " kbd { "y" } ", prepared faults. "
                            br;
                            "A part of the run: drag over a plot, Ctrl and wheel, two fingers; Shift moves it, a double click shows all; "
                            kbd { "←" } " " kbd { "→" } " move, " kbd { "+" } " " kbd { "-" } " zoom, " kbd { "Home" } " whole, " kbd { "End" } " follow. "
                            br;
                            "Cursors: click twice, or " kbd { "a" } " " kbd { "b" } " at the pointer; " kbd { "," } " " kbd { "." } " and " kbd { "<" } " " kbd { ">" } " move them by a step, " kbd { "c" } " clears. "
                            br;
                            kbd { "e" } " arranges plots: then " kbd { "Alt" } " " kbd { "↑" } " " kbd { "↓" } " move the plot that has the focus, " kbd { "Delete" } " removes it. "
                            br;
                            kbd { "Ctrl" } " " kbd { "K" } " finds everything by its name; " kbd { "w" } " searches for the times at which a formula holds."
                        }
                    }
                }
            }
            p #band .hint hidden {}
            p #trouble .note role="alert" hidden {}
        }
    }
}

fn readings() -> Markup {
    html! {
        section #readings-box {
            details.fold #fold-readings open { summary { h2 #readings-title { "Readings" } } dl #readings {} }
        }
    }
}

fn requirements() -> Markup {
    html! {
        section #requirements-box hidden {
            h2 { "Requirements" }
            table { thead { tr { th scope="col" { "verdict" } th scope="col" { "name" } th.n scope="col" { "margin" } } } tbody #requirements {} }
        }
    }
}

fn tune() -> Markup {
    html! {
        section #tune-box hidden {
            details.fold #fold-tune open {
                summary { h2 { "Tune" } }
                div #knobs {}
                div.field { label for="tune-ramp" { "Ramp [s]" } input #tune-ramp inputmode="decimal" placeholder="at once" autocomplete="off"; }
                p #law-does .hint {}
            }
        }
    }
}

fn faults() -> Markup {
    html! {
        section #faults-box {
            h2 { "Faults" }
            ul #faults {}
            p #no-faults .hint { "No active or waiting faults." }
            button #clear-all type="button" hidden { "End all" }
        }
    }
}

fn inject() -> Markup {
    html! {
        section #inject-box hidden {
            details.fold #fold-inject open {
            summary { h2 { "Inject" } }
            div #buttons .row {}
            form #inject {
                div.field { label for="kind" { "Kind" } select #kind {} }
                p #kind-says .hint {}
                div.field #target-field { label for="target" { "Target" } select #target {} }
                div #parameters {}
                details {
                    summary { "Start and duration" }
                    div.field { label for="duration" { "Duration [s]" } input #duration inputmode="decimal" placeholder="until cleared"; }
                    div.field { label for="ramp" { "Ramp [s]" } input #ramp inputmode="decimal" placeholder="at once"; }
                    div.field { label for="when" { "When" } input #when placeholder="abs(truth.x) > 0.1"; }
                }
                div.row { button type="submit" .strong { "Inject" } code #words {} }
            }
            }
        }
    }
}

fn log() -> Markup {
    html! { section { h2 { "Log" } ol #log {} p #more-log .hint hidden {} p #no-log .hint { "Nothing yet." } } }
}

fn occurrences() -> Markup {
    html! {
        section #where-box hidden {
            h2 { "Where" }
            p #where-says {}
            ol #intervals {}
        }
    }
}

fn arrangement() -> Markup {
    html! {
        section #arrange-box hidden {
            h2 { "Arrangement" }
            div.field { label for="new-plot" { "New plot of" } select #new-plot {} }
            div.row {
                button #undo type="button" { "Undo" }
                button #reset type="button" { "Reset" }
                button #keep type="button" .strong { "Keep" }
            }
            div #kept hidden {
                p #kept-says {}
                ul #left-out .hint {}
                pre tabindex="0" role="region" aria-label="Plots of the scenario" { code #kept-toml {} }
                div.row {
                    button #write-plots type="button" { "Write to the scenario" }
                    button #copy-plots type="button" { "Copy" }
                }
            }
        }
    }
}

fn branch() -> Markup {
    html! {
        section #branch-box hidden {
            h2 { "Branch from here" }
            p #branch-says {}
            pre { code #branch-command {} }
            div.row {
                button #branch type="button" { "Branch" }
                button #copy-branch type="button" { "Copy" }
            }
            ul #branches {}
        }
    }
}
