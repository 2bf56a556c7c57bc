//! Bodies of answers.

use std::{
    io, mem,
    pin::Pin,
    task::{Context, Poll},
};

use bytes::Bytes;
use futures_util::Stream;
use hyper::body::{Body as HttpBody, Frame, SizeHint};

use crate::parts::FileBody;

/// What is sent behind the head of an answer.
pub(crate) enum Body {
    Empty,
    Whole(Bytes),
    /// Read while it is sent.
    File(Box<FileBody>),
    /// Of a length that is not known before.
    Stream(Pin<Box<dyn Stream<Item = io::Result<Bytes>> + Send>>),
}

impl<B: Into<Bytes>> From<B> for Body {
    fn from(bytes: B) -> Self {
        let bytes = bytes.into();
        if bytes.is_empty() {
            Self::Empty
        } else {
            Self::Whole(bytes)
        }
    }
}

impl HttpBody for Body {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        let bytes = match &mut *self {
            Self::Empty => return Poll::Ready(None),
            Self::Whole(bytes) => mem::take(bytes),
            Self::File(file) => {
                return file
                    .poll_part(context)
                    .map(|part| part.map(|part| part.map(Frame::data)));
            }
            Self::Stream(parts) => {
                return parts
                    .as_mut()
                    .poll_next(context)
                    .map(|part| part.map(|part| part.map(Frame::data)));
            }
        };
        *self = Self::Empty;
        Poll::Ready(Some(Ok(Frame::data(bytes))))
    }

    fn is_end_stream(&self) -> bool {
        match self {
            Self::Empty => true,
            Self::Whole(_) | Self::Stream(_) => false,
            Self::File(file) => file.bytes() == 0,
        }
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Empty => SizeHint::with_exact(0),
            Self::Whole(bytes) => SizeHint::with_exact(bytes.len() as u64),
            Self::File(file) => SizeHint::with_exact(file.bytes()),
            Self::Stream(_) => SizeHint::default(),
        }
    }
}
