//! Connections: how many, how long, and how they end.

mod common;

use std::time::{Duration, Instant};

use common::{Server, archive, large_archive, receive, send};
use tileserver::Options;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};

/// Long enough for anything that is not stuck.
const PATIENCE: Duration = Duration::from_secs(20);

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cloth.bsvtf"), archive(1)).unwrap();
    std::fs::write(folder.path().join("large.bsvtf"), large_archive(6 << 20)).unwrap();
    folder
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_in_progress_are_finished_on_shutdown() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let expected = std::fs::read(folder.path().join("large.bsvtf")).unwrap();
    let address = server.address;
    // Several answers that have begun: more than sockets buffer, so that the server is still at it.
    let mut downloads = Vec::new();
    for _ in 0..4 {
        let mut stream = server.connect().await;
        send(&mut stream, "GET", "/v1/large.bsvtf", &[]).await;
        stream.readable().await.unwrap();
        downloads.push(stream);
    }
    let idle = server.connect().await;
    let stopped = tokio::spawn(server.stop());
    for stream in downloads {
        let answer = timeout(PATIENCE, receive(stream)).await.unwrap();
        assert_eq!((answer.status, answer.body == expected), (200, true));
    }
    timeout(PATIENCE, stopped)
        .await
        .expect("it stops when all is sent")
        .unwrap();
    assert!(
        TcpStream::connect(address).await.is_err(),
        "nobody listens any more"
    );
    drop(idle);
}

#[tokio::test(flavor = "multi_thread")]
async fn shutdown_does_not_wait_forever() {
    let folder = folder();
    let options = Options {
        drain_timeout: Duration::from_millis(200),
        ..Default::default()
    };
    let server = Server::with(folder.path(), options).await;
    let mut stream = server.connect().await;
    send(&mut stream, "GET", "/v1/large.bsvtf", &[]).await;
    stream.readable().await.unwrap();
    timeout(PATIENCE, server.stop())
        .await
        .expect("a client that does not read is left behind");
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_are_kept_and_counted() {
    let folder = folder();
    let server = Server::with(
        folder.path(),
        Options {
            connections: 2,
            ..Default::default()
        },
    )
    .await;
    let (mut first, second) = (server.connect().await, server.connect().await);
    // Two requests on one connection.
    for _ in 0..2 {
        first
            .write_all(b"GET /health HTTP/1.1\r\nhost: x\r\n\r\n")
            .await
            .unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"ok\n") {
            assert_ne!(first.read_buf(&mut answer).await.unwrap(), 0);
        }
    }
    // A third connection waits until one of the two is closed.
    let mut third = server.connect().await;
    send(&mut third, "GET", "/health", &[]).await;
    let mut byte = [0];
    assert!(
        timeout(Duration::from_millis(200), third.peek(&mut byte))
            .await
            .is_err()
    );
    drop(second);
    assert_eq!(timeout(PATIENCE, receive(third)).await.unwrap().status, 200);
    drop(first);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn silent_clients_are_left() {
    let folder = folder();
    let options = Options {
        header_timeout: Duration::from_millis(200),
        idle_timeout: Duration::from_millis(800),
        ..Default::default()
    };
    let server = Server::with(folder.path(), options).await;
    let begin = Instant::now();
    // One that never ends its request, one byte at a time.
    let mut slow = server.connect().await;
    let trickle = async {
        for byte in b"GET /v1/ HTTP/1.1\r\nhost: "
            .iter()
            .chain(std::iter::repeat(&b'x'))
        {
            if slow.write_all(&[*byte]).await.is_err() {
                return;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(PATIENCE, trickle)
        .await
        .expect("a request must be there in time");
    // One that does not take its answer: the server gives up, and what it had not sent never comes.
    let mut deaf = server.connect().await;
    send(&mut deaf, "GET", "/v1/large.bsvtf", &[]).await;
    deaf.readable().await.unwrap();
    tokio::time::sleep(Duration::from_millis(1500)).await;
    let mut got = Vec::new();
    let _ = timeout(PATIENCE, deaf.read_to_end(&mut got))
        .await
        .expect("the connection is closed");
    let length = std::fs::metadata(folder.path().join("large.bsvtf"))
        .unwrap()
        .len();
    assert!((got.len() as u64) < length, "{} of {length} bytes", got.len());
    assert!(begin.elapsed() < PATIENCE);
    // Others are not disturbed.
    assert_eq!(server.get("/v1/cloth").await.status, 200);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn heads_have_a_time_and_connections_may_rest() {
    let folder = folder();
    let options = Options {
        header_timeout: Duration::from_millis(200),
        ..Default::default()
    };
    let server = Server::with(folder.path(), options).await;
    let mut stream = server.connect().await;
    for _ in 0..2 {
        stream
            .write_all(b"GET /health HTTP/1.1\r\nhost: x\r\n\r\n")
            .await
            .unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"ok\n") {
            assert_ne!(stream.read_buf(&mut answer).await.unwrap(), 0);
        }
        // Longer than a head may take: it has not begun.
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
    stream.write_all(b"GET /health HTTP/1.1\r\n").await.unwrap();
    let end = timeout(PATIENCE, stream.read(&mut [0])).await;
    assert!(
        end.expect("it has begun and does not go on")
            .is_ok_and(|bytes| bytes == 0)
    );
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_without_room_says_so() {
    let folder = folder();
    let options = Options {
        memory_bytes: 64 << 10,
        request_timeout: Duration::from_millis(300),
        ..Default::default()
    };
    let server = Server::with(folder.path(), options).await;
    // A client that has begun to take a large record and does not go on holds all of the memory.
    let id = server.get("/v1/large").await.json()["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let mut deaf = server.connect().await;
    send(&mut deaf, "GET", &format!("/v1/large/{id}/column/0"), &[]).await;
    deaf.readable().await.unwrap();
    let busy = server.get(&format!("/v1/large/{id}/column/1")).await;
    busy.error(503, "busy");
    assert_eq!(busy.field("retry-after"), "1");
    assert_eq!(
        server.get("/v1/cloth").await.status,
        200,
        "what takes no memory goes on"
    );
    // With its checksum.
    let first = timeout(PATIENCE, receive(deaf)).await.unwrap();
    assert_eq!((first.status, first.body.len()), (200, (6 << 20) + 4));
    assert_eq!(server.get(&format!("/v1/large/{id}/column/1")).await.status, 200);
    server.stop().await;
}

#[test]
fn a_folder_that_is_none_is_refused() {
    let error = tileserver::Collection::open("/no/such/folder")
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("/no/such/folder"), "{error}");
}
