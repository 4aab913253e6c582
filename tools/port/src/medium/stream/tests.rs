//! Tests of streams on sockets of this machine.

use std::io::Write;

use super::*;

#[test]
fn frames_are_found_behind_garbage_and_across_reads() {
    let cut = Cut::Lengths(vec![(4, vec![0x55, 0xAA])]);
    assert_eq!(cut.find(&[]), (0, None));
    assert_eq!(cut.find(&[1, 2, 3]), (3, None));
    assert_eq!(cut.find(&[1, 0x55]), (1, None));
    assert_eq!(cut.find(&[0x55, 1, 0x55, 0xAA, 1]), (2, None));
    assert_eq!(cut.find(&[9, 0x55, 0xAA, 1, 2, 3]), (1, Some(4)));
    assert_eq!(Cut::Line.find(b"{}\n{"), (0, Some(3)));
    assert_eq!(Cut::Line.find(&[b'x'; LONGEST + 1]), (0, None));
}

/// Stream whose peer has written these bytes.
fn arrived(bytes: &[u8], cut: Cut) -> (UnixStream, Stream) {
    let (mut peer, own) = UnixStream::pair().expect("a pair");
    own.set_nonblocking(true).expect("a socket");
    peer.write_all(bytes).expect("written");
    (peer, Stream::new(Source::Line, Some(End::Unix(own)), cut))
}

#[test]
fn the_end_of_a_line_that_is_too_long_is_no_frame() {
    let text = [&[b'x'; 3 * LONGEST][..], b"{\"f\": 77}\n{\"f\": 1}\n"].concat();
    let (_peer, mut stream) = arrived(&text, Cut::Line);
    let mut buffer = [0; LONGEST + 1];
    let arrival = stream
        .receive(&mut buffer)
        .expect("received")
        .expect("a line");
    assert_eq!(&buffer[..arrival.length], b"{\"f\": 1}");
    assert_eq!(stream.receive(&mut buffer).expect("nothing more"), None);
    assert_eq!(stream.counts().skipped_bytes, 3 * LONGEST as u64 + 10);
    let [note] = stream.take_notes().try_into().expect("one note");
    assert_eq!(note.text, "a line of more than 4096 bytes");
    assert!(note.bytes.iter().all(|byte| *byte == b'x'));
}

#[test]
fn a_false_beginning_is_given_back_except_its_first_byte() {
    let cut = Cut::Lengths(vec![(3, vec![0xAA])]);
    let (_peer, mut stream) = arrived(&[0xAA, 1, 0xAA, 2, 3], cut);
    let mut buffer = [0; LONGEST + 1];
    let mut receive = |stream: &mut Stream| {
        let arrival = stream.receive(&mut buffer).expect("received");
        arrival.map(|one| buffer[..one.length].to_vec())
    };
    assert_eq!(receive(&mut stream), Some(vec![0xAA, 1, 0xAA]));
    stream.reject();
    assert_eq!(receive(&mut stream), Some(vec![0xAA, 2, 3]));
    assert_eq!(stream.counts().skipped_bytes, 2);
}

#[test]
fn skipped_bytes_are_described_by_the_constant_that_they_lack() {
    let cut = Cut::Lengths(vec![(4, vec![0x55, 0xAA])]);
    let lacking = "bytes that do not begin with 55 aa";
    assert_eq!(cut.describe(&[1, 2, 3]), lacking);
    let reversed = format!("{lacking}, but have it in the other byte order");
    assert_eq!(cut.describe(&[1, 0xAA, 0x55]), reversed);
    let any = "bytes that no frame begins with";
    assert_eq!(Cut::Lengths(Vec::new()).describe(&[1]), any);
}

#[test]
fn a_client_does_not_wait_for_a_listener_with_a_full_queue() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("full");
    let listener = UnixListener::bind(&path).expect("a listener");
    rustix::net::listen(&listener, 0).expect("a short queue");
    // One client fits a queue of length 0, and nobody accepts it.
    let _first = UnixStream::connect(&path).expect("connected");
    let mut stream = Stream::unix(path, Cut::Line);
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || sender.send(stream.send(None, b"1\n").map_err(|e| e.kind())));
    // A client that waits does so for ever.
    let watchdog = Duration::from_secs(60);
    assert_eq!(receiver.recv_timeout(watchdog), Ok(Ok(false)));
}

#[test]
fn the_path_of_a_listener_stays_if_another_program_has_bound_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shared");
    let own = Stream::unix_listener(&path, Cut::Line).expect("bound");
    std::fs::remove_file(&path).expect("removed");
    let _other = UnixListener::bind(&path).expect("bound by another program");
    drop(own);
    assert!(path.exists());
}

#[test]
fn a_client_goes_on_while_its_connection_is_awaited() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a listener");
    rustix::net::listen(&listener, 0).expect("a short queue");
    let to = listener.local_addr().expect("an address");
    // One client fits a queue of length 0; the kernel does not answer another one.
    let _first = TcpStream::connect(to).expect("connected");
    let mut stream = Stream::tcp(to, Cut::Line);
    for _ in 0..3 {
        assert!(!stream.send(None, b"1\n").expect("nobody yet"));
        assert!(stream.attempt.is_some(), "the attempt has ended");
    }
    listener.set_nonblocking(true).expect("a listener");
    let mut accepted = Vec::new();
    let begin = Instant::now();
    while !stream.send(None, b"2\n").expect("no error") {
        accepted.extend(listener.accept());
        std::thread::sleep(Duration::from_millis(5));
        assert!(begin.elapsed() < Duration::from_secs(60), "watchdog");
    }
}

#[test]
fn a_second_client_is_named_and_served_once_the_first_is_gone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("own");
    let mut stream = Stream::unix_listener(&path, Cut::Line).expect("a listener");
    let mut first = UnixStream::connect(&path).expect("connected");
    first.write_all(b"1\n").expect("written");
    let mut buffer = [0; LONGEST + 1];
    let mut read = |stream: &mut Stream| {
        let arrival = stream.receive(&mut buffer).expect("received");
        arrival.map(|one| buffer[..one.length].to_vec())
    };
    assert_eq!(read(&mut stream), Some(b"1".to_vec()));
    let mut second = UnixStream::connect(&path).expect("connected");
    second.write_all(b"2\n").expect("written");
    while stream.counts().strangers == 0 {
        assert_eq!(read(&mut stream), None);
    }
    let own = format!("process {}", std::process::id());
    assert_eq!(stream.first_other(), Some(&*own));
    let [note] = stream.take_notes().try_into().expect("one note");
    assert!(note.text.starts_with(&own), "{}", note.text);
    first.write_all(b"3\n").expect("written");
    assert_eq!(read(&mut stream), Some(b"3".to_vec()));
    drop(first);
    assert_eq!(read(&mut stream), None);
    assert_eq!(read(&mut stream), Some(b"2".to_vec()));
    let counts = stream.counts();
    assert_eq!((counts.strangers, counts.new_peers), (1, 1));
}

#[test]
fn a_frame_is_lost_with_the_connection_on_which_it_was_sent() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("own");
    let mut stream = Stream::unix_listener(&path, Cut::Line).expect("a listener");
    let first = UnixStream::connect(&path).expect("connected");
    assert!(stream.send(None, b"1\n").expect("sent"));
    assert!(!stream.has_reached_nobody(None, b"1\n"));
    drop(first);
    let _second = UnixStream::connect(&path).expect("connected");
    let mut buffer = [0; LONGEST + 1];
    // One call sees the end of the first, and one the second.
    for _ in 0..2 {
        assert_eq!(stream.receive(&mut buffer).expect("no error"), None);
    }
    assert!(stream.has_reached_nobody(None, b"1\n"));
    assert!(stream.send(None, b"1\n").expect("sent"));
    assert!(!stream.has_reached_nobody(None, b"1\n"));
}
