use std::{cell::RefCell, collections::BTreeMap, rc::Rc};

use engine::stream::MemorySource;
use tileset::{ArchiveWriter, Codec, Direction, Factorization, Ledger, Manifest, PageId};

use super::*;

/// What is kept, and answers that are on their way.
#[derive(Clone, Default)]
struct Shelf(Rc<RefCell<Inner>>);

#[derive(Default)]
struct Inner {
    kept: BTreeMap<String, Bytes>,
    /// Keys that are believed to be there, and are not.
    lies: bool,
    answers: VecDeque<(u64, Option<Bytes>)>,
}

impl Store for Shelf {
    fn holds(&self, key: &str) -> bool {
        let inner = self.0.borrow();
        inner.lies || inner.kept.contains_key(key)
    }
    fn get(&mut self, number: u64, key: &str) {
        let mut inner = self.0.borrow_mut();
        let found = inner.kept.get(key).cloned();
        inner.answers.push_back((number, found));
    }
    fn poll(&mut self) -> Option<(u64, Option<Bytes>)> {
        self.0.borrow_mut().answers.pop_front()
    }
    fn put(&mut self, key: &str, bytes: &Bytes) {
        self.0.borrow_mut().kept.insert(key.into(), bytes.clone());
    }
    fn remove(&mut self, key: &str) {
        self.0.borrow_mut().kept.remove(key);
    }
}

/// A source that cannot be reached.
struct Gone {
    open: VecDeque<(Ticket, Request)>,
    next: u64,
}

impl TileSource for Gone {
    fn capacity(&self) -> usize {
        8
    }
    fn in_flight(&self) -> usize {
        self.open.len()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.next += 1;
        self.open.push_back((Ticket(self.next), request));
        Some(Ticket(self.next))
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.open.retain(|(open, _)| *open != ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        let (ticket, request) = self.open.pop_front()?;
        let what = request.to_string();
        let bytes = Err(Error::Unavailable {
            what,
            detail: "gone".into(),
            retry_after: None,
        });
        Some(Answer {
            ticket,
            request,
            bytes,
            checked: false,
            wire_bytes: 0,
        })
    }
    fn wait(&mut self, _limit: Duration) {}
}

/// An archive of two groups, of opaque records; every fifth page is empty.
fn archive(seed: u8) -> Vec<u8> {
    let direction = Direction { theta: 0.0, phi: 0.0 };
    let manifest = Manifest {
        name: "test".into(),
        generator: "test".into(),
        width: 200,
        height: 100,
        wrap: true,
        cosine: false,
        views: vec![direction],
        lights: vec![direction],
        components: 8,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.01 },
        texture_scale: 1.0,
        mean_rgb: [0.5; 3],
        singular_values: vec![0.1; 8],
        errors: Ledger::default(),
    };
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = ArchiveWriter::new(manifest).unwrap();
    for group in 0..2 {
        writer
            .add_column(group, vec![seed + group as u8; 30], 1.0)
            .unwrap();
        for (at, tile) in pyramid.tiles().enumerate() {
            let record = vec![seed; if at % 5 == 4 { 0 } else { 100 + at }];
            writer.add_page(PageId { group, tile }, record, 1.0).unwrap();
        }
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}

fn memory(bytes: &[u8]) -> MemorySource {
    let mut memory = MemorySource::with_capacity(8);
    memory.insert("cloth", bytes.to_vec()).unwrap();
    memory
}

/// The index, all columns and pages.
fn requests(bytes: &[u8]) -> Vec<Request> {
    let index = tileset::Archive::open(bytes.to_vec()).unwrap().index;
    let name = || Arc::<str>::from("cloth");
    let mut requests = vec![Request::Index { archive: name() }];
    for group in 0..2 {
        requests.push(Request::Column {
            archive: name(),
            group,
        });
        requests.extend(index.pyramid.tiles().map(|tile| Request::Page {
            archive: name(),
            page: PageId { group, tile },
        }));
    }
    requests
}

/// Asks for each in turn.
fn ask(source: &mut dyn TileSource, requests: &[Request]) -> Vec<Option<Bytes>> {
    let answer = |request: &Request| {
        let ticket = source.submit(request.clone()).unwrap();
        for _ in 0..10 {
            if let Some(answer) = source.poll() {
                assert_eq!((answer.ticket, &answer.request), (ticket, request));
                assert_eq!(source.in_flight(), 0);
                return answer.bytes.ok();
            }
        }
        panic!("no answer for {request}");
    };
    requests.iter().map(answer).collect()
}

#[test]
fn what_came_once_needs_no_host() {
    let bytes = archive(1);
    let (requests, shelf) = (requests(&bytes), Shelf::default());
    let plain = ask(&mut memory(&bytes), &requests);
    let mut first = KeptSource::new(memory(&bytes), shelf.clone());
    assert_eq!(ask(&mut first, &requests), plain);
    assert_eq!(first.stats().from_disk, 0);
    // The next visit asks for the index only.
    let mut second = KeptSource::new(memory(&bytes), shelf.clone());
    assert_eq!(ask(&mut second, &requests), plain);
    let stored = plain[1..].iter().flatten().filter(|bytes| !bytes.is_empty());
    assert_eq!(second.stats().from_disk, stored.count() as u64);
    assert_eq!(second.stats().offline, 0);
    // And without a host all that is stored is there. Empty records, which are not, cost nobody a picture.
    shelf
        .0
        .borrow_mut()
        .kept
        .retain(|key, _| !key.starts_with("index"));
    let index = plain[0].clone().unwrap();
    shelf.clone().put("index this program cloth", &index);
    let gone = Gone {
        open: VecDeque::new(),
        next: 0,
    };
    let mut offline = KeptSource::new(gone, shelf);
    let answers = ask(&mut offline, &requests);
    assert_eq!(offline.stats().offline, 1);
    for (answer, plain) in answers.iter().zip(&plain) {
        assert!(answer == plain || (answer.is_none() && plain.as_ref().unwrap().is_empty()));
    }
}

#[test]
fn nothing_kept_and_no_host_is_an_error() {
    let gone = Gone {
        open: VecDeque::new(),
        next: 0,
    };
    let mut source = KeptSource::new(gone, Shelf::default());
    source
        .submit(Request::Index {
            archive: "cloth".into(),
        })
        .unwrap();
    let answer = (0..10).find_map(|_| source.poll()).unwrap();
    assert!(matches!(answer.bytes, Err(Error::Unavailable { .. })));
    assert_eq!((source.in_flight(), source.stats().offline), (0, 0));
}

#[test]
fn another_version_never_gets_the_records_of_its_predecessor() {
    let (old, new) = (archive(1), archive(7));
    let (requests, shelf) = (requests(&old), Shelf::default());
    ask(&mut KeptSource::new(memory(&old), shelf.clone()), &requests);
    let mut source = KeptSource::new(memory(&new), shelf);
    assert_eq!(ask(&mut source, &requests), ask(&mut memory(&new), &requests));
    assert_eq!(source.stats().from_disk, 0);
}

#[test]
fn damaged_and_missing_records_are_asked_for() {
    let bytes = archive(3);
    let (requests, shelf) = (requests(&bytes), Shelf::default());
    let plain = ask(&mut memory(&bytes), &requests);
    ask(&mut KeptSource::new(memory(&bytes), shelf.clone()), &requests);
    for kept in shelf.0.borrow_mut().kept.values_mut() {
        let mut damaged = kept.to_vec();
        damaged[0] ^= 1;
        *kept = damaged.into();
    }
    let mut source = KeptSource::new(memory(&bytes), shelf.clone());
    assert_eq!(ask(&mut source, &requests), plain);
    assert_eq!(source.stats().from_disk, 0);
    // They were replaced.
    let mut source = KeptSource::new(memory(&bytes), shelf.clone());
    ask(&mut source, &requests);
    assert!(source.stats().from_disk > 0);
    let mut inner = shelf.0.borrow_mut();
    (inner.lies, inner.kept) = (true, BTreeMap::new());
    drop(inner);
    assert_eq!(ask(&mut KeptSource::new(memory(&bytes), shelf), &requests), plain);
}

#[test]
fn no_more_in_flight_than_the_source_allows_and_cancelled_is_never_answered() {
    let bytes = archive(1);
    let (requests, shelf) = (requests(&bytes), Shelf::default());
    ask(&mut KeptSource::new(memory(&bytes), shelf.clone()), &requests);
    let mut source = KeptSource::new(memory(&bytes), shelf);
    ask(&mut source, &requests[..1]);
    let tickets: Vec<_> = requests[1..]
        .iter()
        .filter_map(|request| source.submit(request.clone()))
        .collect();
    assert_eq!((tickets.len(), source.in_flight()), (8, 8));
    tickets[..4].iter().for_each(|ticket| source.cancel(*ticket));
    source.cancel(Ticket(u64::MAX));
    let mut answered: Vec<_> = (0..50)
        .filter_map(|_| source.poll())
        .map(|answer| answer.ticket)
        .collect();
    answered.sort_unstable();
    assert_eq!(answered, tickets[4..]);
    assert_eq!(source.in_flight(), 0);
}
