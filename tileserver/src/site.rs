//! What one server serves: collections, each at its place, a web page at the root, and the certificate if there is one.

use crate::{Collection, Error, Result, StaticFiles, Tls};

/// Places that addresses of the server itself have.
const TAKEN: [&str; 4] = ["v1", "health", "ready", "metrics"];

/// Collections and their places.
#[derive(Default)]
pub struct Site {
    pub(crate) collections: Vec<(String, Collection)>,
    pub(crate) static_files: StaticFiles,
    pub(crate) tls: Option<Tls>,
}

impl Site {
    /// Adds a collection at `/PLACE/v1/`, or at `/v1/` if the place is empty.
    ///
    /// # Errors
    /// [`Error::Place`] if the place is taken or no single segment of unreserved characters.
    pub fn with(mut self, place: &str, collection: Collection) -> Result<Self> {
        let refuse = |reason| Err(Error::Place(place.to_owned(), reason));
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
        if !place.bytes().all(plain) {
            return refuse("letters, digits, - and _ only");
        }
        if TAKEN.contains(&place) || self.collections.iter().any(|(other, _)| other == place) {
            return refuse("that place is taken");
        }
        self.collections.push((place.to_owned(), collection));
        Ok(self)
    }

    /// Whether there is nothing to serve.
    pub fn is_empty(&self) -> bool {
        self.collections.is_empty()
    }

    /// Serves files at `/`, wherever nothing else has an address. They need no token.
    #[must_use]
    pub fn with_static_files(self, static_files: StaticFiles) -> Self {
        Self { static_files, ..self }
    }

    /// Serves with TLS only.
    #[must_use]
    pub fn with_tls(self, tls: Tls) -> Self {
        Self {
            tls: Some(tls),
            ..self
        }
    }
}

impl From<Collection> for Site {
    fn from(collection: Collection) -> Self {
        Self {
            collections: vec![(String::new(), collection)],
            ..Self::default()
        }
    }
}
