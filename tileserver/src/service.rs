//! What all requests share, and how they find archives.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize},
    },
    time::Duration,
};

use crate::{
    Collection, Options, Site, StaticFiles,
    collection::{Entry, Served},
    failure::Failure,
    metrics::Metrics,
    records::{ReadError, Records, What},
};
use bytes::Bytes;

/// What all requests to the server share.
pub(crate) struct Shared {
    pub(crate) options: Options,
    pub(crate) metrics: Arc<Metrics>,
    pub(crate) records: Arc<Records>,
    /// Collections and their places.
    pub(crate) collections: Vec<(String, Arc<Collection>)>,
    pub(crate) static_files: StaticFiles,
    /// Requests in progress.
    pub(crate) requests: AtomicUsize,
    /// Whether the end is near.
    pub(crate) draining: AtomicBool,
}

impl Shared {
    pub(crate) fn new(site: Site, options: &Options) -> Self {
        let metrics = Arc::new(Metrics::default());
        Self {
            options: *options,
            records: Arc::new(Records::new(options, Arc::clone(&metrics))),
            metrics,
            collections: site
                .collections
                .into_iter()
                .map(|(place, collection)| (place, Arc::new(collection)))
                .collect(),
            static_files: site.static_files,
            requests: AtomicUsize::new(0),
            draining: AtomicBool::new(false),
        }
    }
}

/// One collection, and what requests to it need.
#[derive(Clone, Copy)]
pub(crate) struct Service<'a> {
    pub(crate) shared: &'a Shared,
    pub(crate) collection: &'a Arc<Collection>,
}

impl Service<'_> {
    /// Whether answers are for holders of a token only.
    pub(crate) fn private(&self) -> bool {
        !self.collection.tokens.is_empty()
    }

    /// The archives as they are, or were a moment ago.
    pub(crate) async fn listing(&self) -> Arc<crate::collection::Listing> {
        self.looked(self.shared.options.list_age).await
    }

    async fn looked(&self, age: Duration) -> Arc<crate::collection::Listing> {
        self.collection.fresh(&self.shared.records.reads, age).await
    }

    /// The archives as they are at this moment.
    pub(crate) async fn look_again(&self) -> Arc<crate::collection::Listing> {
        self.looked(Duration::ZERO).await
    }

    /// The archive of this name as the store has it now.
    pub(crate) async fn newest(&self, name: &str) -> Result<Arc<Served>, Failure> {
        match self.listing().await.archives.get(name) {
            Some(Entry::Ready(served)) => Ok(Arc::clone(served)),
            Some(Entry::Broken { error, .. }) => Err(Failure::corrupt(format!("archive {name:?}: {error}"))),
            None => Err(Failure::no_archive(name)),
        }
    }

    /// The archive with this content. The store is only looked at if it is not the one that is open.
    pub(crate) async fn pinned(&self, name: &str, id: &str) -> Result<Arc<Served>, Failure> {
        let digits = id.len() == 32 && id.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
        let Some(number) = u128::from_str_radix(id, 16).ok().filter(|_| digits) else {
            return Err(Failure::not_found(format!(
                "{id:?} is no content id: GET /v1/ lists what there is"
            )));
        };
        if let Some(Entry::Ready(served)) = self.collection.listing().archives.get(name)
            && served.index.id == number
        {
            return Ok(Arc::clone(served));
        }
        let served = self.newest(name).await?;
        if served.index.id == number {
            Ok(served)
        } else {
            let detail = format!("archive {name:?} is now {}: GET its manifest again", served.id());
            Err(Failure::gone(detail))
        }
    }

    /// A record. If the archive was replaced in the store by one with the same content, it is read from there.
    pub(crate) async fn read(&self, mut served: Arc<Served>, what: What) -> Result<Bytes, Failure> {
        let mut again = true;
        loop {
            let room = self.shared.records.room(&served, what).await?;
            match self.shared.records.get(&served, what, room).await {
                Ok(bytes) => return Ok(bytes),
                Err(ReadError::Changed) if again => {
                    again = false;
                    self.look_again().await;
                    served = self.pinned(&served.name, &served.id()).await?;
                }
                Err(error) => return Err(read_failure(&served, what, error)),
            }
        }
    }
}

/// What a client is told of a record that cannot be read.
pub(crate) fn read_failure(served: &Served, what: What, error: ReadError) -> Failure {
    match error {
        ReadError::Unavailable | ReadError::Changed => Failure::unavailable(),
        ReadError::Corrupt => Failure::corrupt(format!(
            "archive {:?}, {what}: it cannot be read or does not hold",
            served.name
        )),
    }
}
