//! What is served beside archives: thumbnails and scenes of the folder, and a web page at the root.

mod common;

use std::path::Path;

use common::{Response, Server, archive, replace};
use tileserver::{Collection, Options, Site, StaticFiles};

const GLTF: &[u8] = br#"{"asset":{"version":"2.0"},"buffers":[{"uri":"table.bin","byteLength":4}]}"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("cloth.bsvtf", &archive(1));
    write("cloth.png", b"first picture");
    write("table.gltf", GLTF);
    write("table.bin", b"0123");
    write("table.jpg", b"of the table");
    write("page.html", b"<script>");
    write(".hidden.png", b"hidden");
    folder
}

async fn catalogue(server: &Server) -> serde_json::Value {
    server.get("/v1/").await.json()
}

#[tokio::test(flavor = "multi_thread")]
async fn thumbnails_and_scenes_are_listed_and_served() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let listed = catalogue(&server).await;
    let (cloth, table) = (&listed["archives"][0], &listed["scenes"][0]);
    assert_eq!(
        (&cloth["title"], &cloth["width"], &cloth["components"]),
        (&"test 1".into(), &150.into(), &6.into())
    );
    assert_eq!(
        (&table["name"], &table["bytes"]),
        (&"table".into(), &GLTF.len().into())
    );
    assert_eq!(listed["scenes"].as_array().unwrap().len(), 1);

    let address = |url: &serde_json::Value| format!("/v1/{}", url.as_str().unwrap());
    let thumbnail = server.get(&address(&cloth["thumbnail"])).await;
    assert_eq!(
        (thumbnail.status, &thumbnail.body[..]),
        (200, &b"first picture"[..])
    );
    assert_eq!(thumbnail.field("content-type"), "image/png");
    assert_eq!(
        thumbnail.field("cache-control"),
        "public, max-age=31536000, immutable"
    );
    assert_eq!(thumbnail.field("x-content-type-options"), "nosniff");
    let known = [("if-none-match", thumbnail.field("etag"))];
    assert_eq!(
        server
            .request("GET", &address(&cloth["thumbnail"]), &known)
            .await
            .status,
        304
    );
    assert_eq!(
        server.get(&address(&table["thumbnail"])).await.body,
        b"of the table"
    );

    let scene = server.get(&address(&table["url"])).await;
    assert_eq!(
        (scene.field("content-type"), &scene.body[..]),
        ("model/gltf+json", GLTF)
    );
    assert_eq!(scene.field("cache-control"), "public, max-age=5, must-revalidate");
    // As its own relative address leads to it.
    let data = server.get("/v1/files/table.bin").await;
    assert_eq!(
        (data.field("content-type"), &data.body[..]),
        ("application/octet-stream", &b"0123"[..])
    );
    let part = server
        .request("GET", "/v1/files/table.bin", &[("range", "bytes=1-2")])
        .await;
    assert_eq!(
        (part.status, part.field("content-range"), &part.body[..]),
        (206, "bytes 1-2/4", &b"12"[..])
    );
    let head = server.request("HEAD", "/v1/files/table.bin", &[]).await;
    assert_eq!((head.field("content-length"), head.body.len()), ("4", 0));
    let parts = server
        .request("GET", "/v1/files/table.jpg", &[("range", "bytes=0-0,2-3")])
        .await;
    assert!(
        String::from_utf8_lossy(&parts.body)
            .contains("content-type: image/jpeg\r\ncontent-range: bytes 2-3/12")
    );
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_thumbnail_that_changes_has_another_address() {
    let folder = folder();
    let server = Server::start(folder.path()).await;
    let address = async || {
        catalogue(&server).await["archives"][0]["thumbnail"]
            .as_str()
            .map(str::to_owned)
    };
    let first = address().await.unwrap();
    replace(&folder.path().join("cloth.png"), b"second picture");
    server.get(&format!("/v1/{first}")).await.error(410, "gone");
    let second = address().await.unwrap();
    assert_ne!(first, second);
    assert_eq!(server.get(&format!("/v1/{second}")).await.body, b"second picture");
    assert_eq!(server.get("/v1/files/cloth.png").await.body, b"second picture");
    std::fs::write(folder.path().join("cloth.webp"), b"smaller").unwrap();
    assert!(address().await.unwrap().ends_with("/cloth.webp"));
    for name in ["cloth.webp", "cloth.png"] {
        std::fs::remove_file(folder.path().join(name)).unwrap();
    }
    assert_eq!(address().await, None);
    server.get(&format!("/v1/{second}")).await.error(404, "not-found");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_else_of_the_folder_is_served() {
    let folder = folder();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/etc/passwd", folder.path().join("link.bin")).unwrap();
        std::os::unix::fs::symlink("/etc/passwd", folder.path().join("link.png")).unwrap();
    }
    let server = Server::start(folder.path()).await;
    for name in [
        "page.html",
        ".hidden.png",
        "link.bin",
        "link.png",
        "cloth.bsvtf",
        "..%2fcloth.png",
        "%2e%2e/files/cloth.png",
        "no.png",
        "cloth.png/",
        "cloth.png%00",
    ] {
        let answer = server.get(&format!("/v1/files/{name}")).await;
        assert!(matches!(answer.status, 400 | 404), "{name}: {answer:?}");
    }
    for hash in ["0".repeat(32), String::new(), "x".into()] {
        let answer = server.get(&format!("/v1/files/{hash}/cloth.png")).await;
        assert!(matches!(answer.status, 404 | 410), "{hash}: {answer:?}");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn files_need_the_token_of_their_collection() {
    let folder = folder();
    let closed = Collection::open(folder.path())
        .unwrap()
        .with_tokens(vec!["one".into()]);
    let server = Server::of(closed, Options::default()).await;
    server.get("/v1/files/cloth.png").await.error(401, "unauthorized");
    let answer = server
        .request("GET", "/v1/files/cloth.png", &[("authorization", "Bearer one")])
        .await;
    assert_eq!(
        answer.field("cache-control"),
        "private, max-age=5, must-revalidate"
    );
    server.stop().await;
}

fn page(folder: &Path) -> StaticFiles {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    write("index.html", b"<!doctype html>");
    write("module.wasm", b"plain");
    write("module.wasm.br", b"brotli");
    write("module.wasm.gz", b"gzip");
    write("viewer-0123abcd.js", b"script");
    // The service's own addresses come first.
    std::fs::create_dir_all(folder.join("v1")).unwrap();
    write("v1/index.html", b"no catalogue");
    write("health", b"no health");
    StaticFiles::from_folder(folder).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_web_page_is_served_at_the_root() {
    let (folder, pages) = (folder(), tempfile::tempdir().unwrap());
    let collection = Collection::open(folder.path()).unwrap();
    let site = Site::from(collection).with_static_files(page(pages.path()));
    let server = Server::of(site, Options::default()).await;
    let index = server.get("/").await;
    assert_eq!((index.status, &index.body[..]), (200, &b"<!doctype html>"[..]));
    assert_eq!(index.field("content-type"), "text/html; charset=utf-8");
    assert_eq!(index.field("cache-control"), "public, max-age=5, must-revalidate");
    assert!(
        index
            .field("content-security-policy")
            .contains("script-src 'self' 'wasm-unsafe-eval'")
    );
    assert!(!index.fields.contains_key("vary"));
    assert_eq!(server.get("/index.html").await.body, index.body);
    assert_eq!(
        server.request("HEAD", "/", &[]).await.field("content-length"),
        "15"
    );
    let script = server.get("/viewer%2D0123abcd.js").await;
    assert_eq!(
        script.field("cache-control"),
        "public, max-age=31536000, immutable"
    );
    let module = async |encodings: &str| -> Response {
        let answer = server
            .request("GET", "/module.wasm", &[("accept-encoding", encodings)])
            .await;
        assert_eq!(
            (
                answer.field("content-type"),
                answer.field("vary").contains("accept-encoding")
            ),
            ("application/wasm", true)
        );
        answer
    };
    for (encodings, coding, body) in [
        ("gzip, deflate, br", Some("br"), "brotli"),
        ("gzip", Some("gzip"), "gzip"),
        ("br;q=0, gzip", Some("gzip"), "gzip"),
        ("identity", None, "plain"),
    ] {
        let answer = module(encodings).await;
        assert_eq!(answer.fields.get("content-encoding").map(String::as_str), coding);
        assert_eq!(answer.body, body.as_bytes());
        let known = [
            ("accept-encoding", encodings),
            ("if-none-match", answer.field("etag")),
        ];
        assert_eq!(server.request("GET", "/module.wasm", &known).await.status, 304);
    }
    assert_ne!(
        module("br").await.field("etag"),
        module("gzip").await.field("etag")
    );

    server.get("/v1/").await.json()["archives"].as_array().unwrap();
    assert_eq!(server.get("/health").await.body, b"ok\n");
    server
        .request("POST", "/", &[])
        .await
        .error(405, "method-not-allowed");
    for path in [
        "/module.wasm.br",
        "/no",
        "/../index.html",
        "/%2e%2e/index.html",
        "//index.html",
        "/%",
        "/%ff",
        "/v2/",
    ] {
        server.get(path).await.error(404, "not-found");
    }
    server.stop().await;
}
