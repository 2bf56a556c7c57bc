//! Steps with a name and a time, and the programs that they run.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};

/// The steps that were done, and how long each took.
#[derive(Default)]
pub(crate) struct Steps {
    done: Vec<(&'static str, f64)>,
}

impl Steps {
    /// Does a step, and prints its name before and its seconds after it.
    pub(crate) fn run(&mut self, name: &'static str, step: impl FnOnce() -> Result<()>) -> Result<()> {
        eprintln!("== {name}");
        let start = Instant::now();
        step().with_context(|| format!("step {name}"))?;
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("== {name}: {seconds:.1} s");
        self.done.push((name, seconds));
        Ok(())
    }

    /// Prints all steps in one line.
    pub(crate) fn summary(&self) {
        if self.done.len() > 1 {
            let steps: Vec<String> = self
                .done
                .iter()
                .map(|(name, seconds)| format!("{name} {seconds:.1} s"))
                .collect();
            eprintln!("== done: {}", steps.join(", "));
        }
    }
}

/// A program with its arguments.
pub(crate) struct Program(Command);

/// The cargo that runs this program, on this workspace, in the folder where the user is.
pub(crate) fn cargo(arguments: &[&str]) -> Program {
    cargo_of(
        &Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("Cargo.toml"),
        arguments,
    )
}

/// The same on another workspace.
pub(crate) fn cargo_of(manifest: &Path, arguments: &[&str]) -> Program {
    let (command, rest) = arguments.split_first().unwrap_or((&"help", &[]));
    let program = Program::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    program
        .args([command])
        .args([OsStr::new("--manifest-path"), manifest.as_os_str()])
        .args(rest)
}

impl Program {
    pub(crate) fn new(name: impl AsRef<OsStr>) -> Self {
        Self(Command::new(name))
    }

    pub(crate) fn args(mut self, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Self {
        self.0.args(arguments);
        self
    }

    pub(crate) fn env(mut self, name: &str, value: impl AsRef<OsStr>) -> Self {
        self.0.env(name, value);
        self
    }

    /// Runs the program with this one's input and output.
    pub(crate) fn run(mut self) -> Result<()> {
        let name = self.0.get_program().to_string_lossy().into_owned();
        let status = self.0.status().with_context(|| format!("cannot start {name}"))?;
        if !status.success() {
            bail!("{name} failed: {status}");
        }
        Ok(())
    }
}
