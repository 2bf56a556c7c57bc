//! The service on a socket: from the first connection to the last.

use std::{
    future::Future,
    io,
    net::SocketAddr,
    pin::pin,
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use tokio::{
    net::{TcpListener, TcpStream},
    sync::{Semaphore, watch},
    time::sleep,
};

use crate::{
    Error, MAX_ARCHIVES, Options, Result, Site, connection::Door, open_files, service::Shared,
    workers::Workers,
};

/// Pause after the system has refused a connection for want of something, such as open files.
const ACCEPT_PAUSE: Duration = Duration::from_millis(500);
/// Files for lists, reads, the log and connections to stores.
const SPARE_FILES: usize = 128;

/// Serves collections on a socket until `shutdown` ends; then says so at `/ready` for [`Options::notice`], accepts
/// nothing more, lets requests in progress finish within [`Options::drain_timeout`], and returns.
///
/// # Errors
/// [`Error::Socket`] if the socket does not work at all.
pub async fn run(
    listener: TcpListener,
    site: impl Into<Site>,
    options: Options,
    shutdown: impl Future<Output = ()>,
) -> Result<()> {
    let address = listener.local_addr().map_err(Error::Socket)?;
    let mut site = site.into();
    let archives: usize = site
        .collections
        .iter()
        .map(|(_, collection)| collection.names().len())
        .sum();
    tracing::info!(%address, archives, tls = site.tls.is_some(), "listening");
    let tls = site.tls.take();
    let shared = Arc::new(Shared::new(site, &options));
    let (stop, stopping) = watch::channel(());
    let door = Door {
        shared: Arc::clone(&shared),
        tls,
        stopping,
    };
    let workers = Workers::start(Arc::new(door)).map_err(Error::Socket)?;
    let slots = Arc::new(Semaphore::new(connections_of(&options)));
    let mut end = pin!(async {
        shutdown.await;
        shared.draining.store(true, Ordering::Relaxed);
        sleep(options.notice).await;
    });
    loop {
        // A slot first: more connections wait in the system's queue.
        let accepted = async {
            let slot = Arc::clone(&slots).acquire_owned().await;
            let (stream, client) = accept(&listener).await;
            workers.give(stream, client, slot).await;
        };
        tokio::select! {
            () = accepted => {}
            () = &mut end => break,
        }
    }
    drop(listener);
    drop(stop);
    tracing::info!(connections = workers.connections(), "stopping");
    workers.end(options.drain_timeout).await;
    Ok(())
}

/// Connections that there may be: no more than files that the system lets this process open, less those of
/// archives and of reading.
fn connections_of(options: &Options) -> usize {
    let wanted = options.connections.clamp(1, Semaphore::MAX_PERMITS);
    let Some(files) = open_files::allowed() else {
        return wanted;
    };
    let files = usize::try_from(files).unwrap_or(usize::MAX);
    let possible = files.saturating_sub(MAX_ARCHIVES + SPARE_FILES).max(1);
    if possible < wanted {
        tracing::warn!(
            possible,
            wanted,
            "fewer connections than wanted: raise the limit with ulimit -n"
        );
    }
    wanted.min(possible)
}

/// The next connection. One that broke off before it was accepted is not an error of ours, and when the system
/// is out of something it gets time to have it again.
async fn accept(listener: &TcpListener) -> (TcpStream, SocketAddr) {
    loop {
        match listener.accept().await {
            Ok(accepted) => return accepted,
            Err(error) if is_of_one_connection(&error) => {}
            Err(error) => {
                tracing::error!(%error, "no connection can be accepted");
                sleep(ACCEPT_PAUSE).await;
            }
        }
    }
}

fn is_of_one_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(
        error.kind(),
        ConnectionAborted | ConnectionRefused | ConnectionReset
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_connections_as_files() {
        let few = Options {
            connections: 3,
            ..Options::default()
        };
        assert_eq!(connections_of(&few), 3);
        let many = Options {
            connections: usize::MAX,
            ..Options::default()
        };
        assert!(open_files::allowed().is_none_or(|files| connections_of(&many) as u64 <= files));
    }
}
