//! A web server as a store, one that fails in every way that HTTP has: status 500 and 503, silence, wrong lengths, other ranges, another
//! version. What is told is clear, nothing is mixed, and other collections go on.

mod common;

use std::{
    sync::{Arc, Mutex},
    time::Duration,
};

use common::{Server, archive, id, open};
use tileserver::{Collection, Options, Site};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
};

/// What happens to requests for bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    Status(u16),
    Silence,
    /// The head promises more than comes.
    BreaksOff,
    /// Fewer bytes than asked for, and the head says so.
    Short,
    /// As many bytes from elsewhere, and the head says so.
    Elsewhere,
    /// Bytes of another version, as if nobody had asked for the one that was opened.
    OtherVersion,
}

/// A web server with one file.
struct Origin {
    url: String,
    fault: Arc<Mutex<Fault>>,
}

impl Origin {
    async fn start(file: Vec<u8>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/cloth.bsvtf", listener.local_addr().unwrap());
        let (fault, file) = (Arc::new(Mutex::new(Fault::None)), Arc::new(file));
        let origin = Self {
            url,
            fault: Arc::clone(&fault),
        };
        tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                tokio::spawn(converse(stream, Arc::clone(&file), Arc::clone(&fault)));
            }
        });
        origin
    }

    fn fail(&self, fault: Fault) {
        *self.fault.lock().unwrap() = fault;
    }
}

/// One request a connection.
async fn converse(mut stream: TcpStream, file: Arc<Vec<u8>>, fault: Arc<Mutex<Fault>>) {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        if stream.read_buf(&mut head).await.unwrap_or(0) == 0 {
            return;
        }
    }
    let head = String::from_utf8_lossy(&head).to_lowercase();
    let total = file.len();
    let common = "connection: close\r\nlast-modified: Sun, 22 Nov 2026 00:00:00 GMT\r\n";
    let range = head.lines().find_map(|line| line.strip_prefix("range: bytes="));
    let Some((first, last)) = range.and_then(|range| range.split_once('-')) else {
        let answer = format!("HTTP/1.1 200 OK\r\n{common}etag: \"one\"\r\ncontent-length: {total}\r\n\r\n");
        let _ = stream.write_all(answer.as_bytes()).await;
        return;
    };
    let (mut first, mut end): (usize, usize) = (first.parse().unwrap(), last.parse::<usize>().unwrap() + 1);
    let (mut etag, mut cut) = ("one", 0);
    let fault = *fault.lock().unwrap();
    match fault {
        Fault::None => {}
        Fault::Status(status) => {
            let answer = format!("HTTP/1.1 {status} No\r\n{common}content-length: 0\r\n\r\n");
            let _ = stream.write_all(answer.as_bytes()).await;
            return;
        }
        Fault::Silence => return std::future::pending().await,
        Fault::BreaksOff => cut = 1,
        Fault::Short => end -= 1,
        Fault::Elsewhere => (first, end) = (first - 1, end - 1),
        Fault::OtherVersion => etag = "two",
    }
    let mut bytes = file[first..end].to_vec();
    if fault == Fault::OtherVersion {
        bytes.iter_mut().for_each(|byte| *byte = !*byte);
    }
    let answer = format!(
        "HTTP/1.1 206 Partial\r\n{common}etag: \"{etag}\"\r\ncontent-length: {}\r\ncontent-range: bytes {first}-{}/{total}\r\n\r\n",
        bytes.len(),
        end - 1
    );
    let _ = stream.write_all(answer.as_bytes()).await;
    let _ = stream.write_all(&bytes[..bytes.len() - cut]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn every_fault_has_its_answer_and_others_go_on() {
    let bytes = archive(1);
    let origin = Origin::start(bytes.clone()).await;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cloth.bsvtf"), &bytes).unwrap();
    let site = Site::default()
        .with("far", Collection::from_url(&origin.url).await.unwrap())
        .and_then(|site| site.with("near", Collection::open(folder.path())?))
        .unwrap();
    let options = Options {
        cache_bytes: 0,
        store_timeout: Duration::from_millis(200),
        ..Options::default()
    };
    let server = Server::of(site, options).await;
    let target = |place: &str| format!("/{place}/v1/cloth/{}/column/0", id(&bytes));
    let column = open(bytes.clone()).column_record(0).unwrap();
    for (fault, status, error) in [
        (Fault::Status(500), 503, "unavailable"),
        (Fault::Status(503), 503, "unavailable"),
        (Fault::Silence, 503, "unavailable"),
        (Fault::BreaksOff, 503, "unavailable"),
        (Fault::Short, 503, "unavailable"),
        (Fault::Elsewhere, 503, "unavailable"),
        (Fault::Status(403), 500, "corrupt"),
        // The store says that it has changed, and then still has what it had.
        (Fault::OtherVersion, 503, "unavailable"),
        (Fault::Status(412), 503, "unavailable"),
    ] {
        origin.fail(fault);
        let (far, near) = (target("far"), target("near"));
        let (failed, other) = tokio::join!(server.get(&far), server.get(&near));
        assert_eq!(failed.status, status, "{fault:?}: {failed:?}");
        failed.error(status, error);
        assert_eq!(other.body, column, "{fault:?}: the other collection goes on");
        // Parts of an archive are not checked by the server: none of them may be of another version.
        if fault == Fault::OtherVersion {
            let whole = server.get("/far/v1/cloth.bsvtf").await;
            assert!(
                whole.body.is_empty(),
                "{} bytes of another version",
                whole.body.len()
            );
        }
        origin.fail(Fault::None);
        assert_eq!(server.get(&far).await.body, column, "{fault:?} has passed");
    }
    server.stop().await;
}
