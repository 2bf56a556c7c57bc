//! The tile server in this process, on a free port.

use std::path::Path;
use std::thread::JoinHandle;

use anyhow::{Context, Result, anyhow};
use tileserver::{Collection, Options};
use tokio::net::TcpListener;
use tokio::sync::oneshot;

/// A running server; stops when it is dropped or told to.
pub(crate) struct Server {
    address: String,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Server {
    /// Serves a folder on a free port of this machine.
    pub(crate) fn start(folder: &Path) -> Result<Self> {
        let collection = Collection::open(folder)?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .context("cannot start the server's threads")?;
        let listener = runtime
            .block_on(TcpListener::bind("127.0.0.1:0"))
            .context("cannot listen on a free port")?;
        let address = format!("http://{}", listener.local_addr()?);
        let (stop, stopped) = oneshot::channel();
        let serve = move || {
            let shutdown = async {
                // Both a message and a sender that is gone mean: stop.
                let _ = stopped.await;
            };
            runtime.block_on(tileserver::run(
                listener,
                collection,
                Options::default(),
                shutdown,
            ))?;
            Ok(())
        };
        let thread = std::thread::Builder::new()
            .name("tileserver".into())
            .spawn(serve)?;
        Ok(Self {
            address,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// `http://127.0.0.1:PORT`.
    pub(crate) fn address(&self) -> &str {
        &self.address
    }

    /// Lets requests in progress finish, and says if anything went wrong.
    pub(crate) fn stop(mut self) -> Result<()> {
        drop(self.stop.take());
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(anyhow!("the server's thread has panicked")),
            None => Ok(()),
        }
    }
}
