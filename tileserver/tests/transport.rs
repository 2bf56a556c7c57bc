//! HTTP/2 and TLS.

mod common;

use std::{
    path::{Path, PathBuf},
    sync::{Arc, LazyLock},
    time::Duration,
};

use bytes::Bytes;
use common::{Server, archive, id, large_archive, open};
use http_body_util::{BodyExt, Empty, Full};
use hyper::{Request, StatusCode, client::conn::http2};
use hyper_util::rt::{TokioExecutor, TokioIo};
use tileserver::{Collection, Options, Site, Tls};
use tokio::{
    io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};
use tokio_rustls::{
    TlsConnector,
    client::TlsStream,
    rustls::{
        ClientConfig, RootCertStore,
        crypto::ring,
        pki_types::{CertificateDer, ServerName, pem::PemObject},
    },
};

const PATIENCE: Duration = Duration::from_secs(20);

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cloth.bsvtf"), archive(1)).unwrap();
    std::fs::write(folder.path().join("large.bsvtf"), large_archive(3 << 20)).unwrap();
    folder
}

/// Two certificates that sign themselves, `first.pem` and `second.pem`, and their keys, `first.key` and `second.key`.
static CERTIFICATES: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("certificates");
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["first", "second"] {
        let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        std::fs::write(folder.join(name).with_extension("pem"), made.cert.pem()).unwrap();
        std::fs::write(
            folder.join(name).with_extension("key"),
            made.signing_key.serialize_pem(),
        )
        .unwrap();
    }
    folder
});

fn certificate(name: &str) -> PathBuf {
    CERTIFICATES.join(name)
}

/// A connection of HTTP/2.
async fn http2<B>(stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static) -> http2::SendRequest<B>
where
    B: hyper::body::Body<Data = Bytes, Error: std::error::Error + Send + Sync> + Send + Unpin + 'static,
{
    let (sender, connection) = http2::handshake(TokioExecutor::new(), TokioIo::new(stream))
        .await
        .unwrap();
    tokio::spawn(connection);
    sender
}

async fn get(mut sender: http2::SendRequest<Empty<Bytes>>, target: &str) -> (StatusCode, Bytes) {
    let request = Request::get(format!("http://test{target}"))
        .body(Empty::new())
        .unwrap();
    let answer = sender.send_request(request).await.unwrap();
    (
        answer.status(),
        answer.into_body().collect().await.unwrap().to_bytes(),
    )
}

#[tokio::test(flavor = "multi_thread")]
async fn many_requests_share_a_connection() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let (bytes, large) = (archive(1), large_archive(3 << 20));
    let column = format!("/v1/cloth/{}/column/0", id(&bytes));
    let expected = open(bytes).column_record(0).unwrap();
    let sender = http2(server.connect().await).await;
    let records = (0..100).map(|_| get(sender.clone(), &column));
    let (records, archive) = tokio::join!(
        futures_util::future::join_all(records),
        get(sender.clone(), "/v1/large.bsvtf")
    );
    assert!(
        records
            .iter()
            .all(|(status, body)| *status == 200 && *body == expected)
    );
    assert_eq!((archive.0.as_u16(), archive.1 == large), (200, true));
    assert_eq!(get(sender, "/v1/nothing").await.0, 404);
    let text = String::from_utf8(server.get("/metrics").await.body).unwrap();
    assert!(text.contains("eigentile_connections_total 2\n"), "{text}");
    // Bodies are refused here, too.
    let mut sender = http2(server.connect().await).await;
    let request = Request::post("http://test/v1/cloth")
        .body(Full::new(Bytes::from("body")))
        .unwrap();
    assert_eq!(sender.send_request(request).await.unwrap().status(), 413);
    drop(sender);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_of_http2_are_finished_on_shutdown() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let mut sender = http2::<Empty<Bytes>>(server.connect().await).await;
    let request = Request::get("http://test/v1/large.bsvtf")
        .body(Empty::new())
        .unwrap();
    let answer = sender.send_request(request).await.unwrap();
    let stopped = tokio::spawn(server.stop());
    tokio::time::sleep(Duration::from_millis(50)).await;
    let body = timeout(PATIENCE, answer.into_body().collect())
        .await
        .unwrap()
        .unwrap()
        .to_bytes();
    assert!(body == large_archive(3 << 20));
    timeout(PATIENCE, stopped)
        .await
        .expect("it stops when all is sent")
        .unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn who_sends_frames_byte_by_byte_is_as_good_as_silent() {
    let folder = folder();
    let options = Options {
        header_timeout: Duration::from_millis(300),
        idle_timeout: Duration::from_millis(600),
        ..Options::default()
    };
    let server = Server::with(folder.path(), options).await;
    for begin in [
        &b"PR"[..],
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0\0\x10\0\x01\x04\0\0\0\x01",
    ] {
        let mut slow = server.connect().await;
        slow.write_all(begin).await.unwrap();
        let trickle = async {
            while slow.write_all(b"\0").await.is_ok() {
                if begin.len() == 2 {
                    // A preface that does not come.
                    let _ = slow.read_to_end(&mut Vec::new()).await;
                    return;
                }
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        };
        timeout(PATIENCE, trickle).await.expect("the server gives up");
    }
    server.stop().await;
}

/// A connection that trusts one certificate only.
async fn connect(server: &Server, trusted: &str, protocol: &[u8]) -> std::io::Result<TlsStream<TcpStream>> {
    let mut roots = RootCertStore::empty();
    roots
        .add(CertificateDer::from_pem_file(certificate(trusted)).unwrap())
        .unwrap();
    let provider = Arc::new(ring::default_provider());
    let mut config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    config.alpn_protocols = vec![protocol.to_vec()];
    let name = ServerName::try_from("localhost").unwrap();
    TlsConnector::from(Arc::new(config))
        .connect(name, server.connect().await)
        .await
}

#[tokio::test(flavor = "multi_thread")]
async fn tls_with_both_versions_and_certificates_that_change() {
    let folder = folder();
    let (chain, key) = (folder.path().join("site.pem"), folder.path().join("site.key"));
    let install = |name: &str| {
        std::fs::copy(certificate(&format!("{name}.key")), &key).unwrap();
        std::fs::copy(certificate(&format!("{name}.pem")), &chain).unwrap();
    };
    install("first");
    let tls = Tls::new(&chain, &key).unwrap();
    let site = Site::from(Collection::open(folder.path()).unwrap()).with_tls(tls);
    let options = Options {
        header_timeout: Duration::from_millis(500),
        ..Options::default()
    };
    let server = Server::of(site, options).await;

    let stream = connect(&server, "first.pem", b"h2").await.unwrap();
    assert_eq!(stream.get_ref().1.alpn_protocol(), Some(&b"h2"[..]));
    let sender = http2(stream).await;
    assert_eq!(
        get(sender.clone(), "/v1/large.bsvtf").await.1,
        large_archive(3 << 20)
    );

    let mut stream = connect(&server, "first.pem", b"http/1.1").await.unwrap();
    stream
        .write_all(b"GET /health HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n")
        .await
        .unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.unwrap();
    assert!(answer.starts_with(b"HTTP/1.1 200") && answer.ends_with(b"ok\n"));

    // Not TLS, and nothing at all.
    let mut plain = server.connect().await;
    plain.write_all(b"GET /health HTTP/1.1\r\n\r\n").await.unwrap();
    let mut silent = server.connect().await;
    for stream in [&mut plain, &mut silent] {
        let mut got = Vec::new();
        let _ = timeout(PATIENCE, stream.read_to_end(&mut got))
            .await
            .expect("the server hangs up");
        assert!(!got.starts_with(b"HTTP"));
    }

    // A certificate that does not fit its key changes nothing, the right one does.
    std::fs::copy(certificate("second.pem"), &chain).unwrap();
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert!(connect(&server, "first.pem", b"h2").await.is_ok());
    install("second");
    let renewed = async {
        while connect(&server, "second.pem", b"h2").await.is_err() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    timeout(PATIENCE, renewed).await.expect("the new certificate");
    assert!(connect(&server, "first.pem", b"h2").await.is_err());
    assert_eq!(
        get(sender, "/health").await.0,
        200,
        "connections from before go on"
    );
    server.stop().await;
}

#[test]
fn certificates_that_do_not_fit_are_refused() {
    for (chain, key) in [
        ("first.pem", "second.key"),
        ("first.key", "first.key"),
        ("no.pem", "first.key"),
    ] {
        let error = Tls::new(certificate(chain), certificate(key))
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("TLS cannot be set up"), "{error}");
    }
}
