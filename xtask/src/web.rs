//! The viewer for browsers: the module by whichever compiler can make it, and the page around it.
//!
//! Where rustup can add the target, the workspace's own compiler makes the module. Where it cannot, Debian's compiler for browsers
//! does, with a standard library that it builds from source.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

use crate::setup::{apt_install, is_debian_root};
use crate::steps::{cargo, cargo_of};

const TARGET: &str = "wasm32-unknown-unknown";
/// Debian's compiler, cargo, the sources of std, and the linker.
const PACKAGES: [&str; 4] = ["rustc-web", "cargo-web", "rust-web-src", "lld-22"];

/// Builds `web/dist`.
pub(crate) fn build() -> Result<()> {
    let workspace = workspace();
    // Beside the target folder of everything else, whose locks it would wait for and whose artefacts are another compiler's.
    let target = target_folder().join("web");
    let library = [
        "build",
        "--locked",
        "--package",
        "web",
        "--lib",
        "--profile",
        "web",
    ];
    let program = if has_target() {
        cargo(&library)
    } else {
        let rustc = debian_compiler()?;
        cargo(&library)
            .args(["-Zbuild-std=std,panic_abort"])
            .env("RUSTC_BOOTSTRAP", "1")
            .env("RUSTC", rustc)
    };
    program
        .args(["--target", TARGET])
        .args(["--target-dir".as_ref(), target.as_os_str()])
        // Where the sources lie is nobody's business, and would be part of the module.
        .env("CARGO_ENCODED_RUSTFLAGS", remap(&workspace, &target)?)
        .run()?;
    let module = target.join(TARGET).join("web/eigentile_web.wasm");
    let web = workspace.join("web");
    cargo_of(&web.join("pack/Cargo.toml"), &["run", "--quiet", "--locked"])
        .args(["--target-dir".as_ref(), target.join("pack").as_os_str()])
        .args([
            "--".as_ref(),
            module.as_os_str(),
            web.as_os_str(),
            web.join("dist").as_os_str(),
        ])
        .run()
}

pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("")
}

/// Where cargo builds.
pub(crate) fn target_folder() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), PathBuf::from)
}

/// Flags that make paths the same on every machine. Of two that fit the last one counts.
fn remap(workspace: &Path, target: &Path) -> Result<OsString> {
    let home = std::env::var_os("CARGO_HOME")
        .map(PathBuf::from)
        .or_else(|| std::env::home_dir().map(|home| home.join(".cargo")))
        .context("no home folder: set CARGO_HOME")?;
    let mut flags = OsString::new();
    for (path, name) in [(workspace, ""), (home.as_path(), "cargo"), (target, "target/web")] {
        // As cargo parts them; spaces may be in paths.
        if !flags.is_empty() {
            flags.push("\u{1f}");
        }
        flags.push("--remap-path-prefix=");
        flags.push(path);
        flags.push("=");
        flags.push(name);
    }
    Ok(flags)
}

/// Whether the workspace's compiler has the target, after asking rustup for it.
fn has_target() -> bool {
    let library = || {
        let output = Command::new("rustc")
            .args(["--print", "target-libdir", "--target", TARGET])
            .stderr(Stdio::null())
            .output();
        let path = output
            .ok()
            .and_then(|output| String::from_utf8(output.stdout).ok());
        path.is_some_and(|path| Path::new(path.trim()).is_dir())
    };
    if library() {
        return true;
    }
    let added = Command::new("rustup").args(["target", "add", TARGET]).status();
    added.is_ok_and(|status| status.success()) && library()
}

/// Debian's compiler for browsers, installed where that is possible.
fn debian_compiler() -> Result<OsString> {
    if let Some(path) = find_debian_compiler() {
        return Ok(path);
    }
    let command = format!("apt-get install -y {}", PACKAGES.join(" "));
    if !is_debian_root() {
        bail!("no compiler for {TARGET}: run `rustup target add {TARGET}`, or on Debian as root `{command}`");
    }
    apt_install(&PACKAGES)?;
    find_debian_compiler().with_context(|| format!("`{command}` was run, and there is still no rustc-web"))
}

fn find_debian_compiler() -> Option<OsString> {
    let output = Command::new("dpkg").args(["-L", "rustc-web"]).output().ok()?;
    let files = String::from_utf8(output.stdout).ok()?;
    let file = files.lines().find(|file| file.ends_with("bin/rustc"))?;
    Path::new(file).is_file().then(|| file.into())
}
