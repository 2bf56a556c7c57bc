//! Why something was not got: a reason that can be given to several requests, and what answers of a host mean.

use std::time::Duration;

use super::super::{Request, transport::Head};
use crate::Error;

/// A reason; errors themselves cannot be cloned.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Trouble {
    /// May pass.
    Passing {
        detail: String,
        retry_after: Option<Duration>,
    },
    /// The host has no such file.
    Missing(String),
    /// The file is another one than before.
    Changed(String),
    /// Asking again is no use.
    Lasting(String),
}

impl Trouble {
    pub(super) fn passing(detail: impl Into<String>) -> Self {
        Trouble::Passing {
            detail: detail.into(),
            retry_after: None,
        }
    }

    /// The error for a request that was to be answered from `url`.
    pub(super) fn error(&self, request: &Request, url: &str) -> Error {
        let what = format!("{request}, from {url}");
        match self {
            Trouble::Passing { detail, retry_after } => Error::Unavailable {
                what,
                detail: detail.clone(),
                retry_after: *retry_after,
            },
            Trouble::Missing(detail) => Error::NotFound(format!("{what} ({detail})")),
            Trouble::Changed(detail) => Error::Changed {
                what,
                detail: format!("the archive changed on the host ({detail}): load it again"),
            },
            Trouble::Lasting(detail) => Error::Source {
                what,
                detail: detail.clone(),
            },
        }
    }

    /// What a status means that is neither 200 nor 206.
    pub(super) fn of_status(head: &Head) -> Self {
        let status = head.status;
        match status {
            404 | 410 => Trouble::Missing(format!("status {status}")),
            408 | 425 | 429 | 500..=599 => Trouble::Passing {
                detail: format!("the host answers with status {status}"),
                retry_after: head.retry_after(),
            },
            401 | 403 => Trouble::Lasting(format!(
                "the host refuses it with status {status}: let everybody read the file, and see that it exists"
            )),
            300..=399 => Trouble::Lasting(format!(
                "status {status}: the redirection to {} is not followed: more than five in a row, away from https, or no address",
                place(head.field("location"))
            )),
            _ => Trouble::Lasting(format!("the host answers with status {status}")),
        }
    }
}

/// An address without its query, which may hold a signature.
fn place(location: Option<&str>) -> &str {
    location
        .and_then(|location| location.split('?').next())
        .unwrap_or("an address that is not said")
}
