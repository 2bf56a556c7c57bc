//! Temporary.
use preprocess::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut o = Options::new(&a[1], &a[2]);
    for kv in &a[3..] { let (k, v) = kv.split_once('=').unwrap(); match k { "c" => o.settings.components = v.parse().unwrap(), "m" => o.settings.memory_bytes = v.parse().unwrap(), "p" => o.settings.power_iterations = v.parse().unwrap(), "q" => o.quality = v.parse().unwrap(), _ => panic!() } }
    match run(&o, &|_| ()) { Ok(mut r) => { r.singular_values.truncate(4); println!("{}", serde_json::to_string_pretty(&r).unwrap()) } Err(e) => { eprintln!("{e}"); std::process::exit(1) } }
    if std::env::var("EXPORT").is_ok() { export(a[2].as_ref(), std::env::var("EXPORT").unwrap().as_ref(), &|_| ()).unwrap(); }
}
