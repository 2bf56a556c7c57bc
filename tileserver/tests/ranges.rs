//! The archive itself, whole and in ranges.

mod common;

use common::{Server, archive, id, large_archive};

#[tokio::test(flavor = "multi_thread")]
async fn ranges() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = archive(1);
    std::fs::write(folder.path().join("cloth.bsvtf"), &bytes).unwrap();
    let server = Server::start(folder.path()).await;
    let (target, length) = ("/v1/cloth.bsvtf", bytes.len());
    let etag = format!("\"{}\"", id(&bytes));

    let whole = server.get(target).await;
    assert_eq!((whole.status, &whole.body), (200, &bytes));
    assert_eq!(
        (whole.field("accept-ranges"), whole.field("etag")),
        ("bytes", &*etag)
    );
    assert_eq!(whole.field("cache-control"), "public, max-age=5, must-revalidate");
    assert_eq!(whole.field("content-length"), length.to_string());

    for (range, first, end) in [
        ("bytes=0-63".to_owned(), 0, 64),
        ("bytes=0-0".into(), 0, 1),
        ("bytes=100-".into(), 100, length),
        ("bytes=-10".into(), length - 10, length),
        (format!("bytes=-{}", length * 2), 0, length),
        (format!("bytes={}-", length - 1), length - 1, length),
        (format!("bytes=5-{}", length * 2), 5, length),
    ] {
        let part = server.request("GET", target, &[("range", &range)]).await;
        assert_eq!((part.status, &*part.body), (206, &bytes[first..end]), "{range}");
        assert_eq!(
            part.field("content-range"),
            format!("bytes {first}-{}/{length}", end - 1)
        );
        assert_eq!(part.field("content-length"), (end - first).to_string());
        assert_eq!(part.field("etag"), etag);
    }
    for range in [
        format!("bytes={length}-"),
        "bytes=-0".into(),
        "bytes=9-5".into(),
        "bytes=x".into(),
        "bytes=0-1,x".into(),
        format!("bytes={}0-0", "0-0,".repeat(64)),
    ] {
        let refused = server.request("GET", target, &[("range", &range)]).await;
        refused.error(416, "range-not-satisfiable");
        assert_eq!(
            refused.field("content-range"),
            format!("bytes */{length}"),
            "{range}"
        );
    }
    // Fields that make a range not apply: another unit, another content, a method without ranges.
    for fields in [
        vec![("range", "pages=0-1")],
        vec![("range", "bytes=0-9"), ("if-range", "\"other\"")],
        vec![
            ("range", "bytes=0-9"),
            ("if-range", "Sun, 06 Nov 1994 08:49:37 GMT"),
        ],
    ] {
        let answer = server.request("GET", target, &fields).await;
        assert_eq!((answer.status, &answer.body), (200, &bytes), "{fields:?}");
    }
    let part = server
        .request("GET", target, &[("range", "bytes=0-9"), ("if-range", &etag)])
        .await;
    assert_eq!((part.status, &*part.body), (206, &bytes[..10]));
    let known = server
        .request("GET", target, &[("range", "bytes=0-9"), ("if-none-match", &etag)])
        .await;
    assert_eq!(known.status, 304);
    let head = server.request("HEAD", target, &[("range", "bytes=0-9")]).await;
    assert_eq!(
        (head.status, head.field("content-length")),
        (200, &*length.to_string())
    );
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn several_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = archive(1);
    std::fs::write(folder.path().join("cloth.bsvtf"), &bytes).unwrap();
    let server = Server::start(folder.path()).await;
    let length = bytes.len();
    let fields = [("range", "bytes=100-199, 0-9,-5,999999999-")];
    let answer = server.request("GET", "/v1/cloth.bsvtf", &fields).await;
    assert_eq!(answer.status, 206);
    assert_eq!(answer.field("content-length"), answer.body.len().to_string());
    let boundary = answer
        .field("content-type")
        .strip_prefix("multipart/byteranges; boundary=")
        .unwrap();
    let mut expected = Vec::new();
    for (first, end) in [(100, 200), (0, 10), (length - 5, length)] {
        expected.extend(format!("\r\n--{boundary}\r\ncontent-type: application/octet-stream\r\n").bytes());
        expected.extend(format!("content-range: bytes {first}-{}/{length}\r\n\r\n", end - 1).bytes());
        expected.extend(&bytes[first..end]);
    }
    expected.extend(format!("\r\n--{boundary}--\r\n").bytes());
    assert_eq!(answer.body, expected);
    // Ranges that make more of the archive than there is.
    let answer = server
        .request("GET", "/v1/cloth.bsvtf", &[("range", "bytes=0-,0-")])
        .await;
    assert_eq!((answer.status, answer.body == bytes), (200, true));
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_archive_of_many_parts() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = large_archive(1_000_000);
    std::fs::write(folder.path().join("large.bsvtf"), &bytes).unwrap();
    // Memory for one part only, however many ask.
    let options = tileserver::Options {
        memory_bytes: 256 << 10,
        reads: 1,
        ..Default::default()
    };
    let server = Server::with(folder.path(), options).await;
    let column = format!("/v1/large/{}/column/1", id(&bytes)); // Larger than the memory: served alone.
    let (whole, part, column) = tokio::join!(
        server.get("/v1/large.bsvtf"),
        server.request("GET", "/v1/large.bsvtf", &[("range", "bytes=70000-1700000")]),
        server.get(&column),
    );
    assert_eq!((whole.status, whole.body == bytes), (200, true));
    assert_eq!((part.status, part.body == bytes[70_000..=1_700_000]), (206, true));
    // With its checksum.
    assert_eq!((column.status, column.body.len()), (200, 1_000_000 + 4));
    server.stop().await;
}
