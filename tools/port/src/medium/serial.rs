//! Serial lines.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};

use hil_config::port::{MediumKind, Parity};
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr,
};

/// Opens and configures a serial line: raw bytes, no flow control. The lock refuses a second port, and a terminal
/// program that locks lines as well.
///
/// # Errors
/// If the device is missing, another's, in use or no serial line.
pub(super) fn open(kind: &MediumKind) -> io::Result<File> {
    let MediumKind::Serial {
        device,
        baud,
        parity,
        data_bits,
        stop_bits,
    } = kind
    else {
        return Err(ErrorKind::InvalidInput.into());
    };
    // Without NOCTTY the line would become the terminal of the session.
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let line = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits().cast_signed())
        .open(device)
        .map_err(|error| in_words(device, error))?;
    flock(&line, FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| in_words(device, error.into()))?;
    let mut settings = tcgetattr(&line).map_err(|error| in_words(device, error.into()))?;
    settings.make_raw();
    settings.set_speed(*baud)?;
    let modes = &mut settings.control_modes;
    modes.remove(ControlModes::CSIZE | ControlModes::PARENB | ControlModes::PARODD);
    modes.remove(ControlModes::CSTOPB | ControlModes::CRTSCTS);
    modes.insert(ControlModes::CLOCAL | ControlModes::CREAD);
    modes.insert(match data_bits {
        7 => ControlModes::CS7,
        _ => ControlModes::CS8,
    });
    match parity {
        Parity::None => {}
        Parity::Even => modes.insert(ControlModes::PARENB),
        Parity::Odd => modes.insert(ControlModes::PARENB | ControlModes::PARODD),
    }
    if *stop_bits == 2 {
        modes.insert(ControlModes::CSTOPB);
    }
    tcsetattr(&line, OptionalActions::Now, &settings)
        .map_err(|error| in_words(device, error.into()))?;
    // What was sent before is not of this run.
    tcflush(&line, QueueSelector::IFlush)?;
    Ok(line)
}

/// Says how to mend an error of a line, where that is known.
fn in_words(device: &str, error: io::Error) -> io::Error {
    let text = match error.kind() {
        ErrorKind::NotFound => {
            "there is no such device; see `ls /dev/tty* /dev/serial/by-id`".into()
        }
        ErrorKind::PermissionDenied => match std::fs::metadata(device) {
            Ok(of_device) => format!(
                "this user may not open it: it belongs to user {}, group {}, and has the mode {:o}",
                of_device.uid(),
                of_device.gid(),
                of_device.mode() & 0o777
            ),
            Err(_) => return error,
        },
        ErrorKind::WouldBlock | ErrorKind::ResourceBusy => {
            "another program uses it; see `fuser` or `lsof`".into()
        }
        _ if Errno::from_io_error(&error) == Some(Errno::NOTTY) => "it is no serial line".into(),
        _ => return error,
    };
    io::Error::new(error.kind(), text)
}

#[cfg(test)]
mod tests {
    use hil_config::port::Parity;

    use super::*;

    fn refusal(device: &str) -> String {
        let kind = MediumKind::Serial {
            device: device.into(),
            baud: 9600,
            parity: Parity::None,
            data_bits: 8,
            stop_bits: 1,
        };
        open(&kind).expect_err("no line").to_string()
    }

    #[test]
    fn a_device_that_is_no_line_is_busy_or_is_absent_is_refused_with_the_reason() {
        assert_eq!(refusal("/dev/null"), "it is no serial line");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("line");
        let device = path.to_str().expect("text");
        assert!(refusal(device).starts_with("there is no such device"));
        let file = File::create(&path).expect("a file");
        assert_eq!(refusal(device), "it is no serial line");
        file.lock().expect("a lock");
        assert!(refusal(device).starts_with("another program uses it"));
    }
}
