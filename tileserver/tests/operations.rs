//! What those who run the server rely on: metrics, readiness, request ids, tokens, shedding, compressed documents.

mod common;

use std::{io::Read, time::Duration};

use common::{Server, archive, id, large_archive, receive, send};
use tileserver::{Collection, Options, Site};

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cloth.bsvtf"), archive(1)).unwrap();
    folder
}

async fn metrics(server: &Server) -> String {
    let answer = server.get("/metrics").await;
    assert_eq!(
        answer.field("content-type"),
        "text/plain; version=0.0.4; charset=utf-8"
    );
    String::from_utf8(answer.body).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_done_is_counted() {
    let folder = folder();
    std::fs::write(folder.path().join("broken.bsvtf"), b"none").unwrap();
    let server = Server::start(folder.path()).await;
    let column = format!("/v1/cloth/{}/column/0", id(&archive(1)));
    let sent: usize = [server.get(&column).await, server.get(&column).await]
        .iter()
        .map(|a| a.body.len())
        .sum();
    server.get("/v1/nothing").await;
    server.get("/v1/nothing/at/all").await;
    server.request("POST", "/v1/cloth", &[]).await;
    let text = metrics(&server).await;
    for line in [
        "eigentile_requests_total{route=\"column\",status=\"200\"} 2".to_owned(),
        "eigentile_requests_total{route=\"manifest\",status=\"404\"} 1".into(),
        "eigentile_requests_total{route=\"other\",status=\"404\"} 1".into(),
        "eigentile_requests_total{route=\"manifest\",status=\"405\"} 1".into(),
        format!("eigentile_sent_bytes_total{{route=\"column\"}} {sent}"),
        "eigentile_request_duration_seconds_count{route=\"column\"} 2".into(),
        "eigentile_cache_hits_total 1".into(),
        "eigentile_cache_misses_total 1".into(),
        "eigentile_connections_total 6".into(),
        "eigentile_requests 1".into(),
        "eigentile_archives 1".into(),
        "eigentile_broken_archives 1".into(),
        "eigentile_ready 1".into(),
    ] {
        assert!(text.lines().any(|other| other == line), "{line}\n{text}");
    }
    // Every line is a comment, or a name that was announced and a number.
    for line in text.lines().filter(|line| !line.starts_with("# ")) {
        let (name, value) = line.rsplit_once(' ').unwrap();
        value.parse::<f64>().unwrap();
        let family = name.split('{').next().unwrap();
        let family = ["_bucket", "_sum", "_count"]
            .iter()
            .fold(family, |f, end| f.strip_suffix(end).unwrap_or(f));
        assert!(text.contains(&format!("# TYPE {family} ")), "{line}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_have_names() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let named = server
        .request("GET", "/v1/cloth", &[("x-request-id", "proxy-17.a")])
        .await;
    assert_eq!(named.field("x-request-id"), "proxy-17.a");
    let (first, second) = (server.get("/v1/cloth").await, server.get("/v1/no").await);
    assert_ne!(first.field("x-request-id"), second.field("x-request-id"));
    let bad = server
        .request("GET", "/v1/cloth", &[("x-request-id", "a b\"c")])
        .await;
    assert_eq!(bad.field("x-request-id").len(), 16);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn too_many_requests_are_turned_away_at_once() {
    let folder = folder();
    std::fs::write(folder.path().join("large.bsvtf"), large_archive(6 << 20)).unwrap();
    let options = Options {
        requests: 1,
        ..Options::default()
    };
    let server = Server::with(folder.path(), options).await;
    let mut deaf = server.connect().await;
    send(&mut deaf, "GET", "/v1/large.bsvtf", &[]).await;
    deaf.readable().await.unwrap();
    let busy = server.get("/v1/cloth").await;
    busy.error(503, "busy");
    assert_eq!(busy.field("retry-after"), "1");
    for target in ["/health", "/ready", "/metrics"] {
        assert_eq!(server.get(target).await.status, 200, "{target} is always there");
    }
    assert!(metrics(&server).await.contains("eigentile_shed_total 1\n"));
    assert_eq!(receive(deaf).await.status, 200);
    assert_eq!(server.get("/v1/cloth").await.status, 200);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn collections_have_places_and_tokens() {
    let (open, closed) = (folder(), tempfile::tempdir().unwrap());
    std::fs::write(closed.path().join("vase.bsvtf"), archive(2)).unwrap();
    let museum = Collection::open(closed.path())
        .unwrap()
        .with_tokens(vec!["one".into(), "two".into()]);
    let site = Site::from(Collection::open(open.path()).unwrap())
        .with("museum", museum)
        .unwrap();
    let server = Server::of(site, Options::default()).await;
    let column = format!("/museum/v1/vase/{}/column/0", id(&archive(2)));
    for target in [
        "/museum/v1/",
        "/museum/v1/vase",
        "/museum/v1/vase.bsvtf",
        "/museum/v1/no",
        &column,
    ] {
        for field in [
            ("x-none", "-"),
            ("authorization", "Bearer three"),
            ("authorization", "Basic one"),
        ] {
            let refused = server.request("GET", target, &[field]).await;
            refused.error(401, "unauthorized");
            assert_eq!(refused.field("www-authenticate"), "Bearer");
        }
    }
    for token in ["Bearer one", "Bearer two"] {
        for target in ["/museum/v1/vase", &column] {
            let answer = server.request("GET", target, &[("authorization", token)]).await;
            assert_eq!(answer.status, 200);
            assert!(
                answer.field("cache-control").starts_with("private, "),
                "no shared cache may keep it"
            );
        }
    }
    // One collection does not lead to the other, by name or by content.
    assert_eq!(server.get("/v1/cloth").await.status, 200);
    for target in [
        "/v1/vase".to_owned(),
        column.replace("/museum", ""),
        "/v1/..%2fmuseum%2fv1%2fvase".into(),
    ] {
        assert_eq!(server.get(&target).await.status, 404, "{target}");
    }
    let asked = [("origin", "http://x"), ("access-control-request-method", "GET")];
    assert_eq!(
        server.request("OPTIONS", "/museum/v1/vase", &asked).await.status,
        200,
        "preflights have no token"
    );
    server.stop().await;
    for place in ["v1", "health", "museum", "a/b", "..", "größe", "{x}"] {
        let again = || Collection::open(closed.path()).unwrap();
        let site = Site::default().with("museum", again()).unwrap();
        assert!(site.with(place, again()).is_err(), "{place}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_end_is_announced() {
    let folder = folder();
    let options = Options {
        notice: Duration::from_secs(2),
        ..Options::default()
    };
    let server = Server::with(folder.path(), options).await;
    assert_eq!(server.get("/ready").await.status, 200);
    let address = server.address;
    let stopped = tokio::spawn(server.stop());
    let get = async |target: &str| {
        let mut stream = tokio::net::TcpStream::connect(address).await.unwrap();
        send(&mut stream, "GET", target, &[]).await;
        receive(stream).await
    };
    while get("/ready").await.status == 200 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    get("/ready").await.error(503, "not-ready");
    assert_eq!(get("/v1/cloth").await.status, 200, "requests are still answered");
    stopped.await.unwrap();
    assert!(tokio::net::TcpStream::connect(address).await.is_err());
}

#[tokio::test(flavor = "multi_thread")]
async fn documents_are_compressed_for_those_who_ask_and_records_never() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    for target in ["/v1/", "/v1/cloth"] {
        let plain = server.get(target).await;
        assert_eq!(plain.field("vary"), "accept-encoding");
        assert!(!plain.fields.contains_key("content-encoding"));
        let gzip = server
            .request("GET", target, &[("accept-encoding", "br, gzip")])
            .await;
        assert_eq!((gzip.status, gzip.field("content-encoding")), (200, "gzip"));
        assert!(gzip.body.len() < plain.body.len());
        let mut text = Vec::new();
        flate2::read::GzDecoder::new(&*gzip.body)
            .read_to_end(&mut text)
            .unwrap();
        assert_eq!(text, plain.body);
        assert_ne!(
            gzip.field("etag"),
            plain.field("etag"),
            "other bytes, another strong ETag"
        );
        let etag = gzip.field("etag");
        let known = [("accept-encoding", "gzip"), ("if-none-match", etag)];
        assert_eq!(server.request("GET", target, &known).await.status, 304);
    }
    for target in [
        "/v1/cloth.bsvtf".to_owned(),
        format!("/v1/cloth/{}/column/0", id(&archive(1))),
    ] {
        let record = server
            .request("GET", &target, &[("accept-encoding", "gzip")])
            .await;
        assert!(!record.fields.contains_key("content-encoding"), "{target}");
    }
    server.stop().await;
}
