//! Attachment of the recorder to the record stream of a session: requires files closed to other users, and the layout
//! that both programs described.

use std::time::Duration;

use hil_facts::session::observer;
use hil_session::session::SessionInfo;
use hil_session::stream::{IceoryxSource, LAYOUT_FILE};
use shared_types::link::LinkError;
use shared_types::record::RecordLayout;

/// Number of attempts to close session files to other users before the run is refused.
const LOOKS: u32 = 20;

/// Attaches the recorder: first to the stream; then checks that the layout that the plant writes after hello equals the
/// described one.
pub(super) fn attach(
    session: &SessionInfo,
    described: &RecordLayout,
    source: &mut Option<IceoryxSource>,
) -> Result<Option<(IceoryxSource, RecordLayout)>, String> {
    if source.is_none() {
        match IceoryxSource::open(session, true) {
            Ok(opened) => {
                session.tighten();
                *source = Some(opened);
            }
            Err(LinkError::Absent { .. }) => return Ok(None),
            Err(error) => return Err(cannot_attach(&error)),
        }
    }
    if !session.folder.join(LAYOUT_FILE).exists() {
        return Ok(None);
    }
    refuse_open(session).map_err(|open| cannot_attach(&open))?;
    let layout_at_hello: RecordLayout =
        (session.read_file(LAYOUT_FILE)).map_err(|e| cannot_attach(&e))?;
    refuse_other_layout(described, &layout_at_hello)?;
    observer::admit(session, described).map_err(|e| cannot_attach(&e))?;
    Ok(source.take().map(|source| (source, described.clone())))
}

/// Closes files that are open to other users, and refuses those that cannot be closed. A file that is being created may
/// be open between two attempts.
fn refuse_open(session: &SessionInfo) -> Result<(), String> {
    for _ in 0..LOOKS {
        session.tighten();
        if session.open_to_others().is_empty() {
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let open = session.open_to_others();
    (open.first()).map_or(Ok(()), |open| {
        Err(format!("{} is open to other users", open.display()))
    })
}

fn cannot_attach(error: &dyn std::fmt::Display) -> String {
    format!("cannot attach to the record stream: {error}")
}

/// Refuses a layout that differs from the descriptions of both programs.
pub(super) fn refuse_other_layout(
    described: &RecordLayout,
    layout_at_hello: &RecordLayout,
) -> Result<(), String> {
    described
        .difference(layout_at_hello)
        .map_or(Ok(()), |difference| {
            Err(format!(
                "plant and controller agreed on a different layout at hello: {difference}"
            ))
        })
}
