//! Hosts with TLS, hosts that send clients on to others, and addresses that are signed.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use engine::{
    Error,
    stream::{HttpOptions, OpenOptions, Request as Asked, open_with},
};
use http_body_util::Empty;
use hyper::{Request, Response, body::Incoming, header, server::conn::http1, service::service_fn};
use hyper_util::rt::TokioIo;
use tests::{Server, requests};
use tileserver::{Collection, Options, Site, Tls};
use tokio::{net::TcpListener, runtime::Runtime};

use crate::{FIXTURE, check, options};

/// A tile server with TLS and a certificate of its own, over all archives.
struct Secure {
    server: Server,
    folder: tempfile::TempDir,
}

impl Secure {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        let (chain, key) = (folder.path().join("ca.pem"), folder.path().join("key"));
        std::fs::write(&chain, made.cert.pem()).unwrap();
        std::fs::write(&key, made.signing_key.serialize_pem()).unwrap();
        let collection = Collection::open(FIXTURE.tiles()).unwrap();
        let site = Site::from(collection).with_tls(Tls::new(chain, key).unwrap());
        Self {
            server: Server::of(site, Options::default()),
            folder,
        }
    }

    /// `https://localhost:PORT`.
    fn address(&self) -> String {
        self.server
            .address
            .replace("http://127.0.0.1", "https://localhost")
    }

    fn ca_file(&self) -> PathBuf {
        self.folder.path().join("ca.pem")
    }

    fn trusted(&self) -> OpenOptions {
        OpenOptions {
            http: HttpOptions {
                ca_file: Some(self.ca_file()),
                ..HttpOptions::default()
            },
            ..options(None)
        }
    }
}

/// A host that answers each request with what a function makes of its path and query: a place to go to.
struct Guide {
    address: String,
    asked: Arc<AtomicUsize>,
    _runtime: Runtime,
}

impl Guide {
    fn start(place: impl Fn(&str) -> String + Send + Sync + 'static) -> Self {
        let (runtime, asked) = (Runtime::new().unwrap(), Arc::new(AtomicUsize::new(0)));
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let (count, place) = (Arc::clone(&asked), Arc::new(place));
        runtime.spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let (count, place) = (Arc::clone(&count), Arc::clone(&place));
                let answer = move |request: Request<Incoming>| {
                    count.fetch_add(1, Ordering::Relaxed);
                    let path = request.uri().path_and_query().map_or("/", |path| path.as_str());
                    let response = Response::builder()
                        .status(307)
                        .header(header::LOCATION, place(path))
                        .body(Empty::<hyper::body::Bytes>::new());
                    async { response }
                };
                tokio::spawn(
                    http1::Builder::new().serve_connection(TokioIo::new(stream), service_fn(answer)),
                );
            }
        });
        Self {
            address,
            asked,
            _runtime: runtime,
        }
    }
}

/// What the first request, for an index, fails with.
fn refusal(url: &str, options: &OpenOptions) -> Error {
    let mut source = open_with(url, options).unwrap();
    let name = FIXTURE.names()[0];
    let index = &requests(name, &FIXTURE.archive(name))[..1];
    let mut error = None;
    tests::ask(&mut *source, index, |_, answer, _| error = answer.bytes.err());
    error.expect("an error")
}

#[test]
fn certificates_are_checked_and_a_file_of_them_can_be_trusted() {
    let host = Secure::start();
    let [first, second] = FIXTURE.names();
    // As a tile server, and by ranges of its archives.
    let mut server = open_with(&host.address(), &host.trusted()).unwrap();
    check(&mut *server, first, || {});
    let file = format!("{}/v1/{second}.bsvtf", host.address());
    let mut ranges = open_with(&file, &host.trusted()).unwrap();
    check(&mut *ranges, second, || {});
    // Nobody has said that whoever has signed it is to be trusted.
    let error = refusal(&host.address(), &options(None)).to_string();
    assert!(
        error.contains("certificate") && error.contains("--ca-file"),
        "{error}"
    );
    // It is that of another host.
    let elsewhere = host.address().replace("localhost", "127.0.0.1");
    let error = refusal(&elsewhere, &host.trusted()).to_string();
    assert!(error.contains("certificate"), "{error}");
    for (file, says) in [
        (host.folder.path().join("no"), "no"),
        (host.folder.path().join("key"), "none"),
    ] {
        let mut options = host.trusted();
        options.http.ca_file = Some(file);
        let error = open_with(&host.address(), &options).err().unwrap().to_string();
        assert!(error.contains(says) && error.contains("PEM"), "{error}");
    }
}

#[test]
fn clients_go_where_they_are_sent_but_not_to_less_safety_or_in_circles() {
    let host = Secure::start();
    let (plain, [first, second]) = (Server::start(&FIXTURE.tiles()), FIXTURE.names());
    let to_plain = plain.address.clone();
    let to_secure = host.address();
    // A tile server that has moved; files by ranges, first to another host and then to one with TLS.
    let moved = Guide::start(move |path| format!("{to_plain}{path}"));
    let mut source = open_with(&moved.address, &options(None)).unwrap();
    check(&mut *source, first, || {});
    let upgraded = Guide::start(move |path| format!("{to_secure}{path}"));
    let there = upgraded.address.clone();
    let twice = Guide::start(move |path| format!("{there}{path}"));
    let mut source = open_with(&format!("{}/v1/{second}.bsvtf", twice.address), &host.trusted()).unwrap();
    check(&mut *source, second, || {});
    assert!(upgraded.asked.load(Ordering::Relaxed) > 0);

    let around = Guide::start(str::to_owned);
    let error = refusal(&format!("{}/a/{first}.bsvtf", around.address), &options(None)).to_string();
    assert!(error.contains("307") && error.contains("not followed"), "{error}");
    assert_eq!(around.asked.load(Ordering::Relaxed), 6, "the first and five more");
    let out = Guide::start(|_| "file:///etc/passwd".into());
    let error = refusal(&format!("{}/a/{first}.bsvtf", out.address), &options(None)).to_string();
    assert!(
        error.contains("file:///etc/passwd") && error.contains("not followed"),
        "{error}"
    );
}

#[test]
fn signatures_go_with_every_request_and_into_no_message() {
    let (plain, [first, _]) = (Server::start(&FIXTURE.tiles()), FIXTURE.names());
    let (query, to) = ("?X-Amz-Signature=s%2Fcret&n=1", plain.address.clone());
    // Lets in who has the signature; the tile server behind does not mind it.
    let store = Guide::start(move |path| match path.strip_suffix(query) {
        Some(path) => format!("{to}{path}"),
        None => format!("{to}/no"),
    });
    let address = format!("{}/v1/{first}.bsvtf{query}", store.address);
    let mut source = open_with(&address, &options(None)).unwrap();
    let answers = check(&mut *source, first, || {});
    assert!(matches!(answers[0].request, Asked::Index { .. }));
    assert!(!source.origin().contains("cret"), "{}", source.origin());
    let gone = format!("{}/v1/gone/{first}.bsvtf{query}", store.address);
    let error = refusal(&gone, &options(None)).to_string();
    assert!(error.contains("gone") && !error.contains("cret"), "{error}");
}
