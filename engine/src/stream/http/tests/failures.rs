//! Servers that fail, are silent, or lie; and requests that are given up.

use super::*;

#[test]
fn failures_that_pass_are_survived_and_all_bytes_counted() {
    let unavailable = with_status("503 Service Unavailable", r#"{"error":"busy","detail":"later"}"#);
    let broken_off = Reply::Raw(b"HTTP/1.1 200 OK\r\ncontent-length: 100\r\n\r\nhalf".to_vec());
    for trouble in [unavailable, broken_off, Reply::HangUp] {
        let server =
            Scripted::with_manifest(100, [(COLUMN, vec![trouble.clone(), trouble, ok("the column")])]);
        let answer = fetch_one(&mut server.source());
        assert_eq!(answer.bytes.unwrap(), "the column");
        assert_eq!(server.asked(COLUMN), 3);
        assert_eq!(answer.wire_bytes, server.sent.load(Ordering::SeqCst));
    }
}

#[test]
fn failures_that_stay_are_reported() {
    let server = Scripted::with_manifest(
        100,
        [(
            COLUMN,
            vec![with_status(
                "500 Internal Server Error",
                r#"{"error":"corrupt","detail":"it does not hold"}"#,
            )],
        )],
    );
    let said = error(&mut server.source());
    assert!(
        said.contains(COLUMN) && said.contains("it does not hold") && said.contains("4 attempts"),
        "{said}"
    );
    assert_eq!(server.asked(COLUMN), 4);

    for status in ["400 Bad Request", "301 Moved Permanently", "401 Unauthorized"] {
        let server = Scripted::with_manifest(100, [(COLUMN, vec![with_status(status, "")])]);
        let said = error(&mut server.source());
        assert!(said.contains(&status[..3]), "{said}");
        assert_eq!(server.asked(COLUMN), 1, "no use to ask again");
    }
}

#[test]
fn a_server_that_is_not_there_is_named_with_what_to_do() {
    let url = {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        format!("http://{}", listener.local_addr().unwrap())
    };
    let said = error(&mut retried(
        HttpSource::new(&url, &HttpOptions::default()).unwrap(),
    ));
    for part in [&*url, "refused", "eigentile serve", "--tiles"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

#[test]
fn answers_are_bounded() {
    let server = Scripted::with_manifest(10, [(COLUMN, vec![ok("eleven byte")])]);
    let said = error(&mut server.source());
    assert!(said.contains("10 bytes"), "{said}");
    // An announcement is not believed: nothing is allocated for it.
    let lie = format!("HTTP/1.1 200 OK\r\ncontent-length: {}\r\n\r\n", u64::MAX / 4);
    let server = Scripted::with_manifest(u64::MAX, [(COLUMN, vec![Reply::Raw(lie.into_bytes())])]);
    error(&mut server.source());
    let manifest = "x".repeat(5 << 20);
    let said = error(&mut Scripted::start([("/v1/a", vec![ok(manifest)])]).source());
    assert!(said.contains("longer"), "{said}");
}

#[test]
fn what_is_no_tile_server_is_recognized() {
    for body in [
        "<html>hello</html>",
        "{}",
        r#"{"id":7}"#,
        &manifest("../../etc", 10),
        &manifest("0", 10),
        "",
    ] {
        let server = Scripted::start([("/v1/a", vec![ok(body)])]);
        let said = error(&mut server.source());
        assert!(
            said.contains("/v1/a") && (said.contains("manifest") || said.contains("content id")),
            "{body}: {said}"
        );
    }
    let server = Scripted::start([("/v1/a", vec![Reply::Raw(b"SSH-2.0-OpenSSH\r\n\r\n".to_vec())])]);
    assert!(error(&mut server.source()).contains("connection"));
}

#[test]
fn silence_ends() {
    let (hung_up, _keep) = mpsc::channel();
    let server = Scripted::with_manifest(10, [(COLUMN, vec![Reply::Silence(hung_up)])]);
    let options = HttpOptions {
        silence: Duration::from_millis(50),
        ..HttpOptions::default()
    };
    let said = error(&mut HttpSource::new(&server.url, &options).unwrap());
    assert!(said.contains("no answer for 0.05 s"), "{said}");
}

#[test]
fn cancelling_ends_the_request() {
    let (hung_up, ended) = mpsc::channel();
    let server = Scripted::with_manifest(10, [(COLUMN, vec![Reply::Silence(hung_up)])]);
    let mut source = server.source();
    let ticket = source.submit(column(0)).unwrap();
    let begin = Instant::now();
    while server.asked(COLUMN) == 0 {
        assert!(begin.elapsed() < Duration::from_secs(20));
        source.wait(Duration::from_millis(1));
    }
    source.cancel(ticket);
    ended
        .recv_timeout(Duration::from_secs(10))
        .expect("the connection is closed, not waited for");
    assert_eq!((source.in_flight(), source.stats().cancelled), (0, 1));
}

#[test]
fn retry_after_is_honoured() {
    let busy = Reply::Raw(
        b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-length: 0\r\n\r\n".to_vec(),
    );
    let server = Scripted::with_manifest(100, [(COLUMN, vec![busy, ok("the column")])]);
    let begin = Instant::now();
    assert_eq!(fetch_one(&mut server.source()).bytes.unwrap(), "the column");
    assert!(begin.elapsed() >= Duration::from_secs(1), "{:?}", begin.elapsed());
}

#[test]
fn what_never_crossed_the_wire_is_counted() {
    let (hung_up, _keep) = mpsc::channel();
    let bytes = archive(1);
    let archive = tileset::Archive::open(bytes).unwrap();
    let replies = [
        ("/v1/a/index", vec![an_index(archive.prefix().unwrap())]),
        (COLUMN, vec![Reply::Silence(hung_up)]),
    ];
    let server = Scripted::with_manifest(1 << 20, replies);
    let mut source = server.source();
    fetch(&mut source, &[Request::Index { archive: "a".into() }]);
    let ticket = source.submit(column(0)).unwrap();
    while server.asked(COLUMN) == 0 {
        source.wait(Duration::from_millis(1));
    }
    source.cancel(ticket);
    let length = archive.index.column(0).unwrap().length;
    assert_eq!(source.stats().cancelled_bytes_saved, u64::from(length));
}
