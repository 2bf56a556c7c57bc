//! Archives that are replaced on a server while they are shown.

use std::time::Instant;

use engine::{gpu::Context, stream::open_with};
use scenes::Camera;
use tests::{PATIENCE, ServerProcess, ask, requests, scene, soon};

use crate::{
    FIXTURE, NAMES,
    killed::{assert_close, engine, settle_at},
};

/// Waits until the server, which looks at its folder now and then, has the second archive in the place of the first.
fn await_index(address: &str) {
    let index = |name: &str| requests(name, &FIXTURE.archive(name)).remove(0);
    let ((asked, old), (_, new)) = (index(NAMES[0]), index(NAMES[1]));
    let begin = Instant::now();
    let mut there = false;
    while !there {
        assert!(begin.elapsed() < PATIENCE, "the server goes on with the old one");
        let mut source = open_with(address, &soon()).unwrap();
        ask(&mut *source, &[(asked.clone(), old.clone())], |_, answer, _| {
            there = answer.bytes.is_ok_and(|bytes| bytes == new);
        });
    }
}

#[test]
fn the_picture_ends_as_that_of_the_new_archive() {
    let context = Context::headless().expect("a graphics adapter");
    let near = scene().cameras[0];
    let far = Camera {
        eye: near.target + 8.0 * (near.eye - near.target),
        ..near
    };
    // The first material becomes the second.
    let (site, changed) = (FIXTURE.site(), FIXTURE.site());
    let replace = |site: &tempfile::TempDir| {
        let path = site.path().join(format!("{}.bsvtf", NAMES[0]));
        // At once, as whoever replaces a file that is being served should.
        let beside = site.path().join("new");
        std::fs::copy(FIXTURE.archive(NAMES[1]), &beside).unwrap();
        std::fs::rename(beside, path).unwrap();
    };
    replace(&changed);
    let folder = open_with(changed.path().to_str().unwrap(), &soon()).unwrap();
    let expected = settle_at(&mut engine(&context, folder), &near);
    let folder = open_with(site.path().to_str().unwrap(), &soon()).unwrap();
    let before = settle_at(&mut engine(&context, folder), &near);
    assert!(before.pixels != expected.pixels, "it can be seen");

    let server = ServerProcess::start(site.path());
    let mut engine = engine(&context, open_with(&server.address, &soon()).unwrap());
    settle_at(&mut engine, &far);
    replace(&site);
    await_index(&server.address);
    let picture = settle_at(&mut engine, &near);
    assert!(
        engine.problems().any(|problem| problem.contains("changed")),
        "{:?}",
        engine.problems().collect::<Vec<_>>()
    );
    assert_close(&picture, &expected);
    drop(server);
}
