//! Runs the real program. Each file of tests uses a part of this.
#![allow(dead_code, unreachable_pub, missing_docs)]

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// The program with arguments, without what the user's environment might change.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_eigentile"));
    command
        .args(arguments)
        .env_remove("RUST_LOG")
        .env_remove("XDG_RUNTIME_DIR");
    command
}

/// Runs to the end in a folder.
pub fn run(folder: &Path, arguments: &[&str]) -> Output {
    command(arguments)
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

/// Runs what must succeed; what it printed.
pub fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Runs what must succeed with --json; what it printed, and nothing beside it.
pub fn succeed_json(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.success() && errors.is_empty(),
        "{arguments:?}: {errors}"
    );
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Runs what must fail; its one line.
pub fn fail(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let errors = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {errors}");
    assert_eq!(
        (errors.lines().count(), errors.starts_with("error: ")),
        (1, true),
        "{arguments:?}: {errors}"
    );
    assert!(output.stdout.is_empty());
    errors
}

/// `eigentile serve` on a free port.
pub struct Server {
    child: Child,
    pub address: String,
}

impl Server {
    pub fn start(folder: &Path) -> Self {
        Self::start_at(folder, "127.0.0.1:0")
    }

    /// At an address of this machine.
    pub fn start_at(folder: &Path, listen: &str) -> Self {
        let arguments = ["serve", "--listen", listen, folder.to_str().expect("UTF-8")];
        let mut child = command(&arguments)
            .env("RUST_LOG", "info")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the server starts");
        let mut line = String::new();
        let output = child.stdout.as_mut().expect("piped");
        BufReader::new(output).read_line(&mut line).expect("a first line");
        let address = line
            .trim()
            .strip_prefix("listening on ")
            .expect("an address")
            .to_owned();
        Self { child, address }
    }

    /// Asks it to stop, as a service manager does; its log.
    pub fn stop(mut self) -> String {
        let stopped = Command::new("kill")
            .arg(self.child.id().to_string())
            .status()
            .expect("kill runs");
        assert!(stopped.success());
        let mut log = String::new();
        self.child
            .stderr
            .take()
            .expect("piped")
            .read_to_string(&mut log)
            .expect("UTF-8");
        assert!(self.child.wait().expect("it ends").success(), "{log}");
        log
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // After a failed test; one that has ended cannot be killed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
