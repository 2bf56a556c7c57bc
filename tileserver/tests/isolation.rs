//! Only archives directly in the folder can be reached, whatever a client sends.

mod common;

use common::{Server, archive};
use proptest::prelude::*;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

const SECRET: &str = "the secret outside of the folder";

/// A folder `root/served` with one archive, and files outside of it that nobody may see.
fn folders() -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    let served = root.path().join("served");
    std::fs::create_dir_all(served.join("inner")).unwrap();
    std::fs::write(served.join("cloth.bsvtf"), archive(1)).unwrap();
    std::fs::write(served.join("inner/hidden.bsvtf"), archive(2)).unwrap();
    std::fs::write(served.join(".dot.bsvtf"), archive(2)).unwrap();
    std::fs::write(served.join("notes.txt"), SECRET).unwrap();
    std::fs::write(root.path().join("secret.txt"), SECRET).unwrap();
    std::fs::write(root.path().join("outside.bsvtf"), archive(3)).unwrap();
    root
}

#[tokio::test(flavor = "multi_thread")]
async fn paths_do_not_lead_out() {
    let root = folders();
    let server = Server::start(&root.path().join("served")).await;
    let absolute = root.path().join("outside").to_str().unwrap().to_owned();
    let mut names = vec![
        "../outside",
        "..%2foutside",
        "%2e%2e/outside",
        "%2e%2e%2foutside",
        "..%5coutside",
        "..\\outside",
        "....//outside",
        "%252e%252e%252foutside",
        "..%00outside",
        "cloth%00",
        "./cloth",
        "cloth/",
        "cloth/.",
        "cloth/../../outside",
        "inner/hidden",
        "inner%2fhidden",
        ".dot",
        ".",
        "..",
        "%2e",
        "%2e%2e",
        "notes.txt",
        "../secret.txt",
        "",
        "cloth.bsvtf/../../secret.txt",
        "file:///etc/passwd",
        "~",
        "%c0%ae%c0%ae%c0%afoutside",
        "CLOTH",
        "cloth.bsvtf.bsvtf",
    ];
    let escaped = absolute.replace('/', "%2f");
    names.extend([&*absolute, &*escaped]);
    for name in names {
        for target in [
            format!("/v1/{name}"),
            format!("/v1/{name}.bsvtf"),
            format!("/{name}"),
            format!("/v1/{name}/{}/index", "0".repeat(32)),
        ] {
            if target == "/v1/" {
                continue; // The catalogue.
            }
            let answer = server.get(&target).await;
            assert!(matches!(answer.status, 400 | 404), "{target}: {answer:?}");
            assert!(!String::from_utf8_lossy(&answer.body).contains(SECRET));
        }
    }
    server.stop().await;
}

#[cfg(unix)]
#[tokio::test(flavor = "multi_thread")]
async fn links_are_followed_inside_the_folder_only() {
    use std::os::unix::fs::symlink;
    let root = folders();
    let served = root.path().join("served");
    symlink("cloth.bsvtf", served.join("alias.bsvtf")).unwrap();
    symlink("../outside.bsvtf", served.join("relative.bsvtf")).unwrap();
    symlink(root.path().join("outside.bsvtf"), served.join("absolute.bsvtf")).unwrap();
    symlink("inner/hidden.bsvtf", served.join("inner.bsvtf")).unwrap();
    symlink("relative.bsvtf", served.join("twice.bsvtf")).unwrap();
    symlink("nowhere.bsvtf", served.join("dangling.bsvtf")).unwrap();
    symlink("loop.bsvtf", served.join("loop.bsvtf")).unwrap();
    symlink("/dev/zero", served.join("device.bsvtf")).unwrap();
    symlink("..", served.join("parent.bsvtf")).unwrap();
    let server = Server::start(&served).await;
    assert_eq!(server.get("/v1/alias").await.status, 200);
    for name in [
        "relative", "absolute", "inner", "twice", "dangling", "loop", "device", "parent",
    ] {
        for target in [format!("/v1/{name}"), format!("/v1/{name}.bsvtf")] {
            let detail = server.get(&target).await.error(500, "corrupt");
            assert!(detail.contains("symbolic link"), "{target}: {detail}");
            assert!(!detail.contains(root.path().to_str().unwrap()), "{detail}");
        }
    }
    // A file that is replaced by a link while it is served.
    std::fs::remove_file(served.join("cloth.bsvtf")).unwrap();
    symlink("../outside.bsvtf", served.join("cloth.bsvtf")).unwrap();
    server.get("/v1/cloth").await.error(500, "corrupt");
    server.stop().await;
}

#[test]
fn any_bytes_are_answered_without_harm() {
    let root = folders();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let server = runtime.block_on(Server::start(&root.path().join("served")));
    let target = prop_oneof![
        "/v1/([.%/a-z0-9\\\\-]|%2[ef5]|\\.\\./|outside|cloth|secret.txt|\\.bsvtf){0,20}",
        "/[ -~]{0,40}",
    ];
    proptest!(ProptestConfig::with_cases(300), |(target in target, range in "(bytes=)?[0-9,-]{0,8}", junk: Vec<u8>)| {
        let answer = runtime.block_on(async {
            let mut stream = server.connect().await;
            let head = format!("GET {target} HTTP/1.1\r\nhost: x\r\nrange: {range}\r\nconnection: close\r\nx: ");
            let mut request = head.into_bytes();
            request.extend(junk);
            request.extend(b"\r\n\r\n");
            // The server may have refused and closed before all is sent.
            let _ = stream.write_all(&request).await;
            let mut answer = Vec::new();
            let _ = stream.read_to_end(&mut answer).await;
            answer
        });
        let text = String::from_utf8_lossy(&answer);
        prop_assert!(!text.contains(SECRET));
        prop_assert!(!text.starts_with("HTTP/1.1 500"), "{}", text);
    });
    runtime.block_on(server.stop());
}
