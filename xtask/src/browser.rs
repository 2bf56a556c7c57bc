//! The tests in a browser: what they need, and running them.
//!
//! Chromium and Node.js come from the system; playwright-core, which drives the one from the other, from npm, in the version that
//! `web/tests/package-lock.json` says, into a folder that git ignores.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::setup::{apt_install, found_on_path, is_debian_root};
use crate::steps::{Program, cargo};
use crate::web::{target_folder, workspace};

/// Finds Chromium and Node.js, or installs them, or says how to; and what npm has.
pub(crate) fn setup() -> Result<()> {
    let wanted = [
        (has_chromium(), vec!["chromium"]),
        (
            found_on_path("node") && found_on_path("npm"),
            vec!["nodejs", "npm"],
        ),
    ];
    let missing: Vec<_> = wanted
        .into_iter()
        .filter(|(there, _)| !there)
        .flat_map(|(_, names)| names)
        .collect();
    if !missing.is_empty() {
        if !is_debian_root() {
            bail!(
                "the tests in a browser need {}: on Debian run `sudo apt-get install -y {}`; elsewhere install them, and set CHROMIUM to \
                 Chromium's program if it is not in /usr/bin",
                missing.join(", "),
                missing.join(" ")
            );
        }
        apt_install(&missing)?;
    }
    let tests = tests();
    let (lock, done) = (
        tests.join("package-lock.json"),
        tests.join("node_modules/.package-lock.json"),
    );
    let time = |path: &Path| std::fs::metadata(path).and_then(|file| file.modified()).ok();
    if time(&done).is_some_and(|done| time(&lock).is_some_and(|lock| lock <= done)) {
        return Ok(());
    }
    Program::new("npm")
        .args(["ci", "--no-audit", "--no-fund", "--loglevel=error"])
        .args(["--prefix".as_ref(), tests.as_os_str()])
        .run()
}

/// Runs them on the program of the tests before, and on `web/dist`.
pub(crate) fn test() -> Result<()> {
    // Of the whole workspace, as in the tests before: other features would build half of it again.
    cargo(&["build", "--workspace", "--bin", "eigentile"]).run()?;
    let program = target_folder().join("debug/eigentile");
    let tests = tests();
    Program::new("node")
        .args([
            &tests.join("browser.mjs"),
            &program,
            &workspace().join("web/dist"),
        ])
        .env("NODEVICE_SELECT", "1")
        .run()
        .context("the viewer in Chromium")
}

fn tests() -> PathBuf {
    workspace().join("web/tests")
}

/// Where `web/tests/chromium.mjs` looks for it.
fn has_chromium() -> bool {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let places = [
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
        "/usr/bin/google-chrome",
        "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    ];
    named
        .into_iter()
        .chain(places.map(PathBuf::from))
        .any(|path| path.is_file())
}
