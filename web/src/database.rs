//! Records in the page's IndexedDB, by `package/store.js`.

use bytes::Bytes;
use wasm_bindgen::prelude::*;

use crate::kept::Store;

#[wasm_bindgen]
extern "C" {
    /// `Store` of `package/store.js`.
    pub type Database;

    #[wasm_bindgen(method)]
    fn holds(this: &Database, key: &str) -> bool;
    #[wasm_bindgen(method)]
    fn get(this: &Database, number: f64, key: &str);
    #[wasm_bindgen(method)]
    fn poll(this: &Database) -> Option<Found>;
    #[wasm_bindgen(method)]
    fn put(this: &Database, key: &str, bytes: Vec<u8>);
    #[wasm_bindgen(method)]
    fn remove(this: &Database, key: &str);

    /// An answer.
    type Found;

    #[wasm_bindgen(method, getter)]
    fn number(this: &Found) -> f64;
    #[wasm_bindgen(method, getter)]
    fn bytes(this: &Found) -> Option<Vec<u8>>;
}

impl Store for Database {
    fn holds(&self, key: &str) -> bool {
        Database::holds(self, key)
    }

    fn get(&mut self, number: u64, key: &str) {
        Database::get(self, number as f64, key);
    }

    fn poll(&mut self) -> Option<(u64, Option<Bytes>)> {
        let found = Database::poll(self)?;
        Some((found.number() as u64, found.bytes().map(Bytes::from)))
    }

    fn put(&mut self, key: &str, bytes: &Bytes) {
        Database::put(self, key, bytes.to_vec());
    }

    fn remove(&mut self, key: &str) {
        Database::remove(self, key);
    }
}
