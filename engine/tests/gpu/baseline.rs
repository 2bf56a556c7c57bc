//! What measurements compare with draws the same pictures.

use super::*;
use scene::btf;

#[test]
fn without_a_page_table_the_picture_is_the_same() {
    let small = Recipe {
        width: 96,
        height: 80,
        groups: 3,
        ..Recipe::default()
    };
    let archives = [Recipe::default().build(), small.build()];
    let archives: [(&str, &[u8]); 2] = [("weave", &archives[0]), ("small", &archives[1])];
    let (mut scene, camera) = scene::still_life();
    scene.materials[1] = btf("small", 2.0);
    let closer = Camera {
        eye: camera.eye * 0.5 + camera.target * 0.5,
        ..camera
    };
    for angular in [
        engine::angular::Angular::Delaunay,
        engine::angular::Angular::Hemisphere,
    ] {
        let options = Options {
            angular,
            component_error: 0.0,
            ..options((96, 54))
        };
        let mut engine = engine(&scene, &archives, options);
        settle(&mut engine, &camera);
        let expected = engine.picture().unwrap();
        engine.draw_resident(&camera).unwrap();
        assert!(engine.picture().unwrap() == expected, "by the page table");
        engine.lay_out_resident().unwrap();
        engine.draw_resident(&camera).unwrap();
        let error = relative_rmse(&engine.picture().unwrap(), &expected);
        assert!(error < 1e-5, "{angular:?}: {error}");
        // Of another view, of which not all is there, it knows no better; and frames are what they were.
        engine.draw_resident(&closer).unwrap();
        assert!(engine.frame(&camera).unwrap().drawn);
        assert!(relative_rmse(&engine.picture().unwrap(), &expected) < 1e-5);
    }
}
