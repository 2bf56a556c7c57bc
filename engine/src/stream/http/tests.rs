//! A server that does as it is told, for what a tile server does not do: fail, break off, send too much, lie.

use std::{
    collections::HashMap,
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
        mpsc,
    },
    time::{Duration, Instant},
};

use super::{
    super::{
        RetriedSource, RetryOptions,
        conformance::{Fixture, Served, archive, drain, fetch},
    },
    *,
};

/// What a scripted server does with one request.
#[derive(Clone)]
enum Reply {
    /// Sends these bytes as they stand.
    Raw(Vec<u8>),
    /// Closes the connection without a word.
    HangUp,
    /// Says nothing until the client hangs up, and reports that.
    Silence(mpsc::Sender<()>),
}

fn ok(body: impl AsRef<[u8]>) -> Reply {
    with_status("200 OK", body)
}

fn with_status(status: &str, body: impl AsRef<[u8]>) -> Reply {
    let length = body.as_ref().len();
    let head =
        format!("HTTP/1.1 {status}\r\ncontent-length: {length}\r\ncontent-type: application/json\r\n\r\n");
    Reply::Raw([head.as_bytes(), body.as_ref()].concat())
}

/// Answers by path; the last reply of a path is repeated.
struct Scripted {
    url: String,
    script: Arc<Mutex<HashMap<String, Vec<Reply>>>>,
    sent: Arc<AtomicU64>,
    connections: Arc<AtomicU64>,
    asked: Arc<Mutex<Vec<String>>>,
}

fn retried(source: HttpSource) -> RetriedSource<HttpSource> {
    let options = RetryOptions {
        backoff: Duration::from_millis(1),
        ..RetryOptions::default()
    };
    RetriedSource::new(source, options)
}

const ID: &str = "0123456789abcdef0123456789abcdef";

impl Scripted {
    fn start(script: impl IntoIterator<Item = (&'static str, Vec<Reply>)>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let scripted = Self {
            url: format!("http://{}", listener.local_addr().unwrap()),
            script: Arc::new(Mutex::new(
                script
                    .into_iter()
                    .map(|(path, replies)| (path.into(), replies))
                    .collect(),
            )),
            sent: Arc::default(),
            connections: Arc::default(),
            asked: Arc::default(),
        };
        let (script, sent, asked) = (
            scripted.script.clone(),
            scripted.sent.clone(),
            scripted.asked.clone(),
        );
        let connections = scripted.connections.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                connections.fetch_add(1, Ordering::SeqCst);
                let (script, sent, asked) = (script.clone(), sent.clone(), asked.clone());
                std::thread::spawn(move || converse(stream.unwrap(), &script, &sent, &asked));
            }
        });
        scripted
    }

    /// A server with an archive "a", whose manifest is honest about these sizes.
    fn with_manifest(largest: u64, others: impl IntoIterator<Item = (&'static str, Vec<Reply>)>) -> Self {
        let manifest = [("/v1/a", vec![ok(manifest(ID, largest))])];
        Self::start(manifest.into_iter().chain(others))
    }

    fn source(&self) -> RetriedSource<HttpSource> {
        retried(HttpSource::new(&self.url, HttpOptions::default()).unwrap())
    }

    fn asked(&self, path: &str) -> usize {
        self.asked
            .lock()
            .unwrap()
            .iter()
            .filter(|asked| *asked == path)
            .count()
    }
}

fn manifest(id: &str, largest: u64) -> String {
    format!(
        "{{\"id\":\"{id}\",\"index_bytes\":{largest},\"largest_page_bytes\":{largest},\"largest_column_bytes\":{largest}}}"
    )
}

fn converse(
    mut stream: TcpStream,
    script: &Mutex<HashMap<String, Vec<Reply>>>,
    sent: &AtomicU64,
    asked: &Mutex<Vec<String>>,
) {
    loop {
        let mut head = Vec::new();
        let mut byte = [0];
        while !head.ends_with(b"\r\n\r\n") {
            match stream.read(&mut byte) {
                Ok(1) => head.push(byte[0]),
                _ => return,
            }
        }
        let head = String::from_utf8(head).unwrap();
        let path = head.split(' ').nth(1).unwrap().to_owned();
        asked.lock().unwrap().push(path.clone());
        let reply = match script.lock().unwrap().get_mut(&path) {
            Some(replies) if replies.len() > 1 => replies.remove(0),
            Some(replies) => replies[0].clone(),
            None => with_status(
                "404 Not Found",
                r#"{"error":"not-found","detail":"the script has no such path"}"#,
            ),
        };
        match reply {
            Reply::Raw(bytes) => {
                // Counted first: the client may have it all before this goes on.
                sent.fetch_add(bytes.len() as u64, Ordering::SeqCst);
                let length = bytes.windows(4).position(|end| end == b"\r\n\r\n").unwrap() + 4;
                let announced = String::from_utf8_lossy(&bytes[..length]).to_lowercase();
                let complete = announced.contains(&format!("content-length: {}\r\n", bytes.len() - length));
                if stream.write_all(&bytes).is_err() || !complete {
                    return;
                }
            }
            Reply::HangUp => return,
            Reply::Silence(hung_up) => {
                let _ = stream.read(&mut byte);
                let _ = hung_up.send(());
                return;
            }
        }
    }
}

fn column(group: u16) -> Request {
    Request::Column {
        archive: "a".into(),
        group,
    }
}

const COLUMN: &str = "/v1/a/0123456789abcdef0123456789abcdef/column/0";

#[track_caller]
fn fetch_one(source: &mut dyn TileSource) -> Answer {
    fetch(source, &[column(0)]).remove(0)
}

#[track_caller]
fn error(source: &mut dyn TileSource) -> String {
    fetch_one(source).bytes.expect_err("an error").to_string()
}

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
        HttpSource::new(&url, HttpOptions::default()).unwrap(),
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
    let said = error(&mut HttpSource::new(&server.url, options).unwrap());
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
    let path: &'static str = format!("/v1/a/{ID}/index").leak();
    let replies = [
        (path, vec![ok(archive.prefix().unwrap())]),
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

/// A frame of a batch: a column with these bytes, or another status.
fn frame(group: u8, status: u16, bytes: &[u8]) -> Vec<u8> {
    let status = status.to_le_bytes();
    let head = [0, 0, group, 0, 0, 0, 0, 0, status[0], status[1], 0, 0];
    [&head[..], &(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

/// A server that says that it does batches, and this answer to one of columns 0 to 3.
fn with_batches(replies: Vec<Reply>) -> Scripted {
    let mut manifest = manifest(ID, 100);
    manifest.insert_str(manifest.len() - 1, r#","urls":{"batch":"a/ID/batch/{records}"}"#);
    let batch: &'static str = format!("/v1/a/{ID}/batch/c0,c1,c2,c3").leak();
    let rest: &'static str = format!("/v1/a/{ID}/batch/c2,c3").leak();
    let mut index = vec![0; 10];
    index[0] = 1;
    Scripted::start([
        ("/v1/a", vec![ok(manifest)]),
        (&*format!("/v1/a/{ID}/index").leak(), vec![ok(index)]),
        (batch, replies),
        (
            rest,
            vec![ok([frame(2, 200, b"two"), frame(3, 200, b"three")].concat())],
        ),
        (&*format!("/v1/a/{ID}/column/2").leak(), vec![ok("two")]),
        (&*format!("/v1/a/{ID}/column/3").leak(), vec![ok("three")]),
    ])
}

#[test]
fn records_of_one_go_come_in_one_answer() {
    let whole = [
        frame(0, 200, b"zero"),
        frame(1, 200, b""),
        frame(2, 200, b"two"),
        frame(3, 200, b"three"),
    ]
    .concat();
    let cut = Reply::Raw(
        [
            &b"HTTP/1.1 200 OK\r\ncontent-length: 1000\r\n\r\n"[..],
            &whole[..16 + 4 + 16 + 5],
        ]
        .concat(),
    );
    // Whole; and broken off in the third record, where only the rest is asked for again.
    for (reply, exchanges) in [(ok(&whole), 3..=3), (cut, 4..=5)] {
        let server = with_batches(vec![reply]);
        let mut bare = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
        fetch(&mut bare, &[Request::Index { archive: "a".into() }]);
        let mut source = retried(bare);
        let requests: Vec<Request> = (0..4).map(column).collect();
        let mut answers = fetch(&mut source, &requests);
        answers.sort_by_key(|answer| answer.ticket);
        let bytes: Vec<_> = answers
            .iter()
            .map(|answer| answer.bytes.as_ref().unwrap())
            .collect();
        assert_eq!(bytes, ["zero", "", "two", "three"]);
        let stats = source.stats();
        assert!(exchanges.contains(&stats.exchanges), "{stats:?}");
        assert_eq!(stats.wire_bytes, server.sent.load(Ordering::SeqCst));
    }
}

#[test]
fn what_a_batch_does_not_have_is_asked_for_alone() {
    let frames = [
        frame(0, 200, b"zero"),
        frame(1, 404, b"{}"),
        frame(2, 500, b"{}"),
        frame(3, 200, b"three"),
    ]
    .concat();
    for (reply, kinds) in [
        (ok(frames), ["Ok", "NotFound", "Unavailable", "Ok"]),
        (
            with_status("404 Not Found", ""),
            ["NotFound", "NotFound", "Ok", "Ok"],
        ),
        (ok(frame(1, 200, b"one")), ["Source"; 4]),
        (ok("short"), ["Unavailable"; 4]),
        (with_status("503 Busy", ""), ["Unavailable"; 4]),
    ] {
        let server = with_batches(vec![reply]);
        let mut source = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
        fetch(&mut source, &[Request::Index { archive: "a".into() }]);
        let requests: Vec<Request> = (0..4).map(column).collect();
        let mut answers = fetch(&mut source, &requests);
        answers.sort_by_key(|answer| answer.ticket);
        for (answer, kind) in answers.iter().zip(kinds) {
            let is = format!("{:?}", answer.bytes);
            assert!(
                is.starts_with(kind) || is.starts_with(&format!("Err({kind}")),
                "{is}, {kind}"
            );
        }
    }
}

#[test]
fn many_requests_share_manifest_and_connections() {
    let paths: Vec<&'static str> = (0..200)
        .map(|group| &*format!("/v1/a/{ID}/column/{group}").leak())
        .collect();
    let server = Scripted::with_manifest(10, paths.iter().map(|path| (*path, vec![ok("x")])));
    let mut source = server.source();
    let requests: Vec<Request> = (0..200).map(column).collect();
    assert!(
        fetch(&mut source, &requests)
            .iter()
            .all(|answer| answer.bytes.is_ok())
    );
    assert_eq!(server.asked("/v1/a"), 1);
    let connections = server.connections.load(Ordering::SeqCst);
    assert!(
        connections <= source.capacity() as u64 + 1,
        "{connections} connections for 201 requests"
    );
}

#[test]
fn a_real_server_is_asked_in_batches() {
    let (fixture, requests) = (Fixture::get(), Fixture::get().requests());
    let folder = fixture.folder();
    let server = Served::start(folder.path());
    let mut source = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
    let (indices, records): (Vec<_>, Vec<_>) = requests
        .into_iter()
        .partition(|request| matches!(request, Request::Index { .. }));
    fetch(&mut source, &indices);
    let before = source.stats();
    let answers = fetch(&mut source, &records);
    assert_eq!(answers.len(), records.len());
    for answer in answers {
        assert_eq!(
            answer.bytes.unwrap(),
            fixture.expected(&answer.request),
            "{}",
            answer.request
        );
    }
    let stats = source.stats();
    let exchanges = stats.exchanges - before.exchanges;
    assert!(
        exchanges * 4 <= records.len() as u64,
        "{exchanges} exchanges for {} records",
        records.len()
    );
    // Longer than any batch, and with records that there are not.
    let missing = |group| Request::Column {
        archive: Arc::clone(records[0].archive()),
        group,
    };
    let long: Vec<_> = (0..40)
        .map(|at| {
            if at % 8 == 7 {
                missing(1000 + at)
            } else {
                records[at as usize % records.len()].clone()
            }
        })
        .collect();
    for answer in fetch(&mut source, &long) {
        let there = !matches!(answer.request, Request::Column { group: 1000.., .. });
        match answer.bytes {
            Ok(bytes) => assert_eq!(bytes, fixture.expected(&answer.request)),
            Err(error) => assert!(!there && matches!(error, Error::NotFound(_)), "{error}"),
        }
    }
}

#[test]
fn a_replaced_archive_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bsvtf");
    std::fs::write(&path, archive(1)).unwrap();
    let server = Served::start(folder.path());
    let mut source = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
    let index = Request::Index { archive: "a".into() };
    let old = fetch(&mut source, &[index.clone(), column(0)]);
    assert!(old.iter().all(|answer| answer.bytes.is_ok()));

    let new = folder.path().join("new");
    std::fs::write(&new, archive(2)).unwrap();
    std::fs::rename(&new, &path).unwrap();
    // The server goes on with the old archive until somebody asks for the manifest.
    assert!(fetch_one(&mut source).bytes.is_ok());
    let mut other = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
    assert!(fetch_one(&mut other).bytes.is_ok());
    for _ in 0..2 {
        let said = error(&mut source);
        assert!(said.contains("changed on the server"), "{said}");
    }
    let answers = fetch(&mut source, &[index]);
    assert_ne!(answers[0].bytes.as_ref().unwrap(), old[0].bytes.as_ref().unwrap());
    assert_ne!(
        fetch_one(&mut source).bytes.unwrap(),
        old[1].bytes.as_ref().unwrap()
    );
}

#[test]
fn an_archive_that_is_replaced_between_manifest_and_index_is_loaded() {
    let new = "f".repeat(32);
    let replaced = vec![ok(manifest(ID, 10)), ok(manifest(&new, 10))];
    let path: &'static str = format!("/v1/a/{new}/index").leak();
    let server = Scripted::start([("/v1/a", replaced), (path, vec![ok("an index")])]);
    let mut source = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
    let answers = fetch(&mut source, &[Request::Index { archive: "a".into() }]);
    assert_eq!(answers[0].bytes.as_ref().unwrap(), "an index");
}

#[test]
fn a_prefix_of_the_address_is_kept() {
    let paths = [
        ("/tiles/v1/a", vec![ok(manifest(ID, 10))]),
        (
            "/tiles/v1/a/0123456789abcdef0123456789abcdef/column/0",
            vec![ok("x")],
        ),
    ];
    let server = Scripted::start(paths);
    let mut source = HttpSource::new(&format!("{}/tiles/", server.url), HttpOptions::default()).unwrap();
    assert_eq!(fetch_one(&mut source).bytes.unwrap(), "x");
}

#[test]
fn a_source_may_live_and_end_inside_of_another_runtime() {
    let folder = Fixture::get().folder();
    let server = Served::start(folder.path());
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let mut source = HttpSource::new(&server.url, HttpOptions::default()).unwrap();
        source.submit(Fixture::get().requests()[0].clone()).unwrap();
        assert!(drain(&mut source)[0].bytes.is_ok());
        source.submit(Fixture::get().requests()[1].clone()).unwrap();
    });
}
