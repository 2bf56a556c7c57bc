//! Tests that cross crates: from a BTF through archive, server and source to a picture.
//!
//! The tests are in `tests/`; here is what they share: a small material, a scene that shows it, a server, and
//! all records of an archive to ask for.
//! The program itself is tested beside it, in `cli/tests`.

mod fixture;
mod process;
mod records;
mod server;

pub use fixture::{Fixture, SIZE, scene};
pub use process::{ServerProcess, own, serve_if_asked};
pub use records::{PATIENCE, ask, requests, soon};
pub use server::Server;
