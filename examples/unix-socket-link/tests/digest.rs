//! A run has the same digest over every link.

use std::path::Path;

use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::Session;
use unix_socket_link::link::UnixSocketLink;
use unix_socket_link::run::run;

#[test]
fn a_run_over_sockets_has_the_digest_of_shared_memory() {
    let scenario = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/spring-mass.toml");
    let folder = tempfile::tempdir().expect("a folder");
    let plant = UnixSocketLink::create(folder.path()).expect("a link");
    let place = folder.path().to_owned();
    let over_sockets = run(&scenario, 7, plant, move || UnixSocketLink::open(&place, 1));

    let mut session = Session::create(None).expect("a session");
    (session.add_controller(1, std::process::id())).expect("noted");
    let info = session.info().clone();
    let plant = IceoryxLink::create(&info).expect("a link");
    let over_memory = run(&scenario, info.id, plant, move || {
        IceoryxLink::open(&info, 1)
    });
    assert_eq!(over_sockets.expect("a run"), over_memory.expect("a run"));
}
