//! Connections to hosts, with TLS or without, and what can be said when one fails.

use std::{
    error::Error as _,
    path::Path,
    sync::{Arc, OnceLock},
    time::Duration,
};

use bytes::Bytes;
use http_body_util::{BodyExt, Empty};
use hyper::{HeaderMap, Request, Response, Uri, body::Incoming, header};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::{
    client::legacy::{Client, connect::HttpConnector},
    rt::{TokioExecutor, TokioTimer},
};
use tokio::time::timeout;
use tokio_rustls::rustls::{
    self, ClientConfig, RootCertStore,
    pki_types::{CertificateDer, pem::PemObject},
};

use super::{HttpOptions, redirection};
use crate::{Error, Result};

/// How long an unused connection is kept.
const IDLE_CONNECTION: Duration = Duration::from_secs(30);
/// Most bytes of a redirection's body that are read to use its connection again.
const MOST_DRAINED: usize = 16 << 10;

type HttpsClient = Client<HttpsConnector<HttpConnector>, Empty<Bytes>>;

/// Connections that are kept.
pub(super) struct Connections {
    options: HttpOptions,
    /// Certificates that are trusted besides those of the system.
    own_roots: Vec<CertificateDer<'static>>,
    plain: Client<HttpConnector, Empty<Bytes>>,
    /// Made when the first host with TLS is asked: reading what the system trusts takes a while.
    secure: OnceLock<std::result::Result<HttpsClient, String>>,
}

/// An answer's head, and what waits behind it.
pub(super) struct Reached {
    pub(super) response: Response<Incoming>,
    /// Bytes of all heads on the way there.
    pub(super) head_bytes: u64,
    /// GETs on the way there.
    pub(super) exchanges: u64,
}

impl Connections {
    /// # Errors
    /// [`Error::Source`] if there is a file of certificates and it holds none.
    pub(super) fn new(options: &HttpOptions) -> Result<Arc<Self>> {
        let own_roots = options.ca_file.as_deref().map_or(Ok(Vec::new()), read_roots)?;
        Ok(Arc::new(Self {
            plain: client(options, connector(options)),
            options: options.clone(),
            own_roots,
            secure: OnceLock::new(),
        }))
    }

    /// Sends a GET, and follows where the host sends it on to ([`redirection`]), with the same fields. Nothing on the way
    /// may be silent for longer than the options say.
    ///
    /// # Errors
    /// Why there is no answer, for people. Asking again may mend it.
    pub(super) async fn get(&self, url: &str, fields: &HeaderMap) -> std::result::Result<Reached, String> {
        let mut at: Uri = url.parse().map_err(|error| format!("no URL ({error})"))?;
        let (mut head_bytes, mut exchanges) = (0, 0);
        loop {
            let response = self.exchange(&at, fields).await?;
            head_bytes += self::head_bytes(&response);
            exchanges += 1;
            let location = response.headers().get(header::LOCATION);
            let next = redirection::target(&at, response.status(), location);
            match next.filter(|_| exchanges <= redirection::MOST) {
                Some(next) => at = next,
                None => {
                    return Ok(Reached {
                        response,
                        head_bytes,
                        exchanges,
                    });
                }
            }
            self.drain(response.into_body()).await;
        }
    }

    async fn exchange(
        &self,
        at: &Uri,
        fields: &HeaderMap,
    ) -> std::result::Result<Response<Incoming>, String> {
        let mut request = Request::get(at)
            .body(Empty::new())
            .map_err(|error| format!("no URL ({error})"))?;
        request.headers_mut().clone_from(fields);
        let sent = match at.scheme_str() {
            Some("https") => self.secure()?.request(request),
            _ => self.plain.request(request),
        };
        let response = timeout(self.options.silence, sent).await;
        response
            .map_err(|_| silent(self.options.silence))?
            .map_err(|error| unreachable(at, &error))
    }

    /// Reads a short body to its end.
    async fn drain(&self, mut body: Incoming) {
        let mut left = MOST_DRAINED;
        while let Ok(Some(Ok(frame))) = timeout(self.options.silence, body.frame()).await {
            match left.checked_sub(frame.data_ref().map_or(0, Bytes::len)) {
                Some(less) => left = less,
                None => return,
            }
        }
    }

    fn secure(&self) -> std::result::Result<&HttpsClient, String> {
        let made = self.secure.get_or_init(|| {
            let mut connector = connector(&self.options);
            connector.enforce_http(false);
            let connector = HttpsConnectorBuilder::new()
                .with_tls_config(tls(&self.own_roots)?)
                .https_only()
                .enable_http1()
                .wrap_connector(connector);
            Ok(client(&self.options, connector))
        });
        made.as_ref().map_err(Clone::clone)
    }
}

fn connector(options: &HttpOptions) -> HttpConnector {
    let mut connector = HttpConnector::new();
    connector.set_nodelay(true);
    connector.set_connect_timeout(Some(options.silence));
    connector
}

fn client<C>(options: &HttpOptions, connector: C) -> Client<C, Empty<Bytes>>
where
    C: hyper_util::client::legacy::connect::Connect + Clone,
{
    Client::builder(TokioExecutor::new())
        .pool_timer(TokioTimer::new())
        .pool_idle_timeout(IDLE_CONNECTION)
        .pool_max_idle_per_host(options.connections)
        .build(connector)
}

/// Trusts what the system trusts, and these certificates.
fn tls(own: &[CertificateDer<'static>]) -> std::result::Result<ClientConfig, String> {
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
    roots.add_parsable_certificates(own.iter().cloned());
    if roots.is_empty() {
        return Err(
            "this system says of no certificate that it is trusted: install them (ca-certificates), or give a file \
             with --ca-file"
                .into(),
        );
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| format!("no TLS ({error})"))?;
    Ok(config.with_root_certificates(roots).with_no_client_auth())
}

fn read_roots(path: &Path) -> Result<Vec<CertificateDer<'static>>> {
    let read: std::result::Result<Vec<_>, _> =
        CertificateDer::pem_file_iter(path).and_then(Iterator::collect);
    let refuse = |detail: String| Error::Source {
        what: format!("certificates in {}", path.display()),
        detail: format!("{detail}: give a PEM file with the certificates of authorities"),
    };
    match read {
        Ok(roots) if roots.is_empty() => Err(refuse("there are none".into())),
        Ok(roots) => Ok(roots),
        Err(error) => Err(refuse(error.to_string())),
    }
}

/// Fields of a GET; `anew`: caches on the way are to ask the host.
pub(super) fn fields(anew: bool) -> HeaderMap {
    let mut fields = HeaderMap::new();
    if anew {
        fields.insert(
            header::CACHE_CONTROL,
            header::HeaderValue::from_static("no-cache"),
        );
    }
    fields
}

/// Why there is no answer at all: the innermost reason, and what to do.
fn unreachable(uri: &Uri, error: &hyper_util::client::legacy::Error) -> String {
    let mut reason = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        reason = error.to_string();
        source = error.source();
    }
    let server = uri
        .authority()
        .map_or("the server", |authority| authority.as_str());
    if reason.contains("certificate") {
        format!(
            "the certificate of {server} is not trusted ({reason}): if you trust whoever has signed it, give their \
             certificate with --ca-file"
        )
    } else if error.is_connect() {
        format!(
            "no connection to {server} ({reason}): check that the server runs (eigentile serve DIR --listen \
             HOST:PORT) and that the address given with --tiles is its address"
        )
    } else {
        format!("the connection to {server} failed ({reason})")
    }
}

pub(super) fn silent(silence: Duration) -> String {
    format!("no answer for {} s", silence.as_secs_f64())
}

pub(super) fn broken_off(error: &hyper::Error) -> String {
    format!("the answer broke off ({error})")
}

/// Bytes of status line and header fields, as they stand on an HTTP/1.1 wire.
fn head_bytes(response: &Response<Incoming>) -> u64 {
    let status_line =
        "HTTP/1.1 200 \r\n\r\n".len() + response.status().canonical_reason().map_or(0, str::len);
    let fields = response
        .headers()
        .iter()
        .map(|(name, value)| name.as_str().len() + value.len() + 4);
    (status_line + fields.sum::<usize>()) as u64
}
