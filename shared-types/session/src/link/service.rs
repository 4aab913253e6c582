//! Services of iceoryx2 in a session: the node of a process, subscribers that cannot be cut off, and named failures.
//!
//! Common base of the link, the bells and the record stream, all of which it does not know.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::{DegradationAction, ReceiveError};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::subscriber::PortFactorySubscriber;
use shared_types::link::LinkError;

use crate::session::SessionInfo;
use crate::shared_memory;

/// The iceoryx2 service flavour in use.
pub type Ipc = ipc::Service;

/// Creates the iceoryx2 node of one process in a session.
///
/// # Errors
/// If the session's shared memory cannot be used.
pub fn node(session: &SessionInfo, name: &str) -> Result<Node<Ipc>, LinkError> {
    let service = "shared memory".into();
    let node = session.node(name);
    node.map_err(|reason| LinkError::Transport { service, reason })
}

/// Wraps an error of iceoryx2 and its probable cause, which iceoryx2 does not name.
pub fn transport(service: &str, error: impl std::fmt::Debug) -> LinkError {
    LinkError::Transport {
        service: service.into(),
        reason: shared_memory::refused(error),
    }
}

/// Classifies a failure to open a service: it may not exist yet, or the machine may prevent it.
pub(crate) fn absent(service: &str, error: PublishSubscribeOpenError) -> LinkError {
    use PublishSubscribeOpenError as Open;
    let may_be_refused = matches!(
        error,
        Open::InternalFailure | Open::InsufficientPermissions | Open::UnableToCreateServiceTag
    );
    if may_be_refused && shared_memory::hindrance().is_some() {
        return transport(service, error);
    }
    LinkError::Absent {
        service: service.into(),
        reason: match error {
            Open::DoesNotExist => "the plant has not created the service".into(),
            other => format!("iceoryx2 reports {other:?}"),
        },
    }
}

/// Creates a subscriber that fails if it cannot reach a publisher. By default, iceoryx2 continues without that
/// publisher's messages.
pub(crate) fn subscribe<Payload, Header>(
    service: &str,
    builder: PortFactorySubscriber<'_, Ipc, Payload, Header>,
) -> Result<Subscriber<Ipc, Payload, Header>, LinkError>
where
    Payload: std::fmt::Debug + IceoryxSend + ?Sized,
    Header: std::fmt::Debug + ZeroCopySend,
{
    let is_cut_off = Arc::new(AtomicBool::new(false));
    let flag = is_cut_off.clone();
    let subscriber = builder.set_degradation_handler(move |_, _| {
        flag.store(true, Ordering::Relaxed);
        DegradationAction::DegradeAndFail
    });
    let subscriber = subscriber.create().map_err(|error| match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => LinkError::Taken {
            service: service.into(),
            role: "observers",
        },
        error => transport(service, error),
    })?;
    // A publisher that existed before this subscriber sets the flag without an error.
    if is_cut_off.load(Ordering::Relaxed) {
        let what = "the service's publisher cannot be reached";
        return Err(match shared_memory::hindrance() {
            Some(_) => transport(service, format_args!("{what}")),
            None => LinkError::Absent {
                service: service.into(),
                reason: what.into(),
            },
        });
    }
    Ok(subscriber)
}

/// Returns the received message; `None` if the publisher is gone.
pub(crate) fn received<T>(
    service: &str,
    received: Result<Option<T>, ReceiveError>,
) -> Result<Option<T>, LinkError> {
    // The error variants have no public names.
    let is_gone = |error: &ReceiveError| format!("{error:?}").contains("DoesNotExist");
    match received {
        Ok(received) => Ok(received),
        Err(error) if is_gone(&error) => Ok(None),
        Err(error) => Err(transport(service, error)),
    }
}
