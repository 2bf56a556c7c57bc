//! The JSON documents: catalogue and manifest. Addresses in them are relative to `/v1/`, so that a proxy may put
//! the service under any prefix.

use std::{collections::BTreeMap, io::Write};

use bytes::Bytes;
use flate2::{Compression, write::GzEncoder};
use serde::Serialize;
use tileset::{Manifest, Record, archive::Index};
use xxhash_rust::xxh3::xxh3_128;

use crate::{
    answer::Keep,
    beside::{self, Beside},
    collection::{Entry, Served},
    store::Kind,
};

/// A document, plain and compressed, once for all who ask for it.
pub(crate) struct Document {
    /// Media type.
    pub(crate) kind: &'static str,
    pub(crate) keep: Keep,
    pub(crate) plain: Encoded,
    pub(crate) gzip: Option<Encoded>,
    pub(crate) brotli: Option<Encoded>,
}

/// A form of a document, and its strong ETag: other bytes have another one.
pub(crate) struct Encoded {
    pub(crate) bytes: Bytes,
    pub(crate) etag: String,
}

#[derive(Serialize)]
struct Catalogue<'a> {
    archives: Vec<CatalogueEntry<'a>>,
    scenes: Vec<Scene<'a>>,
}

/// A scene beside the archives.
#[derive(Serialize)]
struct Scene<'a> {
    name: &'a str,
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    thumbnail: Option<String>,
    url: String,
}

#[derive(Serialize)]
#[serde(untagged)]
enum CatalogueEntry<'a> {
    Ready(Box<Summary<'a>>),
    Broken { name: &'a str, error: &'a str },
}

#[derive(Serialize)]
struct Summary<'a> {
    name: &'a str,
    title: &'a str,
    id: String,
    bytes: u64,
    width: u32,
    height: u32,
    views: usize,
    lights: usize,
    components: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    thumbnail: Option<String>,
    urls: Urls,
}

#[derive(Serialize)]
struct ManifestDocument<'a> {
    name: &'a str,
    id: String,
    bytes: u64,
    index_bytes: u64,
    page_bytes: u64,
    column_bytes: u64,
    largest_page_bytes: u32,
    largest_column_bytes: u32,
    groups: u32,
    pages: usize,
    mips: Vec<Mip>,
    urls: Urls,
    manifest: &'a Manifest,
}

/// A mip with pages of its own; the last one is the packed tail.
#[derive(Serialize)]
struct Mip {
    mip: u8,
    width: u32,
    height: u32,
    columns: u32,
    rows: u32,
}

/// Addresses, or templates of addresses, relative to `/v1/`.
#[derive(Serialize)]
struct Urls {
    manifest: String,
    index: String,
    page: String,
    column: String,
    batch: String,
    archive: String,
}

impl Urls {
    fn new(name: &str, id: &str) -> Self {
        let name = escape(name);
        Self {
            manifest: name.clone(),
            index: format!("{name}/{id}/index"),
            page: format!("{name}/{id}/page/{{group}}/{{mip}}/{{x}}/{{y}}"),
            column: format!("{name}/{id}/column/{{group}}"),
            batch: format!("{name}/{id}/batch/{{records}}"),
            archive: format!("{name}.bsvtf"),
        }
    }
}

/// All but unreserved characters escaped (RFC 3986, section 2.3).
fn escape(name: &str) -> String {
    let mut escaped = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => escaped.push(byte.into()),
            _ => escaped.push_str(&format!("%{byte:02X}")),
        }
    }
    escaped
}

/// The address of a thumbnail, which caches may keep for good.
fn thumbnail(files: &BTreeMap<String, Beside>, stem: &str) -> Option<String> {
    let (file, hash) = beside::thumbnail(files, stem)?;
    Some(format!("files/{hash:032x}/{}", escape(&file)))
}

fn summary<'a>(served: &'a Served, files: &BTreeMap<String, Beside>) -> Summary<'a> {
    let Index {
        manifest, file_bytes, ..
    } = &served.index;
    let id = served.id();
    Summary {
        name: &served.name,
        title: &manifest.name,
        thumbnail: thumbnail(files, &served.name),
        bytes: *file_bytes,
        width: manifest.width,
        height: manifest.height,
        views: manifest.views.len(),
        lights: manifest.lights.len(),
        components: manifest.components,
        urls: Urls::new(&served.name, &id),
        id,
    }
}

/// The catalogue of a collection.
pub(crate) fn catalogue(archives: &BTreeMap<String, Entry>, files: &BTreeMap<String, Beside>) -> Document {
    let archives = archives.iter().map(|(name, entry)| match entry {
        Entry::Ready(served) => CatalogueEntry::Ready(Box::new(summary(served, files))),
        Entry::Broken { error, .. } => CatalogueEntry::Broken { name, error },
    });
    let scenes = files.iter().filter(|(_, file)| file.kind == Kind::Scene);
    let scenes = scenes.filter_map(|(file, beside)| {
        let name = beside::stem(file)?;
        Some(Scene {
            name,
            bytes: beside.bytes,
            thumbnail: thumbnail(files, name),
            url: format!("files/{}", escape(file)),
        })
    });
    json(&Catalogue {
        archives: archives.collect(),
        scenes: scenes.collect(),
    })
}

/// The manifest document of an archive.
pub(crate) fn manifest(name: &str, index: &Index, index_bytes: u64) -> Document {
    let id = format!("{:032x}", index.id);
    let total = |records: &[Record]| records.iter().map(|record| u64::from(record.length)).sum();
    let largest = |records: &[Record]| records.iter().map(|record| record.length).max().unwrap_or(0);
    let mip = |mip| {
        let ((width, height), (columns, rows)) = (index.pyramid.mip_size(mip), index.pyramid.grid(mip));
        Mip {
            mip,
            width,
            height,
            columns,
            rows,
        }
    };
    json(&ManifestDocument {
        name,
        bytes: index.file_bytes,
        index_bytes,
        page_bytes: total(index.pages()),
        column_bytes: total(index.columns()),
        largest_page_bytes: largest(index.pages()),
        largest_column_bytes: largest(index.columns()),
        groups: index.manifest.groups(),
        pages: index.pages().len(),
        mips: (0..=index.pyramid.tail_mip()).map(mip).collect(),
        urls: Urls::new(name, &id),
        id,
        manifest: &index.manifest,
    })
}

fn json(document: &impl Serialize) -> Document {
    // Only maps with keys that are no strings, and writers that fail, can fail here: there are none.
    let plain = serde_json::to_vec(document).unwrap_or_default();
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    let gzip = gzip.write_all(&plain).and_then(|()| gzip.finish());
    Document {
        kind: "application/json",
        keep: Keep::Shortly,
        plain: Encoded::new(plain.into(), ""),
        gzip: gzip.ok().map(|bytes| Encoded::new(bytes.into(), "gz")),
        brotli: None,
    }
}

impl Encoded {
    /// A content, and its hash as ETag; `form` tells encodings apart.
    pub(crate) fn new(bytes: Bytes, form: &str) -> Self {
        let (hash, dash) = (xxh3_128(&bytes), if form.is_empty() { "" } else { "-" });
        Self {
            bytes,
            etag: format!("\"{hash:032x}{dash}{form}\""),
        }
    }
}
