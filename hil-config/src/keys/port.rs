//! Keys of a port file: media, frames and fields.

use hil_codec::checksum::NAMES;

use super::{Key, KeyKind, SectionKind, TEXT, choice, integer, integer_or, number, number_or};

/// Supported version of the format of port files.
const VERSION: i64 = 1;

const ANY: f64 = f64::MAX;

/// Largest number of frames in a port file.
pub(crate) const MOST_FRAMES: usize = 256;
/// Largest number of fields in a frame.
pub(crate) const MOST_FIELDS: usize = 512;

/// The whole port file.
pub(crate) const PORT: &[Key] = keys! {
    port!: integer(VERSION, VERSION),
        "Version of this format; the first key of the file, by which a port file is recognised.";
    name: TEXT, "Name of the port: letters, digits, - and _. Default: the file's name up to the first dot.";
    description: TEXT, "Purpose of the port.";
    exchange: choice(&["answers", "free"]),
        "As a controller: each sample is answered, or the newest command is used without waiting for one.";
    repeatable: KeyKind::Boolean { default: true },
        "The far end gives the same commands for the same samples. Set it to false if it keeps a clock of its own.";
    start: KeyKind::Texts,
        "Program that starts the far end, with its arguments, in the folder of this file. Default: the far end is waited for.";
    ready: TEXT,
        "Beginning of the line that the started program prints once it can be used. Default: it can be used at once.";
    media: KeyKind::List(MEDIUM), "Media on which frames travel. A bus that is only simulated needs none.";
    frames!: KeyKind::List(FRAME), "Frames.";
    safe_repeats: integer_or(1, 1000, 5),
        "Number of times that each frame of safe values is sent at the end of a run.";
    safe_period_s: number_or("s", 1e-4, 1.0, 0.02), "Time from one frame of safe values to the next.";
    watchdog: TEXT,
        "Watchdog device, as /dev/watchdog, which resets the hardware if this machine stops. It is fed while a run lasts and disarmed at an orderly end.";
};

/// `[[media]]`.
pub(crate) const MEDIUM: &[Key] = keys! {
    name: TEXT, "Name, by which frames refer to the medium. Default: its kind.";
    kind!: TEXT, "Kind of medium.";
};

const TO: Key = key! { to: TEXT, "Address and port to which frames are sent." };
const LISTEN: Key = key! { listen: TEXT, "Own address and port at which frames arrive." };
const FD: Key = key! {
    fd: KeyKind::Boolean { default: false }, "Frames of CAN FD, with up to 64 bytes."
};

/// Kinds of `[[media]]`.
pub(crate) const MEDIA: &[SectionKind] = kinds! {
    "udp": "Datagrams, one frame in each. At least one of both addresses is needed." {
        ..TO;
        ..LISTEN;
    }
    "tcp": "A stream. One of both addresses is needed." {
        connect: TEXT, "Address and port of the peer, which listens.";
        listen: TEXT, "Own address and port, to which the peer connects.";
    }
    "unix": "A socket of this machine." {
        path!: TEXT, "Path of the socket.";
        socket: choice(&["datagram", "stream"]), "Datagrams, one frame in each, or a stream.";
        listens: KeyKind::Boolean { default: false },
            "The port makes the socket and the peer connects to it.";
    }
    "serial": "A serial line." {
        device!: TEXT, "Device, as /dev/ttyUSB0.";
        baud: integer_or(50, 4_000_000, 115_200), "Symbols a second.";
        parity: choice(&["none", "even", "odd"]), "Parity bit.";
        data_bits: integer_or(7, 8, 8), "Bits of a character.";
        stop_bits: integer_or(1, 2, 1), "Stop bits.";
    }
    "can": "A CAN interface of the kernel." {
        interface!: TEXT, "Interface, as can0.";
        ..FD;
    }
    "cannelloni": "CAN frames in UDP datagrams, in the format of cannelloni." {
        ..TO;
        ..LISTEN;
        ..FD;
    }
    "file": "A file that holds one frame, such as that of a converter below /sys." {
        path!: TEXT, "Path of the file.";
    }
};

/// `[[frames]]`.
pub(crate) const FRAME: &[Key] = keys! {
    name!: TEXT, "Name of the frame: letters, digits, - and _.";
    carries!: KeyKind::Text { choices: &["sample", "command"], default: None },
        "Direction: a sample travels from the plant to the controller, a command from the controller to the plant.";
    medium: TEXT, "Medium. Default: the only one.";
    format: choice(&["bytes", "json"]), "Bits at fixed places, or a line of JSON.";
    order: choice(&["little", "big"]), "Byte order of the fields that have none of their own.";
    length: integer(1, 4096), "Number of bytes. Default: up to the last field.";
    id: integer(0, (1 << 29) - 1), "Identifier, on CAN only.";
    extended: KeyKind::Boolean { default: false }, "The identifier has 29 bits instead of 11.";
    dbc: TEXT, "DBC file, relative to the port file, that describes the frame; only with `message`.";
    message: TEXT, "Message of the DBC file.";
    divider: integer(1, 1 << 40),
        "The frame is sent at every so many steps. Default: 1, unless there is a period.";
    period_s: number("s", 1e-9, 1e9), "Period of the frame, a whole number of steps; instead of `divider`.";
    stale_s: number("s", 0.0, 1e9),
        "Age above which a received value is stale, and the signal invalid. Default: none.";
    fields!: KeyKind::List(FIELD), "Fields.";
};

/// `[[frames.fields]]`: keys of every kind.
pub(crate) const FIELD: &[Key] = keys! {
    kind: choice(&["signal", "valid", "constant", "counter", "checksum"]), "Content of the field.";
    name: TEXT,
        "Name of the field in messages. Default: the signal's name, the kind, or that in the DBC file.";
    type: TEXT, "Number of bits and form: u1 to u64 without sign, i2 to i64 with sign, f32 or f64.";
    order: KeyKind::Text { choices: &["little", "big"], default: None },
        "Byte order. Default: that of the frame.";
    byte: integer(0, 4095), "Byte in which the field begins, from 0. Default: behind the field before.";
    bit: integer(0, 7),
        "Bit of that byte in which the field begins; 0 is the least significant. A little-endian field begins with its least significant bit and grows upwards, a big-endian one begins with its most significant bit and grows downwards, as in a DBC file. Default: 0, or 7 if big-endian.";
    path: TEXT, "Place in a line of JSON, as imu.gyro[0]; empty if the line is the number alone.";
    dbc_signal: TEXT, "Signal of the DBC message, which gives type, place, scale, offset, range and unit.";
};

const SIGNAL: Key = key! {
    signal!: TEXT, "Signal: measured.NAME or reference.NAME in a sample, command.NAME in a command."
};

/// Kinds of `[[frames.fields]]`.
pub(crate) const FIELDS: &[SectionKind] = kinds! {
    "signal": "The value of a signal: wire = scale * raw + offset in the unit of the wire, which is converted to that of the signal. Beyond the range the limit is sent, and counted." {
        ..SIGNAL;
        signal_unit: TEXT, "Unit of the signal. Default: the unit that the name's ending stands for, else 1.";
        unit: TEXT, "Unit on the wire. Default: that of the signal.";
        scale: number_or("", f64::MIN, ANY, 1.0), "Value of one raw number.";
        offset: number_or("", f64::MIN, ANY, 0.0), "Value of the raw number 0.";
        range: KeyKind::Pair, "Range in the unit of the wire. Default: all that the type can express.";
        invalid: integer(0, i64::MAX), "Raw number, as bits without sign, that stands for no value.";
        safe: number("", f64::MIN, ANY),
            "Safe value of a command in the unit of the wire, the last that a plant behind the port gets however a run ends. A port in front of a plant needs one for each command.";
    }
    "valid": "A number that is 1 while a signal of the same frame is valid, else 0." {
        ..SIGNAL;
    }
    "constant": "A fixed number, or in JSON a number or text. A frame with another value is refused." {
        value: integer(0, i64::MAX), "The raw number.";
        text: TEXT, "The text, in JSON only.";
    }
    "counter": "A number that grows by one with each frame and starts again at 0. A frame that repeats or jumps is refused, and the count goes on from there." {
        counter_bits: integer(1, 32), "Number of bits that count. Default: those of the field, in JSON 32.";
        max_jump: integer_or(1, i64::MAX, 1),
            "Largest accepted step; with 3, two frames in a row may be lost.";
    }
    "checksum": "A checksum over bytes of the frame, always without its own. A frame with another sum is refused." {
        algorithm!: KeyKind::Text { choices: NAMES, default: None },
            "A sum or xor of bytes, or a CRC by its name in the catalogue of parametrised CRC algorithms (reveng.sourceforge.io/crc-catalogue).";
        first_byte: integer_or(0, 4095, 0), "First byte of the sum.";
        last_byte: integer(0, 4095), "Last byte of the sum. Default: the last of the frame.";
    }
};
