//! Archives that are damaged on the server, in pictures: what shows another material is as if nothing had happened.

use std::time::{Duration, Instant};

use engine::{gpu::Context, stream::open_with};
use scenes::Surface;
use tests::{PATIENCE, Server, soon};
use tileset::Archive;

use crate::{
    FIXTURE, NAMES,
    killed::{engine, settle_at},
};

/// What is damaged: the records of all pages, those of columns too, or the manifest.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Damage {
    Pages,
    Everything,
    Manifest,
}

fn damage(mut bytes: Vec<u8>, what: Damage) -> Vec<u8> {
    let index = Archive::open(bytes.clone()).unwrap().index;
    if what == Damage::Manifest {
        bytes[100] ^= 1;
        return bytes;
    }
    let columns = index.columns().iter().filter(|_| what == Damage::Everything);
    for record in index
        .pages()
        .iter()
        .chain(columns)
        .filter(|record| record.length > 0)
    {
        bytes[record.offset as usize + record.length as usize / 2] ^= 0x10;
    }
    bytes
}

#[test]
fn other_materials_look_as_ever() {
    let (context, [bad, good]) = (Context::headless().expect("a graphics adapter"), NAMES);
    let folder = open_with(FIXTURE.tiles().to_str().unwrap(), &soon()).unwrap();
    let mut whole = engine(&context, folder);
    let expected = settle_at(&mut whole, &tests::scene().cameras[0]);
    // Of every pixel the archive that it shows.
    let scene = tests::scene();
    let shows = |ids: &[u32; 2]| {
        let instance = ids[0].checked_sub(1)?;
        let mesh = scene.instances[instance as usize].mesh;
        match &scene.materials[scene.meshes[mesh].material].surface {
            Surface::Btf { archive, .. } => Some(archive.clone()),
            Surface::Diffuse { .. } => None,
        }
    };
    let shown: Vec<Option<String>> = whole.visibility().unwrap().iter().map(shows).collect();
    for what in [Damage::Pages, Damage::Everything, Damage::Manifest] {
        let site = FIXTURE.site();
        let path = site.path().join(format!("{bad}.bsvtf"));
        std::fs::write(&path, damage(std::fs::read(&path).unwrap(), what)).unwrap();
        let server = Server::start(site.path());
        let mut engine = engine(&context, open_with(&server.address, &soon()).unwrap());
        // It goes on asking for what is damaged, now and then; the other one does not wait for that.
        let begin = Instant::now();
        let others = loop {
            engine.frame(&scene.cameras[0]).unwrap();
            let picture = engine.picture().unwrap();
            let pixels = picture.pixels.iter().zip(&expected.pixels).zip(&shown);
            let same = |a: &[f32; 3], b: &[f32; 3]| {
                a.iter()
                    .zip(b)
                    .all(|(a, b)| (a - b).abs() < 0.02 * b.abs() + 2e-3)
            };
            let (of_good, others): (Vec<_>, Vec<_>) =
                pixels.partition(|(_, shown)| shown.as_deref() == Some(good));
            assert!(of_good.len() > 500);
            let told = engine.problems().any(|problem| problem.contains(bad));
            if told && of_good.iter().all(|((a, b), _)| same(a, b)) {
                break others.iter().filter(|((a, b), _)| !same(a, b)).count();
            }
            assert!(
                begin.elapsed() < PATIENCE,
                "{what:?}: {:?}",
                engine.problems().collect::<Vec<_>>()
            );
            std::thread::sleep(Duration::from_millis(1));
        };
        assert!(
            others > 500,
            "{what:?}: {others} pixels of the damaged one differ"
        );
        let problems: Vec<&str> = engine.problems().collect();
        assert!(
            !problems.iter().any(|problem| problem.contains(good)),
            "{what:?}: {problems:?}"
        );
    }
}
