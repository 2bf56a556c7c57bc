//! Fuzzing with the compiler of the workspace: libFuzzer's counters are flags of LLVM, which need no nightly compiler.

use std::path::Path;

use anyhow::{Context, Result};

use crate::steps::{Program, cargo_of};

/// One for each target in `fuzz/Cargo.toml`.
const TARGETS: [&str; 5] = ["index", "page", "column", "pyramid", "request"];
/// What cargo-fuzz passes as well, but for the address sanitizer.
const FLAGS: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1 -Cdebug-assertions=on -Coverflow-checks=on";
/// Longest input, slowest input and largest process that are no failure.
const LIMITS: [&str; 3] = ["-max_len=65536", "-timeout=10", "-rss_limit_mb=2048"];

/// Builds all targets and runs each for some seconds, from where the last run stopped: what it has found is kept in
/// `target/fuzz`, what makes a target fail too.
pub(crate) fn fuzz(seconds: u32) -> Result<()> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("");
    let folder = workspace.join("target/fuzz");
    cargo_of(&workspace.join("fuzz/Cargo.toml"), &["build", "--release"])
        // Without it the flags would hold for build scripts, too, which have no libFuzzer to link with.
        .args(["--target", &host()?])
        .args(["--target-dir".as_ref(), folder.as_os_str()])
        .env("RUSTFLAGS", FLAGS)
        .run()?;
    let programs = folder.join(host()?).join("release");
    for target in TARGETS {
        let corpus = folder.join("corpus").join(target);
        std::fs::create_dir_all(&corpus).with_context(|| format!("cannot make {}", corpus.display()))?;
        Program::new(programs.join(target))
            .args([&corpus, &workspace.join("tileset/tests/fixtures")])
            .args(LIMITS)
            .args([
                format!("-max_total_time={seconds}"),
                format!("-artifact_prefix={}/{target}-", folder.display()),
            ])
            .run()?;
    }
    Ok(())
}

/// The target that the compiler builds for by default.
fn host() -> Result<String> {
    let output = std::process::Command::new("rustc")
        .arg("-vV")
        .output()
        .context("cannot start rustc")?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines()
        .find_map(|line| line.strip_prefix("host: "))
        .map(str::to_owned)
        .context("rustc -vV names no host")
}
