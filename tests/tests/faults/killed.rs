//! A server that is killed while a client streams, and started again.

use std::time::{Duration, Instant};

use engine::{
    frame::{Budgets, Engine, Options},
    gpu::Context,
    metrics::Picture,
    stream::{TileSource, open_with},
};
use scenes::Camera;
use tests::{PATIENCE, ServerProcess, ask, requests, scene, soon};

use crate::{FIXTURE, NAMES};

#[test]
fn nothing_is_lost() {
    let site = FIXTURE.site();
    let mut server = ServerProcess::start(site.path());
    let mut source = open_with(&server.address, &soon()).unwrap();
    for name in NAMES {
        let all = requests(name, &FIXTURE.archive(name));
        ask(&mut *source, &all, |came, answer, stored| {
            let bytes = answer.bytes.unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(bytes, stored, "{}", answer.request);
            if came == all.len() / 3 || came == all.len() / 2 {
                server.kill_and_restart(site.path());
            }
        });
    }
    assert!(source.stats().retried > 0, "{:?}", source.stats());
}

pub(crate) fn engine(context: &Context, source: Box<dyn TileSource>) -> Engine {
    let options = Options {
        size: (128, 96),
        wait: false,
        budgets: Budgets {
            page_cache_bytes: 32 << 20,
            column_cache_bytes: 8 << 20,
            ..Budgets::default()
        },
        ..Options::default()
    };
    Engine::new(context.clone(), &scene(), source, options).unwrap()
}

/// The picture of a view when it has settled, with all archives.
pub(crate) fn settle_at(engine: &mut Engine, camera: &Camera) -> Picture {
    let frames = engine.settle(camera, PATIENCE).unwrap();
    let last = frames.last().unwrap();
    let problems: Vec<&str> = engine.problems().collect();
    assert!(
        last.settled && last.archives_failed == 0,
        "{last:?}, {problems:?}"
    );
    engine.picture().unwrap()
}

/// But for where records lie in other slots, and texture filters round their coordinates there.
pub(crate) fn assert_close(picture: &Picture, expected: &Picture) {
    let pairs = picture
        .pixels
        .iter()
        .flatten()
        .zip(expected.pixels.iter().flatten());
    for (a, b) in pairs {
        assert!((a - b).abs() < 0.02 * b.abs() + 2e-3, "{a} instead of {b}");
    }
}

/// The picture when all is there; between frames, `between` is told how many pages there are.
fn settle(mut engine: Engine, mut between: impl FnMut(u32)) -> Picture {
    let (begin, camera) = (Instant::now(), scene().cameras[0]);
    loop {
        let stats = engine.frame(&camera).unwrap();
        assert!(begin.elapsed() < PATIENCE, "{stats:?}");
        assert_eq!(
            stats.archives_failed,
            0,
            "{:?}",
            engine.problems().collect::<Vec<_>>()
        );
        if stats.settled {
            return engine.picture().unwrap();
        }
        between(stats.pages_resident);
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn pictures_end_the_same() {
    let context = Context::headless().expect("a graphics adapter");
    let expected = settle(
        engine(
            &context,
            open_with(FIXTURE.tiles().to_str().unwrap(), &soon()).unwrap(),
        ),
        |_| (),
    );
    let site = FIXTURE.site();
    let mut server = ServerProcess::start(site.path());
    let source = open_with(&server.address, &soon()).unwrap();
    // Killed before the first index has come, and again when some pages are there.
    let mut kills = 0;
    let picture = settle(engine(&context, source), |pages| {
        if kills == 0 || (kills == 1 && pages > 0) {
            server.kill_and_restart(site.path());
            kills += 1;
        }
    });
    assert!(kills > 0);
    assert_close(&picture, &expected);
}
