//! What is there: catalogue, manifest, index, pages, columns; their fields, conditions and errors.

mod common;

use common::{Server, archive, id, open, replace};
use tileset::{Index, archive::contents, codec::decode_page};

const IMMUTABLE: &str = "public, max-age=31536000, immutable";

/// A folder with one archive, a server, the archive's bytes and its content id.
async fn cloth() -> (tempfile::TempDir, Server, Vec<u8>, String) {
    let folder = tempfile::tempdir().unwrap();
    let bytes = archive(1);
    std::fs::write(folder.path().join("cloth.bsvtf"), &bytes).unwrap();
    let server = Server::start(folder.path()).await;
    let id = id(&bytes);
    (folder, server, bytes, id)
}

#[tokio::test(flavor = "multi_thread")]
async fn everything_is_reached_from_the_catalogue() {
    let (_folder, server, bytes, id) = cloth().await;
    let local = open(bytes.clone());

    let catalogue = server.get("/v1/").await.json();
    assert_eq!(catalogue["archives"].as_array().unwrap().len(), 1);
    let entry = &catalogue["archives"][0];
    for (member, value) in [
        ("width", 150),
        ("height", 100),
        ("views", 3),
        ("lights", 2),
        ("components", 6),
    ] {
        assert_eq!(entry[member], value, "{member}");
    }
    assert_eq!(
        (entry["name"].as_str(), entry["id"].as_str()),
        (Some("cloth"), Some(&*id))
    );
    assert_eq!(entry["bytes"], bytes.len());
    let at = |url: &serde_json::Value| format!("/v1/{}", url.as_str().unwrap());

    let answer = server.get(&at(&entry["urls"]["manifest"])).await;
    assert_eq!(
        answer.field("cache-control"),
        "public, max-age=5, must-revalidate"
    );
    let manifest = answer.json();
    assert_eq!(
        serde_json::from_value::<tileset::Manifest>(manifest["manifest"].clone()).unwrap(),
        local.index.manifest
    );
    assert_eq!(manifest["id"], *id);
    assert_eq!(manifest["index_bytes"], local.prefix().unwrap().len());
    let lengths = || local.index.pages().iter().map(|page| page.length);
    assert_eq!(manifest["page_bytes"], lengths().sum::<u32>());
    assert_eq!(manifest["largest_page_bytes"], lengths().max().unwrap());
    assert_eq!(
        manifest["mips"].as_array().unwrap().len(),
        usize::from(local.index.pyramid.tail_mip()) + 1
    );
    assert_eq!(manifest["urls"], entry["urls"]);

    let answer = server.get(&at(&manifest["urls"]["index"])).await;
    assert_eq!(answer.field("cache-control"), IMMUTABLE);
    assert_eq!(answer.field("etag"), format!("\"{id}\""));
    assert_eq!(Index::parse(&answer.body).unwrap(), local.index);

    let (page, column) = (at(&manifest["urls"]["page"]), at(&manifest["urls"]["column"]));
    let (mut stored, mut empty) = (0, 0);
    for group in 0..2 {
        for tile in local.index.pyramid.tiles() {
            let page_id = tileset::PageId { group, tile };
            let numbers = [
                ("{group}", group),
                ("{mip}", tile.mip.into()),
                ("{x}", tile.x),
                ("{y}", tile.y),
            ];
            let target = numbers.iter().fold(page.clone(), |url, (name, value)| {
                url.replace(name, &value.to_string())
            });
            let answer = server.get(&target).await;
            assert_eq!(answer.status, 200, "{target}");
            assert_eq!(answer.field("cache-control"), IMMUTABLE);
            assert_eq!(answer.field("content-type"), "application/octet-stream");
            assert_eq!(answer.field("etag"), format!("\"{:08x}\"", local.index.id as u32));
            assert_eq!(answer.field("content-length"), answer.body.len().to_string());
            assert_eq!(answer.body, local.page_record(page_id).unwrap());
            if tile == local.index.pyramid.root() {
                decode_page(
                    local.index.manifest.codec,
                    &local.index.pyramid,
                    page_id,
                    contents(&answer.body),
                    None,
                )
                .unwrap();
            }
            *(if answer.body.is_empty() {
                &mut empty
            } else {
                &mut stored
            }) += 1;
        }
        let answer = server.get(&column.replace("{group}", &group.to_string())).await;
        assert_eq!(answer.body, local.column_record(group).unwrap());
        assert_eq!(answer.field("cache-control"), IMMUTABLE);
    }
    assert!(
        stored > 5 && empty > 5,
        "{stored} pages stored, {empty} empty: the archive tests both"
    );
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_client_has_is_not_sent_again_and_head_is_get_without_a_body() {
    let (_folder, server, _, id) = cloth().await;
    for target in [
        "/v1/".to_owned(),
        "/v1/cloth".into(),
        "/v1/cloth.bsvtf".into(),
        "/v1/cloth/index".into(),
        format!("/v1/cloth/{id}/index"),
        format!("/v1/cloth/{id}/page/0/0/1/1"),
        format!("/v1/cloth/{id}/page/1/0/0/0"),
        format!("/v1/cloth/{id}/column/1"),
        "/health".into(),
        "/v1/cloth/nothing".into(),
        format!("/v1/cloth/{id}/page/9/0/0/0"),
    ] {
        let get = server.get(&target).await;
        let mut head = server.request("HEAD", &target, &[]).await;
        assert_eq!(head.body, b"");
        assert_eq!(
            head.field("content-length"),
            get.body.len().to_string(),
            "{target}"
        );
        head.body.clone_from(&get.body);
        let without_date = |mut answer: common::Response| {
            answer.fields.remove("date");
            answer.fields.remove("x-request-id");
            answer
        };
        assert_eq!(without_date(head), without_date(get.clone()), "{target}");

        let Some(etag) = get.fields.get("etag") else {
            assert_eq!(get.field("cache-control"), "no-store");
            continue;
        };
        assert!(etag.starts_with('"') && etag.ends_with('"'), "{etag}");
        for (known, status) in [
            (etag.clone(), 304),
            (format!("\"a\", W/{etag} , \"b\""), 304),
            ("*".into(), 304),
            ("\"other\"".into(), 200),
            (etag.trim_matches('"').into(), 200),
        ] {
            for method in ["GET", "HEAD"] {
                let answer = server
                    .request(method, &target, &[("if-none-match", &known)])
                    .await;
                assert_eq!(answer.status, status, "{method} {target} {known}");
                assert_eq!(
                    (answer.field("etag"), answer.field("cache-control")),
                    (&**etag, get.field("cache-control"))
                );
                assert!(status == 200 || answer.body.is_empty());
            }
        }
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn errors_say_what_was_wrong() {
    let (_folder, server, _, id) = cloth().await;
    for (target, status, error, says) in [
        ("/".to_owned(), 404, "not-found", "/v1/"),
        ("/v2/".into(), 404, "not-found", "/v1/"),
        ("/v1/wool".into(), 404, "not-found", "\"wool\""),
        ("/v1/wool.bsvtf".into(), 404, "not-found", "\"wool\""),
        (format!("/v1/wool/{id}/index"), 404, "not-found", "\"wool\""),
        ("/v1/cloth/xyz/index".into(), 404, "not-found", "content id"),
        (
            format!(
                "/v1/cloth/{}/index",
                id.to_uppercase().replace(char::is_numeric, "A")
            ),
            404,
            "not-found",
            "content id",
        ),
        (format!("/v1/cloth/{}/index", "0".repeat(32)), 410, "gone", &id),
        (
            format!("/v1/cloth/{}/page/0/0/0/0", "0".repeat(32)),
            410,
            "gone",
            &id,
        ),
        (
            format!("/v1/cloth/{id}/page/2/0/0/0"),
            404,
            "not-found",
            "2 groups",
        ),
        (format!("/v1/cloth/{id}/page/0/9/0/0"), 404, "not-found", "mip"),
        (format!("/v1/cloth/{id}/page/0/0/3/0"), 404, "not-found", "page"),
        (format!("/v1/cloth/{id}/column/2"), 404, "not-found", "2 groups"),
        (
            format!("/v1/cloth/{id}/page/0/256/0/0"),
            400,
            "bad-request",
            "mip",
        ),
        (
            format!("/v1/cloth/{id}/page/0/0/65536/0"),
            400,
            "bad-request",
            "x is",
        ),
        (
            format!("/v1/cloth/{id}/page/0/0/-1/0"),
            400,
            "bad-request",
            "x is",
        ),
        (
            format!("/v1/cloth/{id}/page/0/0/0/+1"),
            400,
            "bad-request",
            "y is",
        ),
        (
            format!("/v1/cloth/{id}/page/00/0/0/0"),
            400,
            "bad-request",
            "group is",
        ),
        (
            format!("/v1/cloth/{id}/column/one"),
            400,
            "bad-request",
            "group is",
        ),
        (format!("/v1/cloth/{id}/page/0/0/0"), 404, "not-found", "/v1/"),
        ("/v1/%ff".into(), 400, "bad-request", "UTF-8"),
    ] {
        let detail = server.get(&target).await.error(status, error);
        assert!(detail.contains(says), "{target}: {detail}");
    }
    for method in ["POST", "PUT", "DELETE", "PATCH"] {
        let answer = server.request(method, "/v1/cloth", &[]).await;
        answer.error(405, "method-not-allowed");
        assert_eq!(answer.field("allow"), "GET, HEAD, OPTIONS");
    }
    for fields in [("content-length", "5"), ("transfer-encoding", "chunked")] {
        server
            .request("GET", "/v1/cloth", &[fields])
            .await
            .error(413, "body-not-allowed");
    }
    assert_eq!(
        server
            .request("GET", "/v1/", &[("content-length", "0")])
            .await
            .status,
        200
    );
    let long = "x".repeat(20_000);
    assert_eq!(
        server.request("GET", "/v1/", &[("x-long", &long)]).await.status,
        431
    );
    let many = vec![("x", "y"); 100];
    assert_eq!(server.request("GET", "/v1/", &many).await.status, 431);
    assert_eq!(server.get("/health").await.body, b"ok\n");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_of_other_origins_may_read() {
    let (_folder, server, _, _) = cloth().await;
    let origin = ("origin", "https://example.org");
    let asked = [
        origin,
        ("access-control-request-method", "GET"),
        ("access-control-request-headers", "range"),
    ];
    let preflight = server.request("OPTIONS", "/v1/cloth.bsvtf", &asked).await;
    assert_eq!(preflight.status, 200);
    assert_eq!(preflight.field("access-control-allow-origin"), "*");
    assert_eq!(
        preflight.field("access-control-allow-methods"),
        "GET,HEAD,OPTIONS"
    );
    for allowed in ["range", "if-range", "if-none-match"] {
        assert!(
            preflight
                .field("access-control-allow-headers")
                .split(',')
                .any(|field| field == allowed),
            "{allowed}"
        );
    }
    for target in ["/v1/cloth", "/v1/nothing"] {
        let answer = server.request("GET", target, &[origin]).await;
        assert_eq!(answer.field("access-control-allow-origin"), "*");
        assert_eq!(answer.field("access-control-expose-headers"), "*");
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_folder_may_change() {
    let (folder, server, bytes, old) = cloth().await;
    let path = folder.path().join("cloth.bsvtf");
    let index = format!("/v1/cloth/{old}/index");
    let etag = server.get("/v1/cloth").await.field("etag").to_owned();

    let newer = archive(2);
    let new = id(&newer);
    assert_ne!(old, new);
    replace(&path, &newer);
    assert_eq!(
        server.get(&index).await.status,
        200,
        "nobody has asked for the manifest yet"
    );
    let answer = server
        .request("GET", "/v1/cloth", &[("if-none-match", &etag)])
        .await;
    assert_eq!(answer.json()["id"], *new);
    let pinned = server.get(&format!("/v1/cloth/{new}/index")).await;
    assert_eq!(pinned.status, 200);
    // By name it is whatever is there now, and says what that is.
    let named = server.get("/v1/cloth/index").await;
    assert_eq!((named.status, &named.body), (200, &pinned.body));
    assert_eq!(named.field("etag"), format!("\"{new}\""));
    assert_eq!(named.field("cache-control"), "public, max-age=5, must-revalidate");
    assert!(server.get(&index).await.error(410, "gone").contains(&new));

    replace(&path, &bytes);
    assert_eq!(
        server.get(&index).await.status,
        200,
        "an id that is not open is looked for"
    );

    std::fs::write(folder.path().join("wool 2 größe.bsvtf"), &newer).unwrap();
    assert_eq!(
        server.get("/v1/wool%202%20gr%C3%B6%C3%9Fe").await.json()["urls"]["archive"],
        "wool%202%20gr%C3%B6%C3%9Fe.bsvtf"
    );
    std::fs::write(folder.path().join("broken.bsvtf"), &bytes[..bytes.len() / 2]).unwrap();
    std::fs::write(folder.path().join("empty.bsvtf"), b"").unwrap();
    std::fs::write(
        folder.path().join("text.bsvtf"),
        b"no archive at all, but long enough to have a header of 64 bytes",
    )
    .unwrap();
    std::fs::create_dir(folder.path().join("folder.bsvtf")).unwrap();
    std::fs::write(folder.path().join("other.txt"), b"no archive").unwrap();
    let catalogue = server.get("/v1/").await.json();
    let mut found: Vec<_> = catalogue["archives"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| (entry["name"].as_str().unwrap(), entry["error"].is_null()))
        .collect();
    found.sort_unstable();
    let expected = [
        ("broken", false),
        ("cloth", true),
        ("empty", false),
        ("folder", false),
        ("text", false),
        ("wool 2 größe", true),
    ];
    assert_eq!(found, expected);
    for broken in ["broken", "empty", "folder", "text"] {
        server.get(&format!("/v1/{broken}")).await.error(500, "corrupt");
        server
            .get(&format!("/v1/{broken}.bsvtf"))
            .await
            .error(500, "corrupt");
    }
    server.get("/v1/other").await.error(404, "not-found");

    replace(&folder.path().join("broken.bsvtf"), &bytes);
    assert_eq!(
        server.get("/v1/broken").await.json()["id"],
        *old,
        "a file that is whole now is served"
    );
    std::fs::remove_file(&path).unwrap();
    server.get("/v1/cloth").await.error(404, "not-found");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn damaged_records_are_not_sent() {
    use std::io::{Seek, Write};
    let (folder, server, bytes, id) = cloth().await;
    let local = open(bytes);
    let record = local.index.column(0).unwrap();
    // Written over in place, behind the server's back.
    let mut file = std::fs::OpenOptions::new()
        .write(true)
        .open(folder.path().join("cloth.bsvtf"))
        .unwrap();
    file.seek(std::io::SeekFrom::Start(record.offset)).unwrap();
    file.write_all(b"garbage").unwrap();
    let target = format!("/v1/cloth/{id}/column/0");
    assert!(
        server
            .get(&target)
            .await
            .error(500, "corrupt")
            .contains("column of group 0")
    );
    assert_eq!(server.get(&format!("/v1/cloth/{id}/column/1")).await.status, 200);

    file.seek(std::io::SeekFrom::Start(100)).unwrap();
    file.write_all(b"garbage").unwrap();
    server
        .get(&format!("/v1/cloth/{id}/index"))
        .await
        .error(500, "corrupt");

    file.set_len(local.index.column(1).unwrap().offset).unwrap();
    server
        .get(&format!("/v1/cloth/{id}/column/1"))
        .await
        .error(500, "corrupt");
    server.get("/v1/cloth").await.error(500, "corrupt");
    server.stop().await;
}
