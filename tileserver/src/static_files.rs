//! Files of a web page, such as a viewer's: read once, kept in memory, found by their path.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use bytes::Bytes;

use crate::{
    Error, Result,
    answer::Keep,
    documents::{Document, Encoded},
};

/// Most files of a folder, and of all their bytes together.
const MAX_FILES: usize = 2048;
const MAX_BYTES: u64 = 256 << 20;
/// Deepest folder inside the folder.
const MAX_DEPTH: usize = 8;
/// What a folder's own address answers.
const INDEX: &str = "index.html";

/// Media types by ending. Everything else is bytes, which browsers do not run.
const TYPES: [(&str, &str); 19] = [
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("mjs", "text/javascript; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("wasm", "application/wasm"),
    ("json", "application/json"),
    ("map", "application/json"),
    ("webmanifest", "application/manifest+json"),
    ("svg", "image/svg+xml"),
    ("png", "image/png"),
    ("jpg", "image/jpeg"),
    ("jpeg", "image/jpeg"),
    ("webp", "image/webp"),
    ("ico", "image/vnd.microsoft.icon"),
    ("txt", "text/plain; charset=utf-8"),
    ("md", "text/plain; charset=utf-8"),
    ("ts", "text/plain; charset=utf-8"),
    ("gltf", "model/gltf+json"),
    ("woff2", "font/woff2"),
];

/// Files by their path below `/`.
///
/// Besides `viewer.js` there may be `viewer.js.br` and `viewer.js.gz`, which those get who take them. Files whose name
/// has a hash of at least eight hexadecimal digits, as in `viewer-0123abcd.js`, are kept by caches for good.
#[derive(Default)]
pub struct StaticFiles {
    files: BTreeMap<String, Document>,
}

impl StaticFiles {
    /// From paths, such as `index.html` or `images/logo.svg`, and contents.
    pub fn new(files: impl IntoIterator<Item = (String, impl Into<Bytes>)>) -> Self {
        let files: BTreeMap<String, Bytes> = files
            .into_iter()
            .map(|(path, bytes)| (path, bytes.into()))
            .collect();
        let encoded = |path: &str, ending: &str| {
            let bytes = files.get(&format!("{path}.{ending}"))?;
            Some(Encoded::new(bytes.clone(), ending))
        };
        let is_encoded = |path: &str| {
            let plain = path.strip_suffix(".br").or(path.strip_suffix(".gz"));
            plain.is_some_and(|plain| files.contains_key(plain))
        };
        let documents = files
            .iter()
            .filter(|(path, _)| !is_encoded(path))
            .map(|(path, bytes)| {
                let document = Document {
                    kind: media_type(path),
                    keep: if is_hashed(path) {
                        Keep::ForGood
                    } else {
                        Keep::Shortly
                    },
                    plain: Encoded::new(bytes.clone(), ""),
                    gzip: encoded(path, "gz"),
                    brotli: encoded(path, "br"),
                };
                (path.clone(), document)
            });
        Self {
            files: documents.collect(),
        }
    }

    /// Reads a folder and the folders in it, without what is hidden and without links that lead out of it. What changes later is not
    /// seen.
    ///
    /// # Errors
    /// [`Error::Pages`] if it cannot be read, has no `index.html`, or holds more than a web page should.
    pub fn from_folder(folder: impl AsRef<Path>) -> Result<Self> {
        let refuse = |source| Error::Pages {
            path: folder.as_ref().to_owned(),
            source,
        };
        let other = |text: String| refuse(std::io::Error::other(text));
        let root = folder.as_ref().canonicalize().map_err(refuse)?;
        let (mut files, mut total) = (Vec::new(), 0);
        let mut folders: Vec<(PathBuf, String, usize)> = vec![(root.clone(), String::new(), 0)];
        while let Some((path, prefix, depth)) = folders.pop() {
            for entry in fs::read_dir(&path).map_err(refuse)? {
                let entry = entry.map_err(refuse)?;
                let Some(name) = entry.file_name().to_str().map(str::to_owned) else {
                    continue;
                };
                let inside = entry
                    .path()
                    .canonicalize()
                    .ok()
                    .filter(|path| path.starts_with(&root));
                let (false, Some(target)) = (name.starts_with('.'), inside) else {
                    continue;
                };
                let metadata = fs::metadata(&target).map_err(refuse)?;
                // Links to folders could go round in circles.
                let linked = entry.file_type().map_err(refuse)?.is_symlink();
                if metadata.is_dir() && depth < MAX_DEPTH && !linked {
                    folders.push((target, format!("{prefix}{name}/"), depth + 1));
                } else if metadata.is_file() {
                    total += metadata.len();
                    if files.len() == MAX_FILES || total > MAX_BYTES {
                        return Err(other(format!(
                            "more than {MAX_FILES} files or {} MiB: give the folder of a built web page",
                            MAX_BYTES >> 20
                        )));
                    }
                    files.push((format!("{prefix}{name}"), fs::read(&target).map_err(refuse)?));
                }
            }
        }
        if !files.iter().any(|(path, _)| path == INDEX) {
            return Err(other(format!("it has no {INDEX}")));
        }
        Ok(Self::new(files))
    }

    /// Whether there is nothing to serve.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// What an address's path, unescaped, stands for: no path of the system is made of it.
    pub(crate) fn find(&self, path: &str) -> Option<&Document> {
        let path = path.strip_prefix('/')?;
        if path.is_empty() || path.ends_with('/') {
            self.files.get(&format!("{path}{INDEX}"))
        } else {
            self.files.get(path)
        }
    }
}

fn media_type(path: &str) -> &'static str {
    let ending = path.rsplit_once('.').map_or("", |(_, ending)| ending);
    let known = TYPES.iter().find(|(known, _)| known.eq_ignore_ascii_case(ending));
    known.map_or("application/octet-stream", |(_, media)| media)
}

/// Whether a name has a hash of its content: eight or more lower case hexadecimal digits between dashes or dots, not all letters.
fn is_hashed(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or_default();
    let is_hash = |part: &str| {
        let digits = part.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
        part.len() >= 8 && digits && part.bytes().any(|byte| byte.is_ascii_digit())
    };
    name.split(['-', '.']).skip(1).any(is_hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_hashes() {
        for (path, expected) in [
            ("viewer-0123abcd.js", true),
            ("a/b/viewer.0123456789abcdef.wasm", true),
            ("viewer.js", false),
            ("viewer-0123abc.js", false),
            ("viewer-deadbeef.js", false),
            ("0123abcd.js", false),
            ("a-0123abcd/viewer.js", false),
            ("viewer-0123ABCD.js", false),
        ] {
            assert_eq!(is_hashed(path), expected, "{path}");
        }
    }

    #[test]
    fn paths_are_looked_up() {
        let file = |path: &str| (path.to_owned(), Bytes::from(path.to_owned()));
        let files =
            StaticFiles::new(["index.html", "a/index.html", "a/x.js", "a/x.js.br", "alone.gz"].map(file));
        for (path, found) in [
            ("/", Some("index.html")),
            ("/index.html", Some("index.html")),
            ("/a/", Some("a/index.html")),
            ("/a/x.js", Some("a/x.js")),
            ("/alone.gz", Some("alone.gz")),
            ("/a/x.js.br", None),
            ("/a", None),
            ("/a/../index.html", None),
            ("//index.html", None),
            ("index.html", None),
            ("", None),
        ] {
            let bytes = files.find(path).map(|document| &document.plain.bytes[..]);
            assert_eq!(bytes, found.map(str::as_bytes), "{path}");
        }
        let script = files.find("/a/x.js").unwrap();
        assert_eq!(script.kind, "text/javascript; charset=utf-8");
        assert!(
            script
                .brotli
                .as_ref()
                .is_some_and(|form| form.etag.ends_with("-br\""))
                && script.gzip.is_none()
        );
    }

    #[cfg(unix)]
    #[test]
    fn folders_are_read_and_nothing_outside() {
        use std::os::unix::fs::symlink;
        let root = tempfile::tempdir().unwrap();
        let site = root.path().join("site");
        fs::create_dir_all(site.join("inner")).unwrap();
        fs::write(root.path().join("secret.txt"), "secret").unwrap();
        assert!(
            StaticFiles::from_folder(&site)
                .err()
                .unwrap()
                .to_string()
                .contains("no index.html")
        );
        fs::write(site.join("index.html"), "page").unwrap();
        fs::write(site.join("inner/a.css"), "style").unwrap();
        fs::write(site.join(".hidden"), "hidden").unwrap();
        symlink("../secret.txt", site.join("out.txt")).unwrap();
        symlink("..", site.join("up")).unwrap();
        symlink(".", site.join("loop")).unwrap();
        symlink("index.html", site.join("also.html")).unwrap();
        let files = StaticFiles::from_folder(&site).unwrap();
        for path in ["/", "/inner/a.css", "/also.html"] {
            assert!(files.find(path).is_some(), "{path}");
        }
        for path in ["/out.txt", "/up/secret.txt", "/.hidden"] {
            assert!(files.find(path).is_none(), "{path}");
        }
    }
}
