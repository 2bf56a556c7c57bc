//! TLS, with certificates that may be replaced while the service runs.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant, SystemTime},
};

use tokio_rustls::{
    TlsAcceptor,
    rustls::{
        self, ServerConfig,
        pki_types::{CertificateDer, PrivateKeyDer, pem::PemObject},
    },
};

use crate::{Error, Result};

/// How often the files are looked at.
const LOOK: Duration = Duration::from_secs(1);

/// A certificate and its key, from PEM files. When a file changes, new connections get the new certificate; until
/// both files fit together, the old one.
pub struct Tls {
    certificate: PathBuf,
    key: PathBuf,
    current: Mutex<Current>,
}

struct Current {
    config: Arc<ServerConfig>,
    times: [Option<SystemTime>; 2],
    looked: Instant,
}

impl Tls {
    /// Reads the chain of certificates, the server's own first, and the key.
    ///
    /// # Errors
    /// [`Error::Tls`] if they are not there, no PEM, or do not fit together.
    pub fn new(certificate: impl Into<PathBuf>, key: impl Into<PathBuf>) -> Result<Self> {
        let (certificate, key) = (certificate.into(), key.into());
        let current = Current {
            times: times(&certificate, &key),
            config: load(&certificate, &key)?,
            looked: Instant::now(),
        };
        Ok(Self {
            certificate,
            key,
            current: Mutex::new(current),
        })
    }

    /// For a new connection.
    pub(crate) fn acceptor(&self) -> TlsAcceptor {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if current.looked.elapsed() >= LOOK {
            current.looked = Instant::now();
            let times = times(&self.certificate, &self.key);
            if times != current.times {
                current.times = times;
                match load(&self.certificate, &self.key) {
                    Ok(config) => {
                        current.config = config;
                        tracing::info!("the certificate was read again");
                    }
                    Err(error) => tracing::error!(%error, "the certificate in use is kept"),
                }
            }
        }
        TlsAcceptor::from(Arc::clone(&current.config))
    }
}

fn times(certificate: &Path, key: &Path) -> [Option<SystemTime>; 2] {
    [certificate, key].map(|path| path.metadata().and_then(|metadata| metadata.modified()).ok())
}

fn load(certificate: &Path, key: &Path) -> Result<Arc<ServerConfig>> {
    let refuse = |path: &Path, reason: String| Error::Tls {
        path: path.to_owned(),
        reason,
    };
    let chain: Vec<_> = CertificateDer::pem_file_iter(certificate)
        .and_then(Iterator::collect)
        .map_err(|error| refuse(certificate, error.to_string()))?;
    let private = PrivateKeyDer::from_pem_file(key).map_err(|error| refuse(key, error.to_string()))?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, private));
    let mut config = config.map_err(|error| refuse(certificate, error.to_string()))?;
    config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    Ok(Arc::new(config))
}
