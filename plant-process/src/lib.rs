//! The plant emulator: what stands in for the hardware.
//!
//! One step, as [`engine`] runs it:
//!
//! 1. [`faults`] brings the parameters to step `k`.
//! 2. The [`plant`] is measured, [`instruments`] make of its readings what is sensed, [`stimulus`] gives
//!    the reference signals, and the sample is sent.
//! 3. While the controller works, the record of step `k - 1` is published.
//! 4. The command of step `k` comes and passes its faults and instruments; [`guard`] checks the truth
//!    that it meets.
//! 5. The model in [`models`] is carried to step `k + 1` by [`integrate`]; [`rows`] notes the record.
//!
//! `checkpoint` is what is kept of all this when a run is to go on from a step another time. Requests
//! from other terminals come in through [`live`], which checks or refuses faults, changes, marks and
//! pauses, and wait in [`request_queue`]; `engine::requests` serves them. A change waits in [`tuning`],
//! which makes its event when it takes hold. `engine::handover` carries out what is to happen when a
//! controller is lost, and lets another take over. [`job`] is what is to be done, [`repeat`] a run in
//! real time once more, in lockstep.
//!
//! [`program`] is the process around it; a user's own plant binary is a `main` of one line that
//! calls [`program::run`]. Nothing here knows a control law.

mod checkpoint;
pub mod engine;
pub mod faults;
pub mod guard;
pub mod instruments;
pub mod integrate;
pub mod job;
pub mod live;
pub mod models;
pub mod plant;
pub mod program;
pub mod repeat;
pub mod request_queue;
pub mod rows;
pub mod stimulus;
pub mod tuning;
