//! scratch
#![allow(missing_docs, unreachable_pub, dead_code)]
#[path = "../tests/gpu/material.rs"]
mod material;
#[path = "../tests/gpu/scene.rs"]
mod scene;
use engine::{frame::{Engine, Options}, gpu::Context};
use glam::Vec3;
fn cpu() -> f64 { let s = std::fs::read_to_string("/proc/self/stat").unwrap(); let f: Vec<&str> = s.rsplit(')').next().unwrap().split_whitespace().collect(); (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) * 10.0 }
fn main() {
    if std::env::args().nth(1).as_deref() == Some("dump") { std::fs::write("/tmp/gpu/shade.wgsl", shaders::shader("shade").unwrap()).unwrap(); return; }
    let groups: u16 = std::env::args().nth(1).map_or(25, |a| a.parse().unwrap());
    let recipe = material::Recipe { groups, ..Default::default() };
    let path = format!("/tmp/gpu/speed{groups}.bsvtf");
    let bytes = std::fs::read(&path).unwrap_or_else(|_| { let b = recipe.build(); std::fs::write(&path, &b).unwrap(); b });
    let names = ["a", "b", "c", "d"];
    let archives: Vec<(&str, &[u8])> = names.iter().map(|n| (*n, &bytes[..])).collect();
    let (mut scene, camera) = scene::still_life();
    scene.materials = vec![scene::btf("a", 4.0), scene::btf("b", 2.0), scene::btf("c", 2.0), scene::btf("d", 3.0)];
    scene.meshes.push(scene::sphere(3, 64, 32));
    let mut third = scene.instances[1]; third.mesh = 3; third.world_from_mesh.translation += glam::Vec3A::new(0.9, -0.3, 1.0); scene.instances.push(third);
    scene.background = Vec3::splat(0.1);
    let options = Options { size: (640, 360), page_cache_bytes: 128 << 20, column_cache_bytes: 128 << 20, ..Default::default() };
    let mut engine = Engine::new(Context::headless().unwrap(), &scene, material::source(&archives), options).unwrap();
    engine.wait_for_materials(std::time::Duration::from_secs(9)).unwrap();
    let t = std::time::Instant::now();
    let mut best = engine::gpu::GpuMilliseconds { shade: 1e9, ..Default::default() };
    let mut frames = vec![]; { let mut c = camera; let mut small = engine; small.resize((64,36)).unwrap(); frames = small.settle(&c, std::time::Duration::from_secs(120)).unwrap(); small.resize((640,360)).unwrap(); for _ in 0..20 { let s = small.frame(&c).unwrap(); if s.settled { break } } engine = small; }
    let last = frames.last().unwrap();
    println!("settled {} frames {} in {:?} pages {}/{} columns {}", last.settled, frames.len(), t.elapsed(), last.pages_resident, last.pages_wanted, last.columns_resident);
    for i in 1..5 {
        let mut c = camera; c.eye.x += 0.001 * i as f32;
        let before = cpu();
        let s = engine.frame(&c).unwrap();
        let g = s.ms.gpu.unwrap();
        println!("cpu {:.0} ms wall: draw {:.1} shade {:.0} pages {}", cpu() - before, s.ms.draw, g.shade, s.pages_resident);
        if g.shade < best.shade { best = g; }
    }
    println!("{}: best {best:?}", engine.adapter());
    let p = engine.tonemapped().unwrap();
    image::save_buffer("/tmp/gpu/speed.png", &p, 640, 360, image::ColorType::Rgba8).unwrap();
}
