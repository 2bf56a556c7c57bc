//! Buckets and web servers, through the crate `object_store`.

use std::{ops::Range, sync::Arc};

use futures_util::{StreamExt, TryStreamExt};
use object_store::{
    GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt, ObjectStoreScheme, parse_url_opts,
    path::Path,
};

use super::{Answer, Found, Identity, Kind, Listed, Store, StoreError, Version, archive_name};
use crate::{Error, Result};

/// Objects that are looked at in a list; those behind are not found.
const MAX_LISTED: usize = 100_000;
/// Variables of the environment that configure stores begin with one of these.
const PREFIXES: [&str; 3] = ["AWS_", "GOOGLE_", "AZURE_"];
/// Begins variables for all stores, such as `EIGENTILE_STORE_PROXY_URL`.
const OWN_PREFIX: &str = "EIGENTILE_STORE_";

/// Archives of an object store, and what is served beside them: those directly under a prefix, or a single archive.
pub struct Objects {
    store: Arc<dyn ObjectStore>,
    place: Place,
}

enum Place {
    /// All objects directly under it.
    Prefix(Path),
    /// One archive; there may be no way to list others, as on a plain web server.
    One(Path),
}

impl Objects {
    /// From a URL: `s3://bucket/prefix`, `gs://bucket/prefix`, `az://container/prefix`, `http(s)://host/folder` of a
    /// WebDAV server, or any of them with `NAME.bsvtf` at its end for that archive alone, which a plain web
    /// server will do for. Credentials, region and endpoint come from the environment, under the names that the
    /// stores' own tools use (`AWS_…`, `GOOGLE_…`, `AZURE_…`).
    ///
    /// # Errors
    /// [`Error::Source`] if the URL or the environment is not enough to reach a store. Nothing is sent yet.
    pub fn from_url(url: &str) -> Result<Self> {
        let settings = std::env::vars_os().filter_map(|(name, value)| {
            let (name, value) = (name.into_string().ok()?, value.into_string().ok()?);
            let own = name.strip_prefix(OWN_PREFIX).map(str::to_owned);
            let known = PREFIXES.iter().any(|prefix| name.starts_with(prefix));
            own.or(known.then_some(name)).map(|name| (name, value))
        });
        Self::with_settings(url, settings)
    }

    /// As [`Self::from_url`], with settings by name, such as `aws_endpoint`, in the place of the environment.
    ///
    /// # Errors
    /// [`Error::Source`] if the URL or the settings are not enough to reach a store.
    pub fn with_settings(url: &str, settings: impl IntoIterator<Item = (String, String)>) -> Result<Self> {
        let refuse = |reason: String| Error::Source {
            url: without_secrets(url),
            reason,
        };
        let parsed = url.parse().map_err(|error| refuse(format!("{error}")))?;
        let (scheme, _) = ObjectStoreScheme::parse(&parsed).map_err(|error| refuse(error.to_string()))?;
        if matches!(scheme, ObjectStoreScheme::Local | ObjectStoreScheme::Memory) {
            return Err(refuse("a folder is given by its path".into()));
        }
        // Who writes http:// means it.
        let plain = url
            .starts_with("http://")
            .then(|| ("allow_http".to_owned(), "true".to_owned()));
        let (store, path) = parse_url_opts(&parsed, settings.into_iter().chain(plain))
            .map_err(|error| refuse(error.to_string()))?;
        Ok(Self::new(store.into(), path))
    }

    /// From a store that is there already.
    pub fn new(store: Arc<dyn ObjectStore>, path: Path) -> Self {
        let place = if path.filename().and_then(archive_name).is_some() {
            Place::One(path)
        } else {
            Place::Prefix(path)
        };
        Self { store, place }
    }

    /// Where a file lies. Names come from a list, never from clients.
    fn location(&self, file: &str) -> Path {
        match &self.place {
            Place::One(path) => path.clone(),
            Place::Prefix(prefix) => prefix.clone().join(file),
        }
    }
}

/// A URL for messages: what stands before an `@` or behind a `?` may be secret.
fn without_secrets(url: &str) -> String {
    let url = url.split(['?', '#']).next().unwrap_or_default();
    match (url.split_once("://"), url.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://{host}"),
        _ => url.to_owned(),
    }
}

impl Store for Objects {
    fn list(&self) -> Answer<'_, Vec<Listed>> {
        Box::pin(async move {
            let prefix = match &self.place {
                Place::One(path) => {
                    return match self.store.head(path).await {
                        Ok(meta) => Ok(vec![listed(
                            path.filename().unwrap_or_default().to_owned(),
                            &meta,
                        )]),
                        Err(error) => match of_store(error) {
                            StoreError::NotFound => Ok(Vec::new()),
                            error => Err(error),
                        },
                    };
                }
                Place::Prefix(prefix) => prefix,
            };
            let mut objects = self.store.list(Some(prefix)).take(MAX_LISTED);
            let mut found = Found::new();
            while let Some(meta) = objects.try_next().await.map_err(of_store)? {
                let file = {
                    let Some(mut rest) = meta.location.prefix_match(prefix) else {
                        continue;
                    };
                    let (Some(file), None) = (rest.next(), rest.next()) else {
                        continue; // Deeper.
                    };
                    file.as_ref().to_owned()
                };
                // A name that the path escapes would be another object's.
                if Kind::of(&file).is_some() && self.location(&file) == meta.location {
                    found.add(&file, meta);
                }
            }
            let all = found.all().into_iter();
            Ok(all.map(|(file, meta)| listed(file, &meta)).collect())
        })
    }

    fn open<'a>(&'a self, file: &'a str) -> Answer<'a, Arc<dyn Version>> {
        Box::pin(async move {
            let meta = self.store.head(&self.location(file)).await.map_err(of_store)?;
            let identity = identity(&meta);
            let store = Arc::clone(&self.store);
            Ok(Arc::new(ObjectVersion {
                store,
                meta,
                identity,
            }) as Arc<dyn Version>)
        })
    }
}

fn listed(file: String, meta: &ObjectMeta) -> Listed {
    Listed {
        file,
        identity: Ok(identity(meta)),
        bytes: meta.size,
    }
}

/// What the store itself tells contents apart by. Times only where there is no ETag, and to the second: lists
/// and heads of one object may give them in different resolutions.
fn identity(meta: &ObjectMeta) -> Identity {
    match &meta.e_tag {
        Some(tag) => Identity::new(format!("{tag}-{}", meta.size)),
        None => Identity::new(format!("{}-{}", meta.last_modified.timestamp(), meta.size)),
    }
}

/// An object as it was when it was opened. Reads are conditional: of a successor they get nothing.
struct ObjectVersion {
    store: Arc<dyn ObjectStore>,
    meta: ObjectMeta,
    identity: Identity,
}

impl Version for ObjectVersion {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn bytes(&self) -> u64 {
        self.meta.size
    }

    fn read(&self, range: Range<u64>) -> Answer<'_, Vec<u8>> {
        Box::pin(async move {
            let mut options = GetOptions {
                range: Some(GetRange::Bounded(range.clone())),
                ..Default::default()
            };
            match &self.meta.e_tag {
                // A condition takes strong ETags only (RFC 9110, section 13.1.1).
                Some(tag) if !tag.starts_with("W/") => options.if_match = Some(tag.clone()),
                _ => options.if_unmodified_since = Some(self.meta.last_modified),
            }
            let result = self
                .store
                .get_opts(&self.meta.location, options)
                .await
                .map_err(of_store)?;
            // Not all that answer to a condition heed it.
            let other = |tag: &String| self.meta.e_tag.as_ref().is_some_and(|own| own != tag);
            if result.meta.size != self.meta.size || result.meta.e_tag.as_ref().is_some_and(other) {
                return Err(StoreError::Changed);
            }
            if result.range != range {
                let detail = format!("bytes {:?} came where {range:?} were asked for", result.range);
                return Err(StoreError::Unavailable(detail));
            }
            let length = (range.end - range.start) as usize;
            let mut bytes = Vec::with_capacity(length);
            let mut parts = result.into_stream();
            while let Some(part) = parts.try_next().await.map_err(of_store)? {
                if part.len() > length - bytes.len() {
                    return Err(StoreError::Unavailable(format!("more than {length} bytes came")));
                }
                bytes.extend_from_slice(&part);
            }
            if bytes.len() != length {
                let detail = format!("{} bytes came where {length} were asked for", bytes.len());
                return Err(StoreError::Unavailable(detail));
            }
            Ok(bytes)
        })
    }
}

fn of_store(error: object_store::Error) -> StoreError {
    use object_store::Error as E;
    match error {
        E::NotFound { .. } => StoreError::NotFound,
        E::Precondition { .. } => StoreError::Changed,
        E::Generic { .. } | E::JoinError { .. } => StoreError::Unavailable(error.to_string()),
        _ => StoreError::Refused(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_of_stores() {
        for (url, says) in [
            ("file:///etc", "by its path"),
            ("memory:///", "by its path"),
            ("ftp://host/x", "ftp"),
            ("s3:", "s3"),
        ] {
            let error = Objects::from_url(url).err().unwrap().to_string();
            assert!(error.contains(says), "{url}: {error}");
        }
        assert!(matches!(
            Objects::from_url("http://127.0.0.1:1/tiles/cloth.bsvtf").unwrap().place,
            Place::One(path) if path.filename() == Some("cloth.bsvtf")
        ));
        assert_eq!(without_secrets("https://me:pass@host/x?sig=1"), "https://host/x");
        assert_eq!(without_secrets("s3://bucket/x"), "s3://bucket/x");
    }
}
