//! Servers that are killed, archives that are damaged, disks that are full, and all of it for a while: what is not hit goes on.

mod corrupt;
mod full_disk;
mod killed;
mod pictures;
mod soak;
mod versions;

use std::sync::LazyLock;

use tests::Fixture;

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);
const NAMES: [&str; 2] = ["leather", "studs"];

/// Not a test by itself: see [`tests::ServerProcess`].
#[test]
fn server_process() {
    tests::serve_if_asked();
}
