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

mod batches;
mod failures;
mod servers;

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

/// An index of an archive with [`ID`].
fn an_index(body: impl AsRef<[u8]>) -> Reply {
    let length = body.as_ref().len();
    let head = format!("HTTP/1.1 200 OK\r\ncontent-length: {length}\r\netag: \"{ID}\"\r\n\r\n");
    Reply::Raw([head.as_bytes(), body.as_ref()].concat())
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
        retried(HttpSource::new(&self.url, &HttpOptions::default()).unwrap())
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
