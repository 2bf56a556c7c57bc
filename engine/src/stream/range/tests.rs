//! What hosts do, rightly and wrongly.

use std::time::Instant;

use tileset::{Archive, PageId};

use super::*;
use crate::{
    Error,
    stream::{
        HttpOptions, HttpTransport, RetriedSource, RetryOptions,
        conformance::{Fixture, Host, Trick, archive, drain, fetch},
    },
};

fn ranges(host: &Host) -> RangeSource<HttpTransport> {
    RangeSource::new(HttpTransport::new(&HttpOptions::default()).unwrap(), &host.url)
}

fn retried(host: &Host) -> RetriedSource<RangeSource<HttpTransport>> {
    again(ranges(host))
}

fn again(source: RangeSource<HttpTransport>) -> RetriedSource<RangeSource<HttpTransport>> {
    let options = RetryOptions {
        backoff: Duration::from_millis(1),
        ..RetryOptions::default()
    };
    RetriedSource::new(source, options)
}

fn index() -> Request {
    Request::Index {
        archive: "cloth".into(),
    }
}

fn column(group: u16) -> Request {
    Request::Column {
        archive: "cloth".into(),
        group,
    }
}

/// An archive so large that most of it does not come with its index: 8 pages of 30,000 bytes, and two columns.
fn large(seed: u64) -> Vec<u8> {
    let small = Archive::open(archive(seed)).unwrap();
    let manifest = tileset::Manifest {
        width: 80,
        height: 40,
        components: 8,
        name: format!("large {seed}"),
        ..small.index.manifest
    };
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = tileset::ArchiveWriter::new(manifest).unwrap();
    for group in 0..2 {
        writer.add_column(group, vec![7 + group as u8; 30], 1.0).unwrap();
        for (i, tile) in pyramid.tiles().enumerate() {
            let bytes = (0..30_000u64)
                .map(|at| ((at * (i as u64 + 3) * (seed + 5)) >> 4) as u8)
                .collect();
            writer
                .add_page(PageId { group, tile }, bytes, 1.0 / (i + 1) as f64)
                .unwrap();
        }
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

/// A host with the large archive as "cloth", and all its pages.
fn large_host() -> (Host, Vec<Request>, Archive<Vec<u8>>) {
    let host = Host::start();
    host.put("cloth", large(1), Some("\"1\""));
    let archive = Archive::open(large(1)).unwrap();
    let groups = 0..archive.index.manifest.groups() as u16;
    let pages = groups.flat_map(|group| {
        archive.index.pyramid.tiles().map(move |tile| Request::Page {
            archive: "cloth".into(),
            page: PageId { group, tile },
        })
    });
    let pages = pages.collect();
    (host, pages, archive)
}

fn expected(archive: &Archive<Vec<u8>>, request: &Request) -> Vec<u8> {
    match request {
        Request::Index { .. } => archive.prefix().unwrap(),
        Request::Page { page, .. } => archive.page_record(*page).unwrap(),
        Request::Column { group, .. } => archive.column_record(*group).unwrap(),
    }
}

#[track_caller]
fn error(source: &mut dyn TileSource, request: Request) -> Error {
    fetch(source, &[request]).remove(0).bytes.expect_err("an error")
}

#[test]
fn small_archives_come_with_their_index() {
    let host = Host::start();
    let mut source = ranges(&host);
    let requests = Fixture::get().requests();
    let cloth: Vec<Request> = requests
        .into_iter()
        .filter(|request| &**request.archive() == "cloth")
        .collect();
    for answer in fetch(&mut source, &cloth) {
        assert_eq!(answer.bytes.unwrap(), Fixture::get().expected(&answer.request));
    }
    let asked = host.asked();
    assert_eq!(
        asked,
        [("/cloth.bsvtf".to_owned(), Some("bytes=0-65535".to_owned()))]
    );
    assert_eq!(source.stats().from_ram as usize, cloth.len() - 1);
}

#[test]
fn neighbours_come_in_one_range() {
    let (host, pages, archive) = large_host();
    let mut source = ranges(&host);
    fetch(&mut source, &[index()]);
    host.asked();
    let answers = fetch(&mut source, &pages);
    assert_eq!(answers.len(), pages.len());
    for answer in &answers {
        assert_eq!(
            answer.bytes.as_ref().unwrap(),
            &expected(&archive, &answer.request)
        );
    }
    let asked = host.asked();
    assert!(
        asked.len() <= 2 && asked.len() < pages.len(),
        "{} pages in {} ranges",
        pages.len(),
        asked.len()
    );
    let received: u64 = answers.iter().map(|answer| answer.wire_bytes).sum();
    let stored: usize = answers
        .iter()
        .filter(|answer| answer.wire_bytes > 0)
        .map(|answer| answer.bytes.as_ref().unwrap().len())
        .sum();
    assert!(received < stored as u64 + 2 * 600, "{received} for {stored}");
}

#[test]
fn long_indices_take_two_ranges() {
    let host = Host::start();
    let bytes = wide();
    host.put("cloth", bytes.clone(), Some("\"1\""));
    let archive = Archive::open(bytes).unwrap();
    assert!(archive.prefix().unwrap().len() as u64 > load::GUESS_BYTES);
    let answers = fetch(&mut ranges(&host), &[index(), column(0)]);
    for answer in answers {
        assert_eq!(answer.bytes.unwrap(), expected(&archive, &answer.request));
    }
    let asked = host.asked();
    assert_eq!(asked[0].1.as_deref(), Some("bytes=0-65535"));
    let last = archive.prefix().unwrap().len() - 1;
    assert_eq!(asked[1].1, Some(format!("bytes=65536-{last}")));
}

/// An archive with so many pages, of which none is like another, that its directory is long.
fn wide() -> Vec<u8> {
    let small = Archive::open(archive(1)).unwrap();
    let manifest = tileset::Manifest {
        width: 12_800,
        height: 12_800,
        components: 4,
        singular_values: vec![0.1; 4],
        ..small.index.manifest
    };
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = tileset::ArchiveWriter::new(manifest).unwrap();
    writer.add_column(0, vec![7; 30], 1.0).unwrap();
    for (i, tile) in (1u64..).zip(pyramid.tiles()) {
        let noise = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let bytes = vec![i as u8; 1 + (noise >> 58) as usize];
        let octaves = (noise >> 32 & 0xfff) as f64 / 300.0;
        writer
            .add_page(PageId { group: 0, tile }, bytes, (-octaves).exp2())
            .unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

#[test]
fn hosts_without_ranges_send_all_once() {
    let host = Host::start();
    host.always(Trick::IgnoreRange);
    let mut source = ranges(&host);
    for answer in fetch(&mut source, &Fixture::get().requests()) {
        assert_eq!(answer.bytes.unwrap(), Fixture::get().expected(&answer.request));
    }
    assert_eq!(host.asked().len(), Fixture::get().archives.len());

    // Now and then: the range is cut out of the whole.
    let (host, pages, archive) = large_host();
    let mut source = ranges(&host);
    fetch(&mut source, &[index()]);
    host.always(Trick::IgnoreRange);
    for answer in fetch(&mut source, &pages) {
        assert_eq!(answer.bytes.unwrap(), expected(&archive, &answer.request));
    }

    // Too long for that: an error that says what to do.
    let host = Host::start();
    host.put("cloth", vec![0; load::WHOLE_BYTES as usize + 1], None);
    host.always(Trick::IgnoreRange);
    let said = error(&mut ranges(&host), index()).to_string();
    assert!(
        said.contains("ignores ranges") && said.contains("cloth.bsvtf"),
        "{said}"
    );
}

#[test]
fn what_is_wrong_for_good_is_said_at_once() {
    for (trick, says) in [
        (Trick::WrongRange, "were asked for"),
        (Trick::Short, "were asked for"),
        (Trick::Compressed, "Content-Encoding gzip"),
        (Trick::Status("403 Forbidden"), "403"),
        (
            Trick::Status("301 Moved\r\nlocation: ftp://elsewhere/"),
            "ftp://elsewhere/",
        ),
        (Trick::Status("404 Not Found"), "not found"),
        (Trick::Status("410 Gone"), "not found"),
        (Trick::Status("401 Unauthorized"), "401"),
    ] {
        let (host, _, _) = large_host();
        host.always(trick);
        let said = error(&mut retried(&host), index()).to_string();
        assert!(
            said.contains(says) && said.contains(&host.url),
            "{trick:?}: {said}"
        );
        assert_eq!(host.asked().len(), 1, "{trick:?}: no use to ask again");
    }
    for (bytes, says) in [
        (Vec::new(), "empty"),
        (b"<html>hello</html>".to_vec(), "not those of an archive"),
        (large(1)[..100_000].to_vec(), "its header says"),
    ] {
        let host = Host::start();
        host.put("cloth", bytes, Some("\"1\""));
        let said = error(&mut retried(&host), index()).to_string();
        assert!(said.contains(says) && said.contains(&host.url), "{said}");
    }
}

#[test]
fn what_passes_is_survived() {
    for trick in [
        Trick::HangUp,
        Trick::BreakOff(0),
        Trick::BreakOff(70_000),
        Trick::Chunked,
        Trick::Pause(50_000),
        Trick::Damage(0),
        Trick::Damage(45_000),
        Trick::Status("500 Internal Server Error"),
        Trick::Status("503 Service Unavailable"),
        Trick::Status("429 Too Many Requests"),
    ] {
        let (host, pages, archive) = large_host();
        let mut silence = HttpOptions::default();
        if matches!(trick, Trick::Pause(_)) {
            silence.silence = Duration::from_millis(100);
        }
        let transport = HttpTransport::new(&silence).unwrap();
        let mut source = again(RangeSource::new(transport, &host.url));
        if trick != Trick::Damage(0) {
            host.play([trick, trick]);
        }
        fetch(&mut source, &[index()]).remove(0).bytes.unwrap();
        // Damage in the same place again and again is the host's.
        match trick {
            Trick::Damage(_) => host.play([trick]),
            _ => host.play([trick, trick, Trick::Honest, trick]),
        }
        for answer in fetch(&mut source, &pages) {
            let bytes = answer.bytes.unwrap_or_else(|error| panic!("{trick:?}: {error}"));
            assert_eq!(bytes, expected(&archive, &answer.request), "{trick:?}");
        }
        let stats = source.stats();
        assert!(stats.retried > 0, "{trick:?}: {stats:?}");
    }
}

#[test]
fn what_has_come_before_a_connection_is_lost_is_not_asked_for_again() {
    let (host, pages, archive) = large_host();
    let mut source = retried(&host);
    fetch(&mut source, &[index()]);
    host.asked();
    host.play([Trick::BreakOff(100_000)]);
    for answer in fetch(&mut source, &pages) {
        assert_eq!(answer.bytes.unwrap(), expected(&archive, &answer.request));
    }
    let asked = host.asked();
    let start = |(_, range): &(String, Option<String>)| -> u64 {
        let range = range.as_ref().unwrap().trim_start_matches("bytes=");
        range.split_once('-').unwrap().0.parse().unwrap()
    };
    assert!(start(&asked[1]) >= start(&asked[0]) + 80_000, "{asked:?}");
}

#[test]
fn damage_on_the_host_is_reported_with_archive_record_and_host() {
    let (host, _, _) = large_host();
    let mut source = retried(&host);
    fetch(&mut source, &[index()]);
    let last = Request::Page {
        archive: "cloth".into(),
        page: PageId {
            group: 1,
            tile: tileset::Tile { mip: 0, x: 1, y: 0 },
        },
    };
    host.anew();
    host.always(Trick::Damage(20_000));
    let said = error(&mut source, last.clone()).to_string();
    for part in ["cloth", &last.to_string(), &*host.url, "3 times", "checksum"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert_eq!(host.anew(), [false, true, true], "past the caches on the way");
}

#[test]
fn a_changed_archive_is_noticed_and_never_mixed() {
    // With an ETag, with a weak one, and with nothing but the length.
    for (before, after) in [
        (Some("\"1\""), Some("\"2\"")),
        (Some("W/\"1\""), Some("W/\"2\"")),
        (None, None),
    ] {
        let (host, pages, _) = large_host();
        host.put("cloth", large(1), before);
        let mut source = ranges(&host);
        fetch(&mut source, &[index()]);
        let mut new = large(2);
        if after.is_none() {
            new = wide();
        }
        host.put("cloth", new.clone(), after);
        let at_hand = |answer: &Answer| answer.wire_bytes == 0 && answer.bytes.is_ok();
        for _ in 0..2 {
            for answer in fetch(&mut source, &pages) {
                if !at_hand(&answer) {
                    let said = answer.bytes.expect_err("the old one is gone").to_string();
                    assert!(said.contains("changed on the host"), "{said}");
                }
            }
        }
        host.asked();
        error(&mut source, column(0));
        assert!(host.asked().is_empty(), "it is known to have changed");
        let now = Archive::open(new).unwrap();
        for answer in fetch(&mut source, &[index(), column(0)]) {
            assert_eq!(answer.bytes.unwrap(), expected(&now, &answer.request));
        }
    }
}

#[test]
fn giving_up_ends_the_transfer() {
    let (host, pages, _) = large_host();
    let mut source = ranges(&host);
    fetch(&mut source, &[index()]);
    host.asked();
    host.always(Trick::Pause(1000));
    let tickets: Vec<Ticket> = pages
        .iter()
        .map(|page| source.submit(page.clone()).unwrap())
        .collect();
    let begin = Instant::now();
    while host.asked().is_empty() {
        assert!(begin.elapsed() < Duration::from_secs(10));
        while source.poll().is_some() {}
        source.wait(Duration::from_millis(1));
    }
    let in_flight = source.in_flight() as u64;
    assert!(in_flight > 0);
    tickets.iter().for_each(|ticket| source.cancel(*ticket));
    let stats = source.stats();
    assert_eq!(stats.cancelled, in_flight);
    assert!(
        stats.cancelled_bytes_saved > (in_flight - 1) * 30_000 - 1000,
        "{stats:?}, {in_flight}"
    );
    assert_eq!(source.in_flight(), 0);
    assert!(source.fetches.is_empty() && source.wanted.is_empty());
    host.always(Trick::Honest);
    assert!(
        fetch(&mut source, &pages)
            .iter()
            .all(|answer| answer.bytes.is_ok())
    );
    // While the index is on its way.
    let mut source = ranges(&host);
    let ticket = source.submit(index()).unwrap();
    source.wait(Duration::ZERO);
    source.cancel(ticket);
    assert!(source.loads.is_empty() && source.in_flight() == 0);
    assert!(drain(&mut source).is_empty());
}
