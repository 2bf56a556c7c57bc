//! What servers have: archives that are replaced, prefixes, connections that are kept.

use super::*;

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
        // One that has just answered may not be back among the free ones yet.
        connections <= 2 * HttpOptions::default().connections as u64,
        "{connections} connections for 201 requests"
    );
}

#[test]
fn a_replaced_archive_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bsvtf");
    std::fs::write(&path, archive(1)).unwrap();
    let server = Served::start(folder.path());
    let mut source = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
    let index = Request::Index { archive: "a".into() };
    let old = fetch(&mut source, &[index.clone(), column(0)]);
    assert!(old.iter().all(|answer| answer.bytes.is_ok()));

    let new = folder.path().join("new");
    std::fs::write(&new, archive(2)).unwrap();
    std::fs::rename(&new, &path).unwrap();
    // The server goes on with the old archive until somebody asks for the manifest.
    assert!(fetch_one(&mut source).bytes.is_ok());
    let mut other = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
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
fn an_index_is_one_exchange_and_says_what_it_is_of() {
    let index = [Request::Index { archive: "a".into() }];
    let server = Scripted::start([(
        "/v1/a/index",
        vec![an_index("an index"), ok("a page about cloth")],
    )]);
    let mut source = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
    assert_eq!(fetch(&mut source, &index)[0].bytes.as_ref().unwrap(), "an index");
    assert_eq!(source.stats().exchanges, 1);
    let said = fetch(&mut source, &index)
        .remove(0)
        .bytes
        .unwrap_err()
        .to_string();
    assert!(said.contains("no index of a tile server"), "{said}");
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
    let mut source = HttpSource::new(&format!("{}/tiles/", server.url), &HttpOptions::default()).unwrap();
    assert_eq!(fetch_one(&mut source).bytes.unwrap(), "x");
}

#[test]
fn a_source_may_live_and_end_inside_of_another_runtime() {
    let folder = Fixture::get().folder();
    let server = Served::start(folder.path());
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let mut source = HttpSource::new(&server.url, &HttpOptions::default()).unwrap();
        source.submit(Fixture::get().requests()[0].clone()).unwrap();
        assert!(drain(&mut source)[0].bytes.is_ok());
        source.submit(Fixture::get().requests()[1].clone()).unwrap();
    });
}
