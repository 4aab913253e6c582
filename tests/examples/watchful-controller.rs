//! A controller process whose law looks at the quality of its sample. Not a program of the workspace: the tests of
//! validity give it to `--controller-bin`.

#[path = "../shared/watchful_law.rs"]
mod watchful_law;

use std::process::ExitCode;

use controller_process::controller::LawKind;

fn main() -> ExitCode {
    let laws = vec![LawKind::of::<watchful_law::Watchful>()];
    controller_process::program::run("watchful-controller", "0.1.0", laws)
}
