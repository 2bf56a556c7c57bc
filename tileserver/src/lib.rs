//! Serves `.bsvtf` archives over HTTP; docs/http.md is the protocol, docs/serving.md is for those who run it.
//!
//! - [`Store`]: where archives lie: a [`Folder`], [`Objects`] of a bucket, or what a program brings.
//! - [`Collection`]: the archives of a store, found by listing it, opened once.
//! - [`Site`]: collections and their places, the files of a web page ([`StaticFiles`]), and the certificate.
//! - [`fn@run`]: the service on a socket, until it is told to stop.
//!
//! A record is checked against its hash before it is sent; addresses of records carry the content id of their
//! archive and never change their content, so that any cache may keep them for good. The server holds no
//! state beside the directories of its archives and the records asked for lately: any number of them can serve
//! the same store.
//!
//! A request goes through `log` (its id, the access log, what is counted), `guard` (is there a place for it, has it
//! a token) and `routes`; `service` finds the archive in the `collection`, `records` the record in memory or
//! through `reads` in the `store`; `budget` bounds the memory of answers, `connection` everything a client can do
//! slowly.
//!
//! Pages and columns are never compressed again, and nothing that clients send is kept.

mod address;
mod answer;
mod batch;
mod beside;
mod body;
mod budget;
mod collection;
mod conditional;
mod connection;
mod documents;
mod error;
mod failure;
#[cfg(fuzzing)]
pub mod fuzzing;
mod guard;
mod log;
mod metrics;
mod open_files;
mod options;
mod parts;
mod pulse;
mod range;
mod reads;
mod records;
mod routes;
mod run;
mod service;
mod site;
mod static_files;
mod status;
pub mod store;
mod tls;
mod workers;

pub use beside::MAX_FILES;
pub use collection::{Collection, MAX_ARCHIVES};
pub use error::{Error, Result};
pub use open_files::raise_open_files;
pub use options::Options;
pub use run::run;
pub use site::Site;
pub use static_files::StaticFiles;
pub use store::{Folder, Objects, Store};
pub use tls::Tls;
