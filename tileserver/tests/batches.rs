//! Many records in one answer.

mod common;

use common::{
    Server, archive, id, large_archive, open, send,
    store::{Fault, Faulty},
};
use std::{sync::Arc, time::Duration};
use tileserver::{Collection, Options};
use tileset::{PageId, Tile};
use tokio::{io::AsyncReadExt, time::timeout};

const PATIENCE: Duration = Duration::from_secs(20);

/// A frame: kind, mip, group, x, y, status, bytes.
type Frame = (u8, u8, u16, u16, u16, u16, Vec<u8>);

/// The body of a chunked answer, and whether it came to its end.
fn unchunk(mut body: &[u8]) -> (Vec<u8>, bool) {
    let mut out = Vec::new();
    loop {
        let Some(end) = body.windows(2).position(|pair| pair == b"\r\n") else {
            return (out, false);
        };
        let length = usize::from_str_radix(std::str::from_utf8(&body[..end]).unwrap(), 16).unwrap();
        if length == 0 {
            return (out, true);
        }
        let Some(chunk) = body.get(end + 2..end + 2 + length) else {
            return (out, false);
        };
        out.extend(chunk);
        body = &body[end + 2 + length + 2..];
    }
}

fn frames(mut body: &[u8]) -> Vec<Frame> {
    let mut all = Vec::new();
    while !body.is_empty() {
        let u16_at = |at: usize| u16::from_le_bytes([body[at], body[at + 1]]);
        let length = u32::from_le_bytes(body[12..16].try_into().unwrap()) as usize;
        let bytes = body[16..16 + length].to_vec();
        all.push((
            body[0],
            body[1],
            u16_at(2),
            u16_at(4),
            u16_at(6),
            u16_at(8),
            bytes,
        ));
        body = &body[16 + length..];
    }
    all
}

async fn serve(store: &Faulty, options: Options) -> Server {
    let collection = Collection::of(Arc::new(store.clone()), "test").await.unwrap();
    Server::of(collection, options).await
}

#[tokio::test(flavor = "multi_thread")]
async fn records_come_in_the_order_asked() {
    let store = Faulty::default();
    let bytes = archive(1);
    store.put("cloth", bytes.clone());
    let (server, local, id) = (
        serve(&store, Options::default()).await,
        open(bytes.clone()),
        id(&bytes),
    );
    let list = "0.0.1.1,c1,0.2.0.0,7.0.0.0,1.0.0.0,c0,c0";
    let target = format!("/v1/cloth/{id}/batch/{list}");
    let answer = server.get(&target).await;
    assert_eq!(
        (answer.status, answer.field("content-type")),
        (200, "application/octet-stream")
    );
    assert_eq!(
        answer.field("cache-control"),
        "public, max-age=31536000, immutable"
    );
    let (body, complete) = unchunk(&answer.body);
    assert!(complete);
    let page = |group, mip, x, y| {
        let tile = Tile { mip, x, y };
        (
            1,
            mip,
            group,
            x,
            y,
            200,
            local.page_record(PageId { group, tile }).unwrap(),
        )
    };
    let column = |group| (0, 0, group, 0, 0, 200, local.column_record(group).unwrap());
    let all = frames(&body);
    let missing = &all[3];
    assert_eq!((missing.2, missing.5), (7, 404));
    assert_eq!(
        serde_json::from_slice::<serde_json::Value>(&missing.6).unwrap()["error"],
        "not-found"
    );
    assert!(page(1, 0, 0, 0).6.is_empty(), "a page that is not stored");
    let expected = [
        page(0, 0, 1, 1),
        column(1),
        page(0, 2, 0, 0),
        missing.clone(),
        page(1, 0, 0, 0),
        column(0),
        column(0),
    ];
    assert_eq!(all, expected);

    let etag = answer.field("etag");
    let known = server.request("GET", &target, &[("if-none-match", etag)]).await;
    assert_eq!((known.status, known.body.len()), (304, 0));
    let other = server.get(&format!("/v1/cloth/{id}/batch/c1,0.0.1.1")).await;
    assert_ne!(other.field("etag"), etag);
    let head = server.request("HEAD", &target, &[]).await;
    assert_eq!((head.status, head.field("etag"), head.body.len()), (200, etag, 0));

    for (list, says) in [
        ("c0,".to_owned(), "group"),
        ("0.0.0".into(), "y is"),
        ("..%2f..%2fsecret".into(), "group"),
        (format!("c0{}", ",c0".repeat(256)), "256"),
    ] {
        let detail = server
            .get(&format!("/v1/cloth/{id}/batch/{list}"))
            .await
            .error(400, "bad-request");
        assert!(detail.contains(says), "{detail}");
    }
    server
        .get(&format!("/v1/cloth/{}/batch/c0", "0".repeat(32)))
        .await
        .error(410, "gone");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_record_that_cannot_be_read_holds_up_no_other_and_no_cache_keeps_the_answer() {
    let store = Faulty::default();
    let bytes = archive(1);
    store.put("cloth", bytes.clone());
    let server = serve(&store, Options::default()).await;
    let target = format!("/v1/cloth/{}/batch/c0,c1", id(&bytes));
    // The column is read twice in vain; what follows is read after it.
    let only = format!("/v1/cloth/{}/batch/c0", id(&bytes));
    store.fail([Fault::Garbage, Fault::Garbage]);
    let (body, complete) = unchunk(&server.get(&only).await.body);
    let all = frames(&body);
    assert_eq!((all[0].5, complete), (500, false), "broken off");
    assert_eq!(
        serde_json::from_slice::<serde_json::Value>(&all[0].6).unwrap()["error"],
        "corrupt"
    );
    store.fail([Fault::Unavailable; 3]);
    server
        .get(&format!("/v1/cloth/{}/column/1", id(&bytes)))
        .await
        .error(503, "unavailable");
    server.get(&format!("/v1/cloth/{}/column/1", id(&bytes))).await;
    store.fail([Fault::Unavailable; 3]);
    let (body, complete) = unchunk(&server.get(&target).await.body);
    let statuses: Vec<_> = frames(&body).iter().map(|frame| frame.5).collect();
    assert_eq!((statuses, complete), (vec![503, 200], false));
    let (body, complete) = unchunk(&server.get(&target).await.body);
    assert_eq!((frames(&body).len(), complete), (2, true), "it has passed");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_reads_late_gets_all_frames_of_a_batch_that_is_broken_off() {
    // More than the system's buffers of a connection take.
    let (store, bytes) = (Faulty::default(), large_archive(16 << 20));
    store.put("large", bytes.clone());
    let options = Options {
        cache_bytes: 0,
        ..Options::default()
    };
    let server = serve(&store, options).await;
    let mut stream = server.connect().await;
    store.fail([Fault::Garbage; 2]);
    let target = format!("/v1/large/{}/batch/c0,c1", id(&bytes));
    send(&mut stream, "GET", &target, &[]).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    let answer = timeout(PATIENCE, common::receive(stream)).await.expect("an end");
    let (body, complete) = unchunk(&answer.body);
    let statuses: Vec<_> = frames(&body).iter().map(|frame| frame.5).collect();
    assert!(statuses == [500, 200] || statuses == [200, 500], "{statuses:?}");
    let whole = open(bytes).column_record(statuses.iter().position(|status| *status == 200).unwrap() as u16);
    assert!(
        frames(&body)
            .iter()
            .any(|frame| frame.6 == *whole.as_ref().unwrap())
    );
    assert!(!complete, "no cache keeps it");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_frame_leaves_before_the_last_record_is_read() {
    let store = Faulty::default();
    let bytes = archive(1);
    store.put("cloth", bytes.clone());
    let server = serve(&store, Options::default()).await;
    let index = open(bytes.clone()).index;
    let records = [index.column(0).unwrap(), index.column(1).unwrap()];
    let (first, last) = if records[0].offset < records[1].offset {
        (0, 1)
    } else {
        (1, 0)
    };
    store.close_gate(records[last].offset);
    let mut stream = server.connect().await;
    send(
        &mut stream,
        "GET",
        &format!("/v1/cloth/{}/batch/c{first},c{last}", id(&bytes)),
        &[],
    )
    .await;
    let mut got = Vec::new();
    let begun = async {
        let head_and_frame = 200 + records[first].length as usize;
        while got.len() < head_and_frame {
            assert_ne!(stream.read_buf(&mut got).await.unwrap(), 0);
        }
    };
    timeout(PATIENCE, begun).await.expect("the first record");
    store.open_gate();
    timeout(PATIENCE, stream.read_to_end(&mut got))
        .await
        .expect("the last record")
        .unwrap();
    assert!(got.ends_with(b"0\r\n\r\n"));
    server.stop().await;
}
