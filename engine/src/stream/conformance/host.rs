//! A web server for static files, as small as can be, which does ranges, and what hosts do wrong, on demand.

use std::{
    collections::{BTreeMap, VecDeque},
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use super::Fixture;

/// What is done with one request instead of answering it as it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::stream) enum Trick {
    /// Nothing is wrong.
    Honest,
    /// This status line, and these fields.
    Status(&'static str),
    /// The connection is closed without a word.
    HangUp,
    /// It is closed after so many bytes of the body.
    BreakOff(usize),
    /// Nothing follows for a while after so many bytes of the body.
    Pause(usize),
    /// All of the file, with status 200.
    IgnoreRange,
    /// The right bytes, and a Content-Range one byte off.
    WrongRange,
    /// Fewer bytes than asked for, rightly labelled.
    Short,
    /// A byte at this place of the body is wrong.
    Damage(usize),
    /// A body of another length than Content-Range says, chunked.
    Chunked,
    /// Says that it is compressed.
    Compressed,
}

struct Site {
    /// Bytes and ETag by path.
    files: BTreeMap<String, (Vec<u8>, Option<String>)>,
    tricks: VecDeque<Trick>,
    /// When the tricks are used up.
    always: Trick,
    /// Path and Range of all requests.
    asked: Vec<(String, Option<String>)>,
    /// Whether requests had Cache-Control: no-cache.
    anew: Vec<bool>,
}

/// The server, as long as it lives.
pub(in crate::stream) struct Host {
    pub(in crate::stream) url: String,
    site: Arc<Mutex<Site>>,
    gone: Arc<AtomicBool>,
}

impl Host {
    /// Serves the fixture's archives.
    pub(in crate::stream) fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let site = Arc::new(Mutex::new(Site {
            files: BTreeMap::new(),
            tricks: VecDeque::new(),
            always: Trick::Honest,
            asked: Vec::new(),
            anew: Vec::new(),
        }));
        let gone = Arc::new(AtomicBool::new(false));
        let host = Self { url, site, gone };
        for (name, bytes) in &Fixture::get().archives {
            host.put(name, bytes.clone(), Some("\"1\""));
        }
        let (site, gone) = (Arc::clone(&host.site), Arc::clone(&host.gone));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                if gone.load(Ordering::SeqCst) {
                    return;
                }
                let site = Arc::clone(&site);
                std::thread::spawn(move || converse(stream.unwrap(), &site));
            }
        });
        host
    }

    /// Puts an archive there, or another one in its place.
    pub(in crate::stream) fn put(&self, name: &str, bytes: Vec<u8>, etag: Option<&str>) {
        let path = format!("/{}.bsvtf", super::super::escape::escape(name));
        let file = (bytes, etag.map(str::to_owned));
        self.site.lock().unwrap().files.insert(path, file);
    }

    /// The next requests get these tricks, and then all are answered well.
    pub(in crate::stream) fn play(&self, tricks: impl IntoIterator<Item = Trick>) {
        self.site.lock().unwrap().tricks = tricks.into_iter().collect();
    }

    /// All requests from now on get this.
    pub(in crate::stream) fn always(&self, trick: Trick) {
        self.site.lock().unwrap().always = trick;
    }

    /// Paths and Range of the requests since the last call.
    pub(in crate::stream) fn asked(&self) -> Vec<(String, Option<String>)> {
        std::mem::take(&mut self.site.lock().unwrap().asked)
    }

    /// Whether each request since the last call was to pass caches.
    pub(in crate::stream) fn anew(&self) -> Vec<bool> {
        std::mem::take(&mut self.site.lock().unwrap().anew)
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        self.gone.store(true, Ordering::SeqCst);
        let _ = TcpStream::connect(self.url.trim_start_matches("http://"));
    }
}

fn converse(mut stream: TcpStream, site: &Mutex<Site>) {
    stream.set_nodelay(true).unwrap();
    loop {
        let mut head = Vec::new();
        let mut part = [0; 4096];
        while !head.ends_with(b"\r\n\r\n") {
            match stream.read(&mut part) {
                Ok(length @ 1..) => head.extend_from_slice(&part[..length]),
                _ => return,
            }
        }
        let head = String::from_utf8(head).unwrap();
        let path = head.split(' ').nth(1).unwrap().to_owned();
        let field = |name: &str| {
            let mut lines = head.lines();
            let line = lines.find(|line| line.to_ascii_lowercase().starts_with(name))?;
            Some(line[name.len()..].trim().to_owned())
        };
        let range = field("range:");
        let (trick, file) = {
            let mut site = site.lock().unwrap();
            site.asked.push((path.clone(), range.clone()));
            site.anew.push(field("cache-control:").is_some());
            let always = site.always;
            (
                site.tricks.pop_front().unwrap_or(always),
                site.files.get(&path).cloned(),
            )
        };
        if let Trick::Status(status) = trick {
            let answer = format!("HTTP/1.1 {status}\r\ncontent-length: 0\r\n\r\n");
            if stream.write_all(answer.as_bytes()).is_err() {
                return;
            }
            continue;
        }
        let Some((bytes, etag)) = file else {
            let answer = "HTTP/1.1 404 Not Found\r\ncontent-length: 3\r\n\r\nno\n";
            if trick == Trick::HangUp || stream.write_all(answer.as_bytes()).is_err() {
                return;
            }
            continue;
        };
        let fresh = field("if-range:").is_none_or(|wanted| Some(wanted) == etag);
        let range = range.filter(|_| fresh && trick != Trick::IgnoreRange);
        let range = range.map(|range| {
            let (first, last) = range.trim_start_matches("bytes=").split_once('-').unwrap();
            let last: usize = last.parse().unwrap();
            (first.parse::<usize>().unwrap(), bytes.len().min(last + 1))
        });
        let total = bytes.len();
        let (mut answer, mut body) = match range {
            None => ("HTTP/1.1 200 OK\r\n".to_owned(), bytes),
            Some((first, end)) if first >= end => {
                let answer = "HTTP/1.1 416 Range Not Satisfiable\r\ncontent-length: 0\r\n\r\n";
                stream.write_all(answer.as_bytes()).unwrap();
                continue;
            }
            Some((first, end)) => {
                let end = if trick == Trick::Short {
                    (first + end) / 2
                } else {
                    end
                };
                let off = usize::from(trick == Trick::WrongRange);
                let range = format!(
                    "content-range: bytes {}-{}/{total}\r\n",
                    first + off,
                    end + off - 1
                );
                (
                    format!("HTTP/1.1 206 Partial Content\r\n{range}"),
                    bytes[first..end].to_vec(),
                )
            }
        };
        answer += &etag.map_or(String::new(), |etag| format!("etag: {etag}\r\n"));
        if trick == Trick::Compressed {
            answer += "content-encoding: gzip\r\n";
        }
        if let Trick::Damage(at) = trick {
            let at = at % body.len();
            body[at] ^= 1;
        }
        let announced = body.len();
        match trick {
            Trick::BreakOff(after) => body.truncate(after),
            Trick::HangUp => return,
            Trick::Chunked => {
                body.truncate(body.len() / 2);
                body = [
                    format!("{:x}\r\n", body.len()).as_bytes(),
                    &body,
                    b"\r\n0\r\n\r\n",
                ]
                .concat();
            }
            _ => {}
        }
        answer += &match trick {
            Trick::Chunked => "transfer-encoding: chunked\r\n\r\n".to_owned(),
            _ => format!("content-length: {announced}\r\n\r\n"),
        };
        let pause = match trick {
            Trick::Pause(after) => after.min(body.len()),
            _ => body.len(),
        };
        let sent = stream
            .write_all(answer.as_bytes())
            .and_then(|()| stream.write_all(&body[..pause]))
            .and_then(|()| {
                if pause < body.len() {
                    std::thread::sleep(Duration::from_millis(300));
                }
                stream.write_all(&body[pause..])
            });
        if sent.is_err() || matches!(trick, Trick::BreakOff(_)) {
            return;
        }
    }
}
