//! Stores that fail, are slow, and change; records in memory; buckets.

mod common;

use std::{
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use common::{
    Server, archive, id, large_archive, open,
    store::{Fault, Faulty},
};
use object_store::{ObjectStore, ObjectStoreExt, memory::InMemory, path::Path};
use tileserver::{Collection, Objects, Options};

/// Changes are seen at once, and what does not answer is given up soon.
fn options() -> Options {
    Options {
        list_age: Duration::ZERO,
        store_timeout: Duration::from_millis(50),
        ..Options::default()
    }
}

async fn faulty(options: Options) -> (Faulty, Server, String) {
    let store = Faulty::default();
    let bytes = archive(1);
    store.put("cloth", bytes.clone());
    let collection = Collection::of(Arc::new(store.clone()), "test").await.unwrap();
    (store, Server::of(collection, options).await, id(&bytes))
}

/// A number of `/metrics`.
async fn metric(server: &Server, name: &str) -> u64 {
    let text = String::from_utf8(server.get("/metrics").await.body).unwrap();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix(&format!("eigentile_{name} ")));
    line.unwrap_or_else(|| panic!("{name} in {text}"))
        .parse()
        .unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn equal_requests_are_one_read_and_the_next_is_none() {
    let options = Options {
        store_timeout: Duration::from_secs(20),
        ..options()
    };
    let (store, server, id) = faulty(options).await;
    let column = format!("/v1/cloth/{id}/column/0");
    let reads = store.reads();
    store.close_gate(0);
    let clients = async { futures_util::future::join_all((0..20).map(|_| server.get(&column))).await };
    let open = async {
        while metric(&server, "cache_joins_total").await < 19 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        store.open_gate();
    };
    let (answers, ()) = tokio::join!(clients, open);
    assert!(
        answers
            .iter()
            .all(|answer| answer.status == 200 && answer.body == answers[0].body)
    );
    assert_eq!(store.reads() - reads, 1);
    assert_eq!(server.get(&column).await.body, answers[0].body);
    assert_eq!(store.reads() - reads, 1, "from memory");
    assert_eq!(metric(&server, "cache_hits_total").await, 1);
    assert_eq!(metric(&server, "cache_misses_total").await, 1);
    let cached = metric(&server, "cache_bytes").await;
    assert!((answers[0].body.len() as u64..answers[0].body.len() as u64 + 1000).contains(&cached));
    assert_eq!(metric(&server, "memory_bytes").await, 0, "all is sent");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_read_that_nobody_waits_for_is_given_up() {
    let (store, server, id) = faulty(Options {
        store_timeout: Duration::from_secs(20),
        ..options()
    })
    .await;
    let column = format!("/v1/cloth/{id}/column/0");
    store.close_gate(0);
    let reads = store.reads();
    let mut client = server.connect().await;
    common::send(&mut client, "GET", &column, &[]).await;
    while store.reads() == reads {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    drop(client);
    while metric(&server, "memory_bytes").await > 0 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    store.open_gate();
    assert_eq!(server.get(&column).await.status, 200);
    assert_eq!(store.reads() - reads, 2, "the next one reads anew");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn faults_that_pass_are_not_seen_and_others_are_told() {
    let (store, server, id) = faulty(Options {
        cache_bytes: 0,
        ..options()
    })
    .await;
    let column = format!("/v1/cloth/{id}/column/0");
    for faults in [
        vec![Fault::Unavailable, Fault::Unavailable],
        vec![Fault::Garbage],
        vec![Fault::Never, Fault::Unavailable],
    ] {
        store.fail(faults.clone());
        assert_eq!(server.get(&column).await.status, 200, "{faults:?}");
    }
    for (fault, status, error) in [
        (Fault::Unavailable, 503, "unavailable"),
        (Fault::Never, 503, "unavailable"),
        (Fault::Garbage, 500, "corrupt"),
    ] {
        store.fail([fault; 10]);
        let answer = server.get(&column).await;
        answer.error(status, error);
        if status == 503 {
            assert_eq!(answer.field("retry-after"), "5");
        }
        assert_eq!(server.get("/v1/cloth").await.status, 200, "others go on");
        store.fail([]);
    }
    assert!(metric(&server, "store_failures_total").await >= 9);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_archive_that_is_replaced_is_never_mixed_with_its_successor() {
    let (store, server, old) = faulty(options()).await;
    let (newer, new) = (archive(2), id(&archive(2)));
    // The same content again: nobody notices.
    store.put("cloth", archive(1));
    assert_eq!(server.get(&format!("/v1/cloth/{old}/column/0")).await.status, 200);
    // Another one: what is in memory is still right, what is not is gone.
    store.put("cloth", newer.clone());
    assert_eq!(server.get(&format!("/v1/cloth/{old}/column/0")).await.status, 200);
    let detail = server
        .get(&format!("/v1/cloth/{old}/column/1"))
        .await
        .error(410, "gone");
    assert!(detail.contains(&new));
    let column = server.get(&format!("/v1/cloth/{new}/column/1")).await;
    assert_eq!(column.body, open(newer).column_record(1).unwrap());
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_store_that_cannot_be_listed_is_served_on_and_not_ready() {
    let (store, server, id) = faulty(options()).await;
    assert_eq!(server.get("/ready").await.body, b"ready\n");
    store.unlisted.store(true, Ordering::Relaxed);
    let not = server.get("/ready").await;
    not.error(503, "not-ready");
    assert_eq!(not.field("retry-after"), "1");
    assert_eq!(server.get("/v1/cloth").await.json()["id"], *id);
    assert_eq!(server.get(&format!("/v1/cloth/{id}/column/0")).await.status, 200);
    assert_eq!(server.get("/health").await.body, b"ok\n", "alive all the same");
    assert_eq!(metric(&server, "ready").await, 0);
    store.unlisted.store(false, Ordering::Relaxed);
    assert_eq!(server.get("/ready").await.status, 200);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_is_served_like_a_folder() {
    let bucket = Arc::new(InMemory::new());
    let (bytes, other) = (archive(1), archive(2));
    for (path, content) in [
        ("tiles/cloth.bsvtf", &bytes),
        ("tiles/broken.bsvtf", &bytes[..100].to_vec()),
        ("tiles/deeper/hidden.bsvtf", &other),
        ("tiles/notes.txt", &other),
        ("secret.bsvtf", &other),
        ("tiles2/other.bsvtf", &other),
    ] {
        bucket
            .put(&Path::from(path), content.clone().into())
            .await
            .unwrap();
    }
    let objects = |path| Objects::new(Arc::clone(&bucket) as Arc<dyn ObjectStore>, Path::from(path));
    let collection = Collection::of(Arc::new(objects("tiles")), "bucket")
        .await
        .unwrap();
    assert_eq!(collection.names(), ["cloth"]);
    let server = Server::of(collection, options()).await;
    let catalogue = server.get("/v1/").await.json();
    assert_eq!(catalogue["archives"].as_array().unwrap().len(), 2);
    server.get("/v1/broken").await.error(500, "corrupt");
    let (id, local) = (id(&bytes), open(bytes.clone()));
    assert_eq!(
        server.get(&format!("/v1/cloth/{id}/index")).await.body,
        local.prefix().unwrap()
    );
    assert_eq!(
        server.get(&format!("/v1/cloth/{id}/column/1")).await.body,
        local.column_record(1).unwrap()
    );
    assert_eq!(server.get("/v1/cloth.bsvtf").await.body, bytes);
    for name in [
        "secret",
        "..%2fsecret",
        "deeper%2fhidden",
        "deeper/hidden",
        "%2e%2e/secret",
        "notes.txt",
        "other",
    ] {
        let answer = server.get(&format!("/v1/{name}")).await;
        assert_eq!(answer.status, 404, "{name}");
    }
    // Replaced: what is read next belongs to the new one, or is refused.
    bucket
        .put(&Path::from("tiles/cloth.bsvtf"), other.clone().into())
        .await
        .unwrap();
    server
        .get(&format!("/v1/cloth/{id}/column/0"))
        .await
        .error(410, "gone");
    assert_eq!(server.get("/v1/cloth.bsvtf").await.body, other);
    // One archive alone.
    let one = Collection::of(Arc::new(objects("secret.bsvtf")), "bucket")
        .await
        .unwrap();
    assert_eq!(one.names(), ["secret"]);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_archive_of_a_web_server_is_read_by_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.bsvtf");
    let (bytes, newer) = (large_archive(400_000), archive(3));
    std::fs::write(&path, &bytes).unwrap();
    // Our own server is a plain web server, too.
    let origin = Server::start(folder.path()).await;
    let url = format!("http://{}/v1/large.bsvtf", origin.address);
    let collection = Collection::from_url(&url).await.unwrap();
    let server = Server::of(
        collection,
        Options {
            store_timeout: Duration::from_secs(5),
            ..options()
        },
    )
    .await;
    let column = format!("/v1/large/{}/column/0", id(&bytes));
    assert_eq!(
        server.get(&column).await.body,
        open(bytes.clone()).column_record(0).unwrap()
    );
    assert_eq!(server.get("/v1/large.bsvtf").await.body, bytes);
    common::replace(&path, &newer);
    server
        .get(&format!("/v1/large/{}/column/1", id(&bytes)))
        .await
        .error(410, "gone");
    assert_eq!(server.get("/v1/large").await.json()["id"], *id(&newer));
    server.stop().await;
    origin.stop().await;
}
