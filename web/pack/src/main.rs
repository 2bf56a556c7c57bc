//! `pack MODULE.wasm WEB DIST`: JavaScript for the module, the page and the npm package beside it, and everything compressed.
//!
//! ```text
//! DIST/                    the page: what a web server serves
//! DIST/eigentile-viewer/   the npm package, which the page uses as anybody else does
//! ```
//!
//! The same input gives the same bytes.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use wasm_bindgen_cli_support::Bindgen;

/// Largest module, compressed.
const MOST_BYTES: usize = 1_500_000;
/// Files shorter than this are served as they are.
const LEAST_BYTES: usize = 512;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, module, web, dist] = &arguments[..] else {
        anyhow::bail!("usage: pack MODULE.wasm WEB DIST");
    };
    let (web, dist) = (Path::new(web), Path::new(dist));
    let package = dist.join("eigentile-viewer");
    if dist.exists() {
        std::fs::remove_dir_all(dist).with_context(|| format!("cannot clear {}", dist.display()))?;
    }
    copy(&web.join("site"), dist)?;
    copy(&web.join("package"), &package)?;
    Bindgen::new()
        .input_path(module)
        .web(true)?
        .out_name("engine")
        .typescript(true)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(&package)
        .context("wasm-bindgen")?;
    let mut files = Vec::new();
    list(dist, &mut files)?;
    for file in &files {
        compress(file)?;
    }
    Ok(())
}

/// Copies the files of a folder and of those in it.
fn copy(from: &Path, to: &Path) -> Result<()> {
    std::fs::create_dir_all(to).with_context(|| format!("cannot make {}", to.display()))?;
    for entry in std::fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))? {
        let entry = entry?;
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &to)?;
        } else {
            std::fs::copy(&path, &to).with_context(|| format!("cannot copy {}", path.display()))?;
        }
    }
    Ok(())
}

/// All files below a folder, by name.
fn list(folder: &Path, files: &mut Vec<std::path::PathBuf>) -> Result<()> {
    let mut entries: Vec<_> = std::fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            list(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

/// Writes FILE.br beside what a browser loads, where that is shorter.
fn compress(file: &Path) -> Result<()> {
    let extension = file.extension().and_then(|extension| extension.to_str());
    if !matches!(extension, Some("wasm" | "js" | "css" | "html" | "json" | "svg")) {
        return Ok(());
    }
    let bytes = std::fs::read(file)?;
    let mut compressed = Vec::new();
    {
        let mut writer = brotli::CompressorWriter::new(&mut compressed, 1 << 16, 11, 22);
        writer.write_all(&bytes)?;
    }
    let name = file.display();
    if extension == Some("wasm") {
        println!("{name}: {} bytes, {} with brotli", bytes.len(), compressed.len());
        ensure!(
            compressed.len() <= MOST_BYTES,
            "{name} has {} bytes with brotli; it may have {MOST_BYTES}",
            compressed.len()
        );
    }
    if bytes.len() >= LEAST_BYTES && compressed.len() < bytes.len() {
        std::fs::write(file.with_added_extension("br"), compressed)?;
    }
    Ok(())
}
