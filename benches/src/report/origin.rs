//! By what and on what something was measured.

use std::fmt;
use std::process::Command;
use std::thread;

use serde::{Deserialize, Serialize};

/// By what and on what something was measured: it belongs to every figure that is kept.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// The command line, the program without its folder.
    pub command: String,
    /// Adapter and driver, where pictures were drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// What git says of the folder in which the command was given, where that is a checkout.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// The computer.
    #[serde(default)]
    pub machine: Machine,
}

/// A computer.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Cores that the program may use.
    pub cores: usize,
    /// Its processor, as the system calls it; empty where it does not.
    pub processor: String,
}

impl Origin {
    /// Of this process.
    pub fn here(device: Option<String>) -> Self {
        Self {
            command: command(std::env::args()),
            device,
            commit: commit(),
            machine: Machine::here(),
        }
    }
}

/// In Markdown.
impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}`; {}", self.command, self.machine)?;
        if let Some(device) = &self.device {
            write!(f, ", {device}")?;
        }
        match &self.commit {
            Some(commit) => write!(f, "; commit {commit}."),
            None => write!(f, "."),
        }
    }
}

impl Machine {
    fn here() -> Self {
        let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default(); // elsewhere nothing is told
        let name = told
            .lines()
            .find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        Self {
            cores: thread::available_parallelism().map_or(1, usize::from),
            processor: name.map_or("", |(_, name)| name).trim().to_owned(),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.cores == 1 { "" } else { "s" };
        write!(f, "{} core{plural}", self.cores)?;
        if self.processor.is_empty() {
            Ok(())
        } else {
            write!(f, " of {}", self.processor)
        }
    }
}

/// A command line that a shell takes.
fn command(mut arguments: impl Iterator<Item = String>) -> String {
    let program = arguments.next().unwrap_or_default();
    let name = program.rsplit(['/', '\\']).next().unwrap_or_default().to_owned();
    let plain = |text: &str| {
        !text.is_empty()
            && text
                .chars()
                .all(|c| c.is_alphanumeric() || "-_=./:,+@%".contains(c))
    };
    let quoted = arguments.map(|text| {
        if plain(&text) {
            text
        } else {
            format!("'{}'", text.replace('\'', "'\\''"))
        }
    });
    [name].into_iter().chain(quoted).collect::<Vec<_>>().join(" ")
}

/// What git says of the working folder, if it is there.
fn commit() -> Option<String> {
    let output = Command::new("git")
        .args(["describe", "--always", "--dirty"])
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_read_well() {
        let origin = Origin {
            command: "eigentile bench x".into(),
            device: Some("d".into()),
            commit: Some("c".into()),
            ..Origin::default()
        };
        assert_eq!(origin.to_string(), "`eigentile bench x`; 0 cores, d; commit c.");
    }

    #[test]
    fn commands_can_be_given_again() {
        let arguments = ["/usr/bin/eigentile", "bench", "a b", "it's", "--size=3x4", ""];
        assert_eq!(
            command(arguments.into_iter().map(String::from)),
            "eigentile bench 'a b' 'it'\\''s' --size=3x4 ''"
        );
    }
}
