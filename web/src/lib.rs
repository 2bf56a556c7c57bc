//! The viewer in a browser: the engine compiled to WebAssembly, drawing with WebGPU, streaming over fetch.
//!
//! - [`kept`]: records kept between visits, over any store that answers later.
//! - `fetch`: the transport over the page's `fetch`, with an AbortController for each GET (`package/fetch.js`).
//! - `database`: the store over the page's IndexedDB (`package/store.js`).
//! - `session`: what the page holds: a scene or an archive in a canvas; input in, frames and a report out.
//! - `words`: what the page asks before: the files of a scene, keys, overlays.
//!
//! Nothing here waits, and nothing runs by itself: the page calls `Session::frame` when the browser wants a
//! frame. Everything that needs a browser is left out elsewhere, so that the rest can be tested there.

pub mod kept;

#[cfg(target_arch = "wasm32")]
mod database;
#[cfg(target_arch = "wasm32")]
mod fetch;
#[cfg(target_arch = "wasm32")]
pub mod session;
#[cfg(target_arch = "wasm32")]
pub mod words;
