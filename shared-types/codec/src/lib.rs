//! Frames on a wire: from a row of signals to bytes, and from bytes to a row with a result for each field.
//!
//! Called by ports and by the bus in simulation; `hil-config` reads the files that describe frames. Nothing here opens
//! a file or a socket, and nothing allocates for a frame after construction.
//!
//! 1. A [`Frame`](frame::Frame) lists fields: where each is in the bytes ([`bits`]) or in a JSON line, and its content: a
//!    signal as a [`number`], a constant, an alive counter, a [`checksum`].
//! 2. A [`Packer`](pack::Packer) binds a frame to the table of a row and packs rows. A value beyond the range of its field
//!    is packed as the limit and counted.
//! 3. A [`Receiver`](receive::Receiver) finds the frame that bytes belong to and unpacks them into a [`Row`](row::Row).
//!    A frame or field that cannot be used is refused with its [reason](row::Refusal) and is invalid in the row.
//! 4. At each step a row [advances](row::Row::advance): values get older, and stale ones become invalid.
//!
//! [`dbc`] reads messages of CAN into the same fields.

pub mod bits;
pub mod checksum;
pub mod dbc;
pub mod frame;
mod json;
pub mod number;
pub mod pack;
mod path;
pub mod receive;
pub mod row;
mod unpack;

#[cfg(test)]
mod tests;
