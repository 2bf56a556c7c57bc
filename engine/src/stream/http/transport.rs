//! GETs over hyper, on one thread of their own.

use std::{
    collections::{HashMap, VecDeque},
    sync::{
        Arc,
        mpsc::{Receiver, Sender, channel},
    },
    time::Duration,
};

use http_body_util::BodyExt;
use hyper::{HeaderMap, header};
use tokio::{
    runtime::Runtime,
    sync::{OwnedSemaphorePermit, Semaphore},
    task::AbortHandle,
    time::timeout,
};

use super::{
    super::transport::{Event, Get, GetId, Head, Transport},
    HttpOptions,
    connect::{Connections, Reached, broken_off, fields, silent},
    network_thread,
};
use crate::Result;

/// Most bytes of bodies that have come and nobody has taken; then connections wait. Hosts may send more than was asked for.
const MAX_UNREAD_BYTES: usize = 8 << 20;

/// An event, and the room that it takes until it is taken or dropped.
type Told = (GetId, Event, Option<OwnedSemaphorePermit>);

/// Carries GETs over HTTP/1.1, with connections that are kept, with TLS or without; follows redirections.
pub struct HttpTransport {
    silence: Duration,
    connections: Arc<Connections>,
    next: u64,
    tasks: HashMap<GetId, AbortHandle>,
    sender: Sender<Told>,
    receiver: Receiver<Told>,
    ready: VecDeque<Told>,
    room: Arc<Semaphore>,
    /// `None` only while it is dropped.
    runtime: Option<Runtime>,
}

impl HttpTransport {
    /// # Errors
    /// [`crate::Error::Source`] if certificates cannot be read, or no thread can be started.
    pub fn new(options: &HttpOptions) -> Result<Self> {
        let (sender, receiver) = channel();
        Ok(Self {
            silence: options.silence,
            connections: Connections::new(options)?,
            next: 0,
            tasks: HashMap::new(),
            sender,
            receiver,
            ready: VecDeque::new(),
            room: Arc::new(Semaphore::new(MAX_UNREAD_BYTES)),
            runtime: Some(network_thread()?),
        })
    }

    /// Events of GETs that were given up are dropped.
    fn accept(&mut self, told: Told) {
        if self.tasks.contains_key(&told.0) {
            self.ready.push_back(told);
        }
    }

    fn collect(&mut self) {
        while let Ok(event) = self.receiver.try_recv() {
            self.accept(event);
        }
    }
}

/// A GET, told step by step. Nothing is heard any more when the source is gone.
async fn carry(
    connections: Arc<Connections>,
    silence: Duration,
    get: Get,
    room: Arc<Semaphore>,
    tell: impl Fn(Event, Option<OwnedSemaphorePermit>),
) -> std::result::Result<(), String> {
    let Reached {
        response, head_bytes, ..
    } = connections.get(&get.url, &range_fields(&get)?).await?;
    let text = |value: &header::HeaderValue| value.to_str().ok().map(str::to_owned);
    let fields = response.headers().iter();
    let head = Event::Head(Head {
        status: response.status().as_u16(),
        fields: fields
            .filter_map(|(name, value)| Some((name.as_str().to_owned(), text(value)?)))
            .collect(),
        wire_bytes: head_bytes,
    });
    tell(head, None);
    let mut body = response.into_body();
    while let Some(frame) = timeout(silence, body.frame())
        .await
        .map_err(|_| silent(silence))?
    {
        let frame = frame.map_err(|error| broken_off(&error))?;
        if let Ok(data) = frame.into_data() {
            let bytes = data.len().min(MAX_UNREAD_BYTES) as u32;
            // Closed never; what is told without room would only be unbounded.
            let permit = Arc::clone(&room).acquire_many_owned(bytes).await.ok();
            tell(Event::Body(data), permit);
        }
    }
    tell(Event::End, None);
    Ok(())
}

fn range_fields(get: &Get) -> std::result::Result<HeaderMap, String> {
    let value = |text: &str| {
        header::HeaderValue::from_str(text).map_err(|_| format!("{text:?} cannot stand in a header"))
    };
    let mut fields = fields(get.anew);
    fields.insert(
        header::ACCEPT_ENCODING,
        header::HeaderValue::from_static("identity"),
    );
    if let Some(range) = &get.range {
        let last = range.end.saturating_sub(1);
        fields.insert(header::RANGE, value(&format!("bytes={}-{last}", range.start))?);
        if let Some(validator) = &get.if_range {
            fields.insert(header::IF_RANGE, value(validator)?);
        }
    }
    Ok(fields)
}

impl Transport for HttpTransport {
    fn start(&mut self, get: Get) -> GetId {
        let id = GetId(self.next);
        self.next += 1;
        let Some(runtime) = &self.runtime else { return id };
        let (connections, sender) = (Arc::clone(&self.connections), self.sender.clone());
        let (silence, room) = (self.silence, Arc::clone(&self.room));
        let task = runtime.spawn(async move {
            let tell = |event, permit| {
                let _ = sender.send((id, event, permit));
            };
            if let Err(detail) = carry(connections, silence, get, room, tell).await {
                tell(Event::Failed(detail), None);
            }
        });
        self.tasks.insert(id, task.abort_handle());
        id
    }

    fn abort(&mut self, id: GetId) {
        if let Some(task) = self.tasks.remove(&id) {
            task.abort();
            self.ready.retain(|(ready, ..)| *ready != id);
        }
    }

    fn poll(&mut self) -> Option<(GetId, Event)> {
        self.collect();
        let (id, event, _) = self.ready.pop_front()?;
        if matches!(event, Event::End | Event::Failed(_)) {
            self.tasks.remove(&id);
        }
        Some((id, event))
    }

    fn wait(&mut self, limit: Duration) {
        let begin = std::time::Instant::now();
        self.collect();
        while self.ready.is_empty() && !self.tasks.is_empty() {
            let left = limit.saturating_sub(begin.elapsed());
            match self.receiver.recv_timeout(left) {
                Ok(event) => self.accept(event),
                Err(_) => return,
            }
        }
    }
}

impl Drop for HttpTransport {
    fn drop(&mut self) {
        self.tasks.drain().for_each(|(_, task)| task.abort());
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
