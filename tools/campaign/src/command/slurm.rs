//! Workers on a Slurm cluster: submits a job array over the missing shards.
//!
//! Slurm starts tasks and may restart them, but its reports never determine a result. [`Tasks`] holds these reports.

mod tasks;

use std::fs;
use std::process::Command;

use crate::folder::Folder;
use crate::shard::missing;
use shared_types::number::counted;

use hil_console::terminal::duration::shown_ns;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
pub(super) use tasks::Tasks;

use super::planned::{self, cannot, program};
use super::work::open;
use crate::arguments::SubmitArguments;

/// Subfolder with a file for each submitted job.
const JOBS: &str = "jobs";
/// Subfolder of the tasks' output.
const LOGS: &str = "logs";
/// Maximum estimated duration of a task, as a share of the partition's time limit.
const SHARE_OF_LIMIT: f64 = 0.5;

/// Submits the missing shards.
///
/// # Errors
/// If Slurm is not available, or refuses the job.
pub(super) fn submit(arguments: &SubmitArguments) -> Result<Exit, Failure> {
    let folder = open(&arguments.folder)?;
    planned::check(&folder)?;
    let (manifest, missing) = (folder.manifest(), missing(&folder));
    // Left over from an earlier submission whose status may never be asked for again.
    if let Some(tasks) = tasks(&folder) {
        let stuck = tasks.stuck(missing.is_empty(), true);
        stuck.iter().for_each(|line| tell!("{line}"));
    }
    if missing.is_empty() {
        output::write("nothing is missing\n")?;
        return Ok(Exit::Pass);
    }
    let cases = manifest.count(&missing);
    let task_s = task_s(arguments)?;
    let by_time = (cases as f64 * manifest.case_s / task_s).ceil() as u64;
    let tasks = match planned::has_port(&folder) {
        true => 1,
        false => by_time.clamp(1, missing.len() as u64).min(most_tasks()?),
    };
    let path = std::path::absolute(folder.path()).map_err(Failure::infrastructure)?;
    let text = |path: &std::path::Path| super::cases::text_of(path).map(str::to_owned);
    let quoted = |path: &std::path::Path| {
        let path = text(path)?;
        let quoted = shlex::try_quote(&path).map_err(Failure::usage)?;
        Ok::<_, Failure>(quoted.into_owned())
    };
    let (program, folder_text) = (quoted(&program(&folder)?)?, quoted(&path)?);
    for folder in [LOGS, JOBS] {
        fs::create_dir_all(path.join(folder)).map_err(Failure::infrastructure)?;
    }
    let mut sbatch = Command::new("sbatch");
    sbatch
        .arg("--parsable")
        .arg(format!("--array=0-{}", tasks - 1))
        .arg("--requeue")
        .arg("--open-mode=append")
        .arg(format!("--job-name={}", manifest.name))
        // Slurm expands patterns that begin with a percent sign.
        .arg(format!(
            "--output={}/%A_%a.log",
            text(&path.join(LOGS))?.replace('%', "%%")
        ))
        .args(&arguments.options)
        .arg(format!(
            "--wrap=exec {program} campaign work {folder_text} --task $SLURM_ARRAY_TASK_ID/{tasks}"
        ));
    if arguments.dry_run {
        let all = std::iter::once("sbatch".into())
            .chain(sbatch.get_args().map(|one| one.to_string_lossy()));
        let all: Vec<String> = all
            .map(|one: std::borrow::Cow<'_, str>| one.into_owned())
            .collect();
        let line = shlex::try_join(all.iter().map(String::as_str)).map_err(Failure::usage)?;
        output::write(&format!("{line}\n"))?;
        return Ok(Exit::Pass);
    }
    let answer = output_of(&mut sbatch)?;
    let job = answer
        .trim()
        .split(';')
        .next()
        .unwrap_or_default()
        .to_owned();
    fs::write(path.join(JOBS).join(&job), "").map_err(|error| cannot(&folder, &error))?;
    let each_ns = cases as f64 * manifest.case_s / tasks as f64 * 1e9;
    output::write(&format!(
        "job {job}: {} for {} in {}, about {} each\nhil campaign status {folder_text} --watch\n",
        counted(tasks, "task"),
        counted(cases, "case"),
        counted(missing.len() as u64, "shard"),
        shown_ns(each_ns as u64)
    ))?;
    Ok(Exit::Pass)
}

/// Runs a Slurm program and returns its output.
fn output_of(command: &mut Command) -> Result<String, Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| {
        Failure::usage(format!(
            "cannot run {name}: {error}; --slurm needs a machine that can submit to Slurm"
        ))
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let why = String::from_utf8_lossy(&output.stderr);
    Err(Failure::usage(format!("{name}: {}", why.trim())))
}

/// Returns the greatest number of tasks in an array.
fn most_tasks() -> Result<u64, Failure> {
    let text = output_of(Command::new("scontrol").args(["show", "config"]))?;
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MaxArraySize"));
    let most = line.and_then(|rest| rest.split('=').nth(1)?.trim().parse().ok());
    Ok(most.unwrap_or(1001).max(1))
}

/// Chooses the duration of a task: as requested, but well below the time limit of the partition.
fn task_s(arguments: &SubmitArguments) -> Result<f64, Failure> {
    if !(arguments.task_s.is_finite() && arguments.task_s > 0.0) {
        return Err(Failure::usage("--task-s must be a number above 0"));
    }
    let mut sinfo = Command::new("sinfo");
    sinfo.args(["--noheader", "--format=%l"]);
    if let Some(partition) = option(&arguments.options, "-p", "--partition") {
        sinfo.arg(format!("--partition={partition}"));
    }
    let limits = output_of(&mut sinfo)?;
    let time_option = option(&arguments.options, "-t", "--time");
    let all = limits.lines().chain(time_option.as_deref());
    let least = all
        .filter_map(|limit| limit_s(limit.trim()))
        .fold(f64::INFINITY, |a, b| if a < b { a } else { b });
    let most = least * SHARE_OF_LIMIT;
    Ok(if arguments.task_s < most {
        arguments.task_s
    } else {
        most
    })
}

/// Finds the value of an option in the arguments of sbatch.
fn option(options: &[String], short: &str, long: &str) -> Option<String> {
    options.iter().enumerate().find_map(|(place, one)| {
        if one == short || one == long {
            return options.get(place + 1).cloned();
        }
        let long = one
            .strip_prefix(long)
            .and_then(|rest| rest.strip_prefix('='));
        // sbatch also accepts the form `-pshort`.
        let short = one.strip_prefix(short).filter(|_| !one.starts_with("--"));
        long.or(short).map(str::to_owned)
    })
}

/// Parses a time limit, `minutes`, `hours:minutes:seconds` or `days-hours:minutes:seconds`; `None` means no limit.
fn limit_s(text: &str) -> Option<f64> {
    let (days, rest) = text
        .split_once('-')
        .map_or((None, text), |(days, rest)| (Some(days), rest));
    let parts: Option<Vec<f64>> = rest.split(':').map(|part| part.parse().ok()).collect();
    let seconds = match (days, &parts?[..]) {
        (None, [minutes]) => minutes * 60.0,
        (None, [minutes, seconds]) => minutes * 60.0 + seconds,
        (Some(_), [hours]) => hours * 3600.0,
        (Some(_), [hours, minutes]) => hours * 3600.0 + minutes * 60.0,
        (_, [hours, minutes, seconds]) => hours * 3600.0 + minutes * 60.0 + seconds,
        _ => return None,
    };
    let days: f64 = days.map_or(Some(0.0), |days| days.parse().ok())?;
    Some(days * 86_400.0 + seconds).filter(|limit| *limit > 0.0) // 0 is no limit for sbatch
}

/// Queries Slurm for the tasks of a campaign; `None` if nothing was submitted or Slurm does not answer.
pub(super) fn tasks(folder: &Folder) -> Option<Tasks> {
    let jobs = fs::read_dir(folder.path().join(JOBS)).ok()?;
    let mut jobs: Vec<String> = jobs
        .flatten()
        .map(|job| job.file_name().to_string_lossy().into_owned())
        .collect();
    if jobs.is_empty() {
        return None;
    }
    jobs.sort_by_key(|job| (job.len(), job.clone()));
    let mut tasks = Tasks::default();
    for job in jobs {
        let mut squeue = Command::new("squeue");
        squeue.args(["--noheader", "--array", "--format=%i %T %r"]);
        match output_of(squeue.arg(format!("--jobs={job}"))) {
            Ok(listed) => tasks.take(&job, &listed),
            // The job ended so long ago that Slurm has forgotten it.
            Err(failure) if failure.to_string().contains("Invalid job id") => {}
            Err(_) => return None,
        }
    }
    Some(tasks)
}

#[cfg(test)]
mod tests {
    use super::{limit_s, option};

    #[test]
    fn time_limits_are_parsed_in_each_format_of_slurm() {
        for (text, seconds) in [
            ("30", Some(1800.0)),
            ("1:30", Some(90.0)),
            ("2:00:00", Some(7200.0)),
            ("1-00:00:00", Some(86_400.0)),
            ("1-2", Some(93_600.0)),
            ("infinite", None),
            ("0", None),
        ] {
            assert_eq!(limit_s(text), seconds, "{text}");
        }
    }

    #[test]
    fn options_of_sbatch_are_found_in_each_form() {
        let options = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        for text in [
            "-p short",
            "--partition short",
            "-n 1 --partition=short",
            "-pshort",
        ] {
            assert_eq!(
                option(&options(text), "-p", "--partition").as_deref(),
                Some("short")
            );
        }
        assert_eq!(option(&options("-n 1"), "-p", "--partition"), None);
    }
}
