//! GETs over the page's `fetch`. What JavaScript does is in `package/fetch.js`; what came in between is asked for once a frame.

use std::time::Duration;

use bytes::Bytes;
use engine::stream::{Event, Get, GetId, Head, Transport};
use wasm_bindgen::prelude::*;

#[wasm_bindgen]
extern "C" {
    /// `Fetcher` of `package/fetch.js`.
    pub type Fetcher;

    #[wasm_bindgen(method)]
    fn start(
        this: &Fetcher,
        id: f64,
        url: &str,
        first: Option<f64>,
        end: Option<f64>,
        if_range: Option<String>,
        anew: bool,
    );
    #[wasm_bindgen(method)]
    fn abort(this: &Fetcher, id: f64);
    #[wasm_bindgen(method)]
    fn poll(this: &Fetcher) -> Option<Happening>;

    /// What became of a GET.
    type Happening;

    #[wasm_bindgen(method, getter)]
    fn id(this: &Happening) -> f64;
    #[wasm_bindgen(method, getter)]
    fn kind(this: &Happening) -> u32;
    #[wasm_bindgen(method, getter)]
    fn status(this: &Happening) -> u16;
    /// `name: value` on each line.
    #[wasm_bindgen(method, getter)]
    fn fields(this: &Happening) -> String;
    #[wasm_bindgen(method, getter)]
    fn data(this: &Happening) -> Vec<u8>;
    #[wasm_bindgen(method, getter)]
    fn detail(this: &Happening) -> String;
}

/// As in `package/fetch.js`.
const HEAD: u32 = 0;
const BODY: u32 = 1;
const END: u32 = 2;

/// The transport. Redirections are followed by the browser, which knows where they may lead.
pub(crate) struct FetchTransport {
    fetcher: Fetcher,
    next: u64,
}

impl FetchTransport {
    pub(crate) fn new(fetcher: Fetcher) -> Self {
        Self { fetcher, next: 0 }
    }
}

impl Transport for FetchTransport {
    fn start(&mut self, get: Get) -> GetId {
        let id = GetId(self.next);
        self.next += 1;
        let range = get.range.map(|range| (range.start as f64, range.end as f64));
        let (first, end) = range.unzip();
        self.fetcher
            .start(id.0 as f64, &get.url, first, end, get.if_range, get.anew);
        id
    }

    fn abort(&mut self, id: GetId) {
        self.fetcher.abort(id.0 as f64);
    }

    fn poll(&mut self) -> Option<(GetId, Event)> {
        let happening = self.fetcher.poll()?;
        let event = match happening.kind() {
            HEAD => Event::Head(head(happening.status(), &happening.fields())),
            BODY => Event::Body(Bytes::from(happening.data())),
            END => Event::End,
            _ => Event::Failed(happening.detail()),
        };
        Some((GetId(happening.id() as u64), event))
    }

    fn wait(&mut self, _limit: Duration) {}
}

fn head(status: u16, fields: &str) -> Head {
    let pairs = fields.lines().filter_map(|line| line.split_once(": "));
    Head {
        status,
        fields: pairs
            .map(|(name, value)| (name.to_owned(), value.to_owned()))
            .collect(),
        // The status line, and two bytes at the end of each line.
        wire_bytes: (fields.len() + fields.lines().count() + 20) as u64,
    }
}
