//! Serial lines.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;

use hil_config::port::{MediumKind, Parity};
use rustix::fs::{FlockOperation, OFlags, flock};
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
        return Err(io::ErrorKind::InvalidInput.into());
    };
    // Without NOCTTY the line would become the terminal of the session.
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let line = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits().cast_signed())
        .open(device)?;
    flock(&line, FlockOperation::NonBlockingLockExclusive)?;
    let mut settings = tcgetattr(&line)?;
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
    tcsetattr(&line, OptionalActions::Now, &settings)?;
    // What was sent before is not of this run.
    tcflush(&line, QueueSelector::IFlush)?;
    Ok(line)
}
