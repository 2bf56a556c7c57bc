//! Records that travel together.

use super::*;

/// A frame of a batch: a column with these bytes, or another status.
fn frame(group: u8, status: u16, bytes: &[u8]) -> Vec<u8> {
    let status = status.to_le_bytes();
    let head = [0, 0, group, 0, 0, 0, 0, 0, status[0], status[1], 0, 0];
    [&head[..], &(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

/// A server that gives an index, and so does batches, and this answer to one of columns 0 to 3.
fn with_batches(replies: Vec<Reply>) -> Scripted {
    let batch: &'static str = format!("/v1/a/{ID}/batch/c0,c1,c2,c3").leak();
    let rest: &'static str = format!("/v1/a/{ID}/batch/c2,c3").leak();
    let mut index = vec![0; 10];
    index[0] = 1;
    Scripted::start([
        ("/v1/a", vec![ok(manifest(ID, 100))]),
        ("/v1/a/index", vec![an_index(index)]),
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
    for (reply, exchanges) in [(ok(&whole), 2..=2), (cut, 3..=4)] {
        let server = with_batches(vec![reply]);
        let mut bare = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
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
        let mut source = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
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
fn a_real_server_is_asked_in_batches() {
    let (fixture, requests) = (Fixture::get(), Fixture::get().requests());
    let folder = fixture.folder();
    let server = Served::start(folder.path());
    let mut source = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
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
