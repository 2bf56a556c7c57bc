//! A tile server on a free port.

use std::path::Path;

use tileserver::{Collection, Options, Site};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Serves a folder until it is dropped.
pub struct Server {
    /// `http://127.0.0.1:PORT`.
    pub address: String,
    stop: Option<oneshot::Sender<()>>,
    task: Option<JoinHandle<tileserver::Result<()>>>,
    runtime: Runtime,
}

impl Server {
    /// Serves the archives of a folder.
    ///
    /// # Panics
    /// If the folder cannot be served.
    pub fn start(folder: &Path) -> Self {
        let collection = Collection::open(folder).expect("a folder of archives");
        Self::of(collection, Options::default())
    }

    /// Serves collections.
    ///
    /// # Panics
    /// If there are no threads or no free port.
    pub fn of(site: impl Into<Site>, options: Options) -> Self {
        let (runtime, site) = (Runtime::new().expect("threads"), site.into());
        let listener = runtime
            .block_on(TcpListener::bind("127.0.0.1:0"))
            .expect("a free port");
        let address = format!("http://{}", listener.local_addr().expect("an address"));
        let (stop, stopped) = oneshot::channel::<()>();
        let shutdown = async {
            let _ = stopped.await; // a message, or a sender that is gone: both mean stop
        };
        let task = runtime.spawn(tileserver::run(listener, site, options, shutdown));
        Self {
            address,
            stop: Some(stop),
            task: Some(task),
            runtime,
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(task) = self.task.take() {
            let ended = self.runtime.block_on(task);
            if !std::thread::panicking() {
                ended.expect("no panic").expect("a clean end");
            }
        }
    }
}
