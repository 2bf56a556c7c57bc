//! Lists the files of `web/dist`, where the viewer's page is built, for `serve/viewer.rs` to take in.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("..");
    let dist = root.join("web/dist");
    // A path that is not there would have this run in every build.
    println!("cargo::rerun-if-changed=build.rs");
    for path in [root.join("Cargo.toml"), root.join("web"), dist.clone()] {
        if path.exists() {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    let mut list = String::from("&[\n");
    if dist.join("index.html").is_file() {
        add(&dist.canonicalize()?, "", &mut list)?;
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join("viewer.rs"), list + "]")
}

/// A line for each file of a folder, in the order of their names.
fn add(folder: &Path, prefix: &str, list: &mut String) -> io::Result<()> {
    let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            add(&entry.path(), &format!("{name}/"), list)?;
        } else if !name.starts_with('.') {
            list.push_str(&format!("    ({name:?}, include_bytes!({:?})),\n", entry.path()));
        }
    }
    Ok(())
}
