//! Open loops in the file that `hil margins -o` writes. Never measures anything.

use std::path::Path;

use hil_config::Response;
use hil_config::scenario::read_regular;
use hil_console::terminal::exit::Failure;

/// First line of the file.
const HEAD: &str = "command,at_s,frequency_hz,real,imaginary,";

/// Returns the open loops, each with the command at which it was cut; a time of its own names each of several.
pub(super) fn read(path: &Path) -> Result<Vec<(String, Vec<Response>)>, Failure> {
    let path_text = path.display();
    let text = read_regular(path)
        .map_err(|error| Failure::usage(format!("cannot read {path_text}: {error}")))?;
    let mut lines = text.lines();
    if !lines.next().is_some_and(|line| line.starts_with(HEAD)) {
        return Err(Failure::usage(format!(
            "{path_text} has no open loops; `hil margins SCENARIO -o FILE` writes them"
        )));
    }
    let mut loops: Vec<(String, String, Vec<Response>)> = Vec::new();
    for (number, line) in (2..).zip(lines) {
        let cells: Vec<&str> = line.split(',').collect();
        let numbers = cells.get(2..5).map(|cells| {
            let numbers = cells.iter().map(|cell| cell.parse::<f64>());
            numbers.collect::<Result<Vec<f64>, _>>()
        });
        let Some(Ok(numbers)) = numbers else {
            return Err(Failure::usage(format!(
                "{path_text}, line {number}: expected a command, a time, a frequency and a response, separated by commas"
            )));
        };
        let [frequency_hz, re, im] = numbers[..] else {
            continue;
        };
        let response = Response {
            frequency_hz,
            gain: libm::hypot(re, im),
            phase_rad: libm::atan2(im, re),
        };
        let (command, at_s) = (cells[0], cells[1]);
        match loops.last_mut() {
            Some((last, last_s, responses)) if last == command && last_s == at_s => {
                responses.push(response);
            }
            _ => loops.push((command.into(), at_s.into(), vec![response])),
        }
    }
    let is_single = |command: &str| loops.iter().filter(|one| one.0 == command).count() == 1;
    let named = loops.iter().map(|(command, at_s, responses)| {
        let name = match is_single(command) {
            true => command.clone(),
            false => format!("{command} at {at_s} s"),
        };
        (name, unwrapped(responses))
    });
    Ok(named.collect())
}

/// Returns the responses by frequency, with a phase that does not jump by a turn.
fn unwrapped(responses: &[Response]) -> Vec<Response> {
    use std::f64::consts::TAU;
    let mut responses = responses.to_vec();
    responses.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    let mut before_rad = responses.first().map_or(0.0, |first| first.phase_rad);
    for response in &mut responses {
        let turns = libm::round((response.phase_rad - before_rad) / TAU);
        response.phase_rad -= TAU * turns;
        before_rad = response.phase_rad;
    }
    responses
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_of_a_loop_does_not_jump() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("loop.csv");
        let head = format!("{HEAD}gain_db,phase_deg,amplitude,coherence,change\n");
        let rows = "command.u,5,1,0,-1,0,-90,1,1,0\ncommand.u,5,3,0,1,0,90,1,1,0\ncommand.u,5,2,-1,-0.1,0,0,1,1,0\n";
        std::fs::write(&path, format!("{head}{rows}")).expect("written");
        let loops = read(&path).expect("read");
        assert_eq!(loops.len(), 1);
        let phases = loops[0]
            .1
            .iter()
            .map(|one| libm::round(one.phase_rad.to_degrees()));
        assert_eq!(phases.collect::<Vec<_>>(), [-90.0, -174.0, -270.0]);
        assert_eq!(loops[0].0, "command.u");
        std::fs::write(&path, "a,b\n1,2\n").expect("written");
        let refused = read(&path).expect_err("refused").to_string();
        assert!(
            refused.contains("hil margins SCENARIO -o FILE"),
            "{refused}"
        );
        std::fs::write(&path, format!("{head}command.u,5,x\n")).expect("written");
        let refused = read(&path).expect_err("refused").to_string();
        assert!(refused.contains("line 2: expected"), "{refused}");
    }
}
