//! Tests of datagrams on sockets of this machine.

use std::os::unix::net::UnixDatagram;

use super::*;

#[test]
fn a_frame_of_the_peer_is_found_behind_those_of_another_sender() {
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let other = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    let to = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
    let mut buffer = [0; 8];
    peer.send_to(b"first", to).expect("sent");
    let arrival = udp.receive(&mut buffer).expect("received");
    assert_eq!(arrival.map(|one| one.length), Some(5));
    for _ in 0..3 {
        other.send_to(b"other", to).expect("sent");
    }
    peer.send_to(b"next", to).expect("sent");
    let arrival = udp.receive(&mut buffer).expect("received");
    assert_eq!(arrival.map(|one| one.length), Some(4));
    assert_eq!(&buffer[..4], b"next");
    assert_eq!(udp.counts().strangers, 3);
}

#[test]
fn datagrams_arrive_after_many_that_reached_nobody() {
    let absent = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let to = absent.local_addr().expect("an address");
    drop(absent);
    let mut udp = Udp::open(Some(to), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    let mut buffer = [0; 512];
    for _ in 0..2000 {
        udp.send(None, &[0; 256]).expect("absence is no error");
        assert_eq!(udp.receive(&mut buffer).expect("no error"), None);
    }
    assert!(udp.has_reached_nobody(None, &[0; 256]));
    let peer = UdpSocket::bind(to).expect("a socket");
    let own = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
    for _ in 0..2 {
        peer.send_to(&[1; 256], own).expect("sent");
    }
    for _ in 0..2 {
        let arrival = udp.receive(&mut buffer).expect("received");
        assert_eq!(arrival.map(|one| one.length), Some(256));
    }
}

#[test]
fn a_datagram_that_reached_nobody_is_known_by_its_bytes() {
    let absent = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let to = absent.local_addr().expect("an address");
    drop(absent);
    let mut udp = Udp::open(Some(to), None).expect("a socket");
    assert!(udp.send(None, b"first").expect("not known yet"));
    let peer = UdpSocket::bind(to).expect("a socket");
    assert!(udp.send(None, b"second").expect("sent"));
    let mut buffer = [0; 8];
    assert_eq!(peer.recv(&mut buffer).expect("received"), 6);
    assert_eq!(udp.receive(&mut buffer).expect("nothing"), None);
    assert!(udp.has_reached_nobody(None, b"first"));
    assert!(!udp.has_reached_nobody(None, b"second"));
    assert_eq!(udp.counts().unsent, 1);
}

#[test]
fn the_path_of_a_socket_stays_if_another_program_has_bound_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shared");
    let own = Unix::open(&path, true).expect("bound");
    std::fs::remove_file(&path).expect("removed");
    let _other = UnixDatagram::bind(&path).expect("bound by another program");
    drop(own);
    assert!(path.exists());
}

#[test]
fn a_peer_is_the_same_under_another_path_of_its_socket() {
    let folder = tempfile::tempdir().expect("a folder");
    let [real, link] = ["real", "link"].map(|name| folder.path().join(name));
    std::fs::create_dir(&real).expect("a folder");
    std::os::unix::fs::symlink(&real, &link).expect("a link");
    let peer = UnixDatagram::bind(real.join("peer")).expect("bound");
    let mut own = Unix::open(&link.join("peer"), false).expect("bound");
    let other = UnixDatagram::bind(real.join("other")).expect("bound");
    own.send(None, b"sample").expect("sent");
    let mut buffer = [0; 8];
    let (_, from) = peer.recv_from(&mut buffer).expect("received");
    let path = from.as_pathname().expect("a path");
    other.send_to(b"stranger", path).expect("sent");
    peer.send_to(b"command", path).expect("sent");
    let arrival = own.receive(&mut buffer).expect("received");
    assert_eq!(arrival.map(|one| one.length), Some(7));
    assert_eq!(own.counts().strangers, 1);
    assert_eq!(own.first_other(), real.join("other").to_str());
}

#[test]
fn a_burst_of_other_frames_takes_no_room_from_the_answer_behind_it() {
    // The kernel's own buffer has room for 277 short datagrams.
    const BURST: usize = 500;
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    let own = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
    for _ in 0..BURST {
        peer.send_to(b"garbage", own).expect("sent");
    }
    peer.send_to(b"answer", own).expect("sent");
    let mut buffer = [0; 8];
    let mut lengths = Vec::new();
    while let Some(arrival) = udp.receive(&mut buffer).expect("received") {
        lengths.push(arrival.length);
    }
    assert_eq!((lengths.len(), lengths.last()), (BURST + 1, Some(&6)));
    assert_eq!(udp.counts().dropped, 0);
}

#[test]
fn datagrams_that_the_kernel_drops_are_counted() {
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    let own = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
    const COUNT: u64 = 10_000;
    for _ in 0..COUNT {
        peer.send_to(b"garbage", own).expect("sent");
    }
    let mut buffer = [0; 8];
    let mut read = 0;
    while udp.receive(&mut buffer).expect("received").is_some() {
        read += 1;
    }
    peer.send_to(b"one more", own).expect("sent");
    assert!(udp.receive(&mut buffer).expect("received").is_some());
    assert!(read < COUNT);
    assert_eq!(udp.counts().dropped, COUNT - read);
}

#[test]
fn the_kernel_drops_the_flood_of_another_sender_once_the_peer_has_spoken() {
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let other = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    let own = SocketAddr::from((Ipv4Addr::LOCALHOST, own));
    let mut buffer = [0; 8];
    let mut receive = |udp: &mut Udp| udp.receive(&mut buffer).expect("no error").is_some();
    peer.send_to(b"first", own).expect("sent");
    assert!(receive(&mut udp));
    for _ in 0..FLOOD {
        // Once the kernel drops its frames, the other sender learns of it.
        let _ = other.send_to(b"other", own);
        assert!(!receive(&mut udp));
    }
    assert_eq!(udp.counts().strangers, FLOOD);
    let address = other.local_addr().expect("an address").to_string();
    assert_eq!(udp.first_other(), Some(&*address));
    let [note] = udp.take_notes().try_into().expect("one note");
    assert_eq!(
        (note.kind, &*note.bytes),
        (NoteKind::OtherSender, &b"other"[..])
    );
    for _ in 0..3 {
        let _ = other.send_to(b"other", own);
    }
    peer.send_to(b"next", own).expect("sent");
    assert!(receive(&mut udp));
    assert!(!receive(&mut udp));
    assert_eq!(udp.counts().strangers, FLOOD);
    udp.send(None, b"sample").expect("sent");
    let mut sample = [0; 8];
    assert_eq!(peer.recv(&mut sample).expect("a sample"), 6);
}

#[test]
fn a_datagram_longer_than_the_buffer_has_its_real_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut buffer = [0; LONGEST + 1];
    let peer = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let mut udp = Udp::open(peer.local_addr().ok(), None).expect("a socket");
    let own = udp.socket.local_addr().expect("an address").port();
    (peer.send_to(&[7; 60_000], (Ipv4Addr::LOCALHOST, own))).expect("sent");
    let arrival = udp
        .receive(&mut buffer)
        .expect("received")
        .expect("a frame");
    assert_eq!((arrival.length, arrival.size), (LONGEST + 1, 60_000));
    let path = folder.path().join("own");
    let mut unix = Unix::open(&path, true).expect("a socket");
    let peer = UnixDatagram::unbound().expect("a socket");
    peer.send_to(&[7; 60_000], &path).expect("sent");
    let arrival = unix
        .receive(&mut buffer)
        .expect("received")
        .expect("a frame");
    assert_eq!((arrival.length, arrival.size), (LONGEST + 1, 60_000));
}
