//! Attachment of the recorder to the record stream of a session: files closed to other users, and the
//! layout that both programs described, or no run.

use std::time::Duration;

use hil_facts::session::observer;
use hil_session::session::SessionInfo;
use hil_session::stream::{IceoryxSource, LAYOUT_FILE};
use shared_types::link::LinkError;
use shared_types::record::RecordLayout;

/// Number of times that files of a session which are open to others are closed before a run is refused
/// for them.
const LOOKS: u32 = 20;

/// Attaches the recorder: first the stream, then the layout that the plant writes after hello. That must
/// be the one that was described.
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
    let said: RecordLayout = (session.read_file(LAYOUT_FILE)).map_err(|e| cannot_attach(&e))?;
    refuse_other_layout(described, &said)?;
    observer::admit(session, described).map_err(|e| cannot_attach(&e))?;
    Ok(source.take().map(|source| (source, described.clone())))
}

/// Closes what is open to other users, and refuses what stays so. What a side makes just now may be open
/// between two looks.
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

/// Refuses records with other signals than both binaries described.
pub(super) fn refuse_other_layout(
    described: &RecordLayout,
    said: &RecordLayout,
) -> Result<(), String> {
    described.difference(said).map_or(Ok(()), |difference| {
        Err(format!(
            "at hello plant and controller agreed on {difference}"
        ))
    })
}
