//! nginx, with nothing set for our files.

use std::{
    net::TcpListener,
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use engine::stream::open_with;

use crate::{FIXTURE, check, options};

/// A program, until it is dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

/// Starts a program, and waits until it listens.
fn start(command: &mut Command, port: u16, install: &str) -> Running {
    let command = command.stdout(Stdio::null()).stderr(Stdio::null());
    let running = Running(
        command
            .spawn()
            .unwrap_or_else(|error| panic!("{install}: {error}")),
    );
    let begin = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "{install}: it does not listen"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    running
}

/// nginx over a folder, without anything set for our files. It runs in this process' rights, in one process.
fn nginx(folder: &Path, port: u16) -> Running {
    let own = folder.join("nginx");
    std::fs::create_dir_all(&own).unwrap();
    let (root, at) = (folder.display(), own.display());
    let temporary = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|name| format!("{name}_temp_path {at}/{name};"))
        .join(" ");
    let configuration = format!(
        "daemon off; master_process off; pid {at}/pid; error_log {at}/errors; events {{}}
         http {{ access_log off; {temporary} server {{ listen 127.0.0.1:{port}; root {root}; }} }}"
    );
    std::fs::write(own.join("conf"), configuration).unwrap();
    // Debian has it where only root's path leads.
    let system = Path::new("/usr/sbin/nginx");
    let mut command = Command::new(if system.exists() {
        system
    } else {
        Path::new("nginx")
    });
    start(
        command.arg("-c").arg(own.join("conf")),
        port,
        "install nginx: cargo xtask setup",
    )
}

#[test]
fn nginx_is_enough_even_if_it_is_started_again_and_the_cache_even_without_it() {
    let (site, cache, port) = (FIXTURE.site(), tempfile::tempdir().unwrap(), free_port());
    let url = format!("http://127.0.0.1:{port}/");
    let mut host = Some(nginx(site.path(), port));
    let with_cache = options(Some(cache.path()));
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in FIXTURE.names() {
        check(&mut *source, name, || {
            host.take();
            host = Some(nginx(site.path(), port));
        });
    }
    let stats = source.stats();
    assert!(
        stats.exchanges < stats.requested || stats.from_ram > 0,
        "{stats:?}"
    );

    // Another run: nothing but the indices crosses the wire. And one without the host.
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in FIXTURE.names() {
        check(&mut *source, name, || {});
    }
    assert_eq!(source.stats().offline, 0);
    assert!(source.stats().from_disk > 0, "{:?}", source.stats());
    host.take();
    let mut source = open_with(&url, &with_cache).unwrap();
    for name in FIXTURE.names() {
        let answers = check(&mut *source, name, || {});
        assert!(answers.iter().all(|answer| answer.wire_bytes == 0));
    }
    assert_eq!(source.stats().offline as usize, FIXTURE.names().len());
}
