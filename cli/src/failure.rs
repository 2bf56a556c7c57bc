//! What went wrong, in one line.

use std::io;

/// The error and its causes, each once: many a message has its cause in it already.
pub(crate) fn one_line(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether the reader of this program's output went away, as `head` does.
pub(crate) fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let kind = error
        .chain()
        .find_map(|cause| cause.downcast_ref::<io::Error>())
        .map(io::Error::kind);
    kind == Some(io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;

    #[test]
    fn a_cause_is_said_once_and_in_one_line() {
        let missing = || Err::<(), _>(io::Error::new(io::ErrorKind::NotFound, "not\nthere"));
        assert_eq!(
            one_line(&missing().context("scene.gltf").unwrap_err()),
            "scene.gltf: not there"
        );
        assert_eq!(
            one_line(&missing().context("scene.gltf: not\nthere").unwrap_err()),
            "scene.gltf: not there"
        );
    }
}
