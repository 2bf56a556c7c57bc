//! What went wrong without stopping the picture, for the user to read.

use std::collections::VecDeque;

/// Most messages that are kept; older ones go.
const KEPT: usize = 64;

/// The newest messages.
#[derive(Default)]
pub(super) struct Problems {
    messages: VecDeque<String>,
    /// Messages that nobody has been told of yet: the last so many.
    untold: usize,
}

impl Problems {
    /// Adds a message and gives it back.
    pub(super) fn add(&mut self, message: String) -> String {
        if self.messages.len() == KEPT {
            self.messages.pop_front();
        }
        self.messages.push_back(message.clone());
        self.untold = (self.untold + 1).min(KEPT);
        message
    }

    /// Messages, the oldest first.
    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.messages.iter().map(String::as_str)
    }

    /// Those since the last call.
    pub(super) fn untold(&mut self) -> impl Iterator<Item = &str> {
        let told = self.messages.len() - std::mem::take(&mut self.untold);
        self.iter().skip(told)
    }
}
