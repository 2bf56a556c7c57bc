//! A frame of a settled view allocates nothing. Alone in its program, since it counts all that its thread allocates.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

use benches::engine::built_in;
use engine::frame::{Engine, Options};
use engine::gpu::Context;

/// Counts what each thread allocates.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: all is left to the system's allocator; counting neither allocates nor needs a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promises are those that are asked for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: likewise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_frame_of_a_settled_view_allocates_nothing() {
    // With debug assertions, wgpu keeps a backtrace of who locked a device last, where backtraces are asked for.
    // SAFETY: no other test runs in this program, so no other thread reads the environment.
    unsafe { std::env::set_var("RUST_LIB_BACKTRACE", "0") };
    let subject = built_in(3, 1, 40).unwrap();
    let options = Options {
        size: (64, 36),
        wait: false,
        ..Options::default()
    };
    let source = subject.archives.source().unwrap();
    let mut engine = Engine::new(Context::headless().unwrap(), &subject.scene, source, options).unwrap();
    engine.wait_for_materials(Duration::from_secs(60)).unwrap();
    let mut most = 0;
    for camera in &subject.flight {
        let before = ALLOCATIONS.get();
        engine.step(camera).unwrap();
        most = most.max(ALLOCATIONS.get() - before);
        engine.wait().unwrap();
    }
    println!("at most {most} allocations in a frame in motion");
    let camera = subject.cameras[0];
    assert!(
        engine
            .settle(&camera, Duration::from_secs(60))
            .unwrap()
            .last()
            .unwrap()
            .settled
    );
    // What the GPU still has to say of the last pictures.
    for _ in 0..3 {
        engine.wait().unwrap();
        engine.frame(&camera).unwrap();
    }
    let before = ALLOCATIONS.get();
    for _ in 0..10 {
        engine.frame(&camera).unwrap();
    }
    assert_eq!(ALLOCATIONS.get() - before, 0);
}
