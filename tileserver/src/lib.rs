//! Serves a folder of `.bsvtf` archives over HTTP/1.1; docs/http.md is the protocol.
//!
//! - [`Collection`]: the archives of a folder, found by listing it, opened once.
//! - [`run`]: the service on a socket, until it is told to stop.
//! - [`router`]: the service itself, for programs that bring their own socket.
//!
//! A record is checked against its hash before it is sent; addresses of records carry the content id of their
//! archive and never change their content, so that any cache may keep them for good. The server holds no
//! state beside the directories of its archives: any number of them can serve the same folder.
//!
//! Not done here: TLS, compression (records are compressed), authentication. A reverse proxy does these.

mod budget;
mod collection;
mod conditional;
mod connection;
mod documents;
mod error;
mod failure;
mod log;
mod options;
mod range;
mod routes;
mod whole;

pub use collection::{Collection, MAX_ARCHIVES};
pub use connection::run;
pub use error::{Error, Result};
pub use options::Options;
pub use routes::router;
