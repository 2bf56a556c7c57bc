//! The two hosts, as processes.

use std::{
    fs,
    io::{BufRead, BufReader},
    net::{SocketAddr, TcpListener, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use super::files::Site;
use crate::memory::resident_bytes;
use crate::{Error, Result};

/// Time for a host to listen.
const PATIENCE: Duration = Duration::from_secs(20);
/// For silence on a connection: longer than any part of the measurement.
const IDLE_SECONDS: u32 = 3600;

/// A host, until it is dropped.
pub(super) struct Host {
    pub(super) name: &'static str,
    pub(super) address: SocketAddr,
    child: Child,
    /// nginx's configuration, to stop its workers with.
    configuration: Option<PathBuf>,
}

impl Host {
    pub(super) fn nginx(site: &Site, cores: usize) -> Result<Self> {
        let own = site.path("nginx");
        fs::create_dir_all(&own).map_err(Error::io(&own, "make"))?;
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        let address = free.map_err(|error| failed("nginx", format!("no free port: {error}")))?;
        let at = own.display();
        let temporary = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|name| format!("{name}_temp_path {at}/{name};"))
            .join(" ");
        let text = format!(
            "daemon off; pid {at}/pid; error_log {at}/errors crit; worker_processes {cores};
             events {{ worker_connections 16384; }}
             http {{
                 access_log off; sendfile on; tcp_nopush on; default_type application/octet-stream; {temporary}
                 keepalive_requests 1000000000; keepalive_timeout {IDLE_SECONDS}s;
                 open_file_cache max=100000 inactive={IDLE_SECONDS}s; open_file_cache_valid {IDLE_SECONDS}s;
                 server {{ listen {address} backlog=4096; root {}; }}
             }}",
            site.files().display()
        );
        let configuration = own.join("conf");
        fs::write(&configuration, text).map_err(Error::io(&configuration, "write"))?;
        let mut command = nginx();
        command.arg("-c").arg(&configuration).stdin(Stdio::null());
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let child =
            child.map_err(|error| failed("nginx", format!("{error}; install it (Debian: nginx-light)")))?;
        let host = Self {
            name: "nginx",
            address,
            child,
            configuration: Some(configuration),
        };
        host.listening()
    }

    pub(super) fn ours(program: &Path, site: &Site) -> Result<Self> {
        let idle = IDLE_SECONDS.to_string();
        let mut command = Command::new(program);
        command
            .args(["serve", "--listen", "127.0.0.1:0"])
            .arg(site.tiles());
        command.args(["--idle-timeout", &idle, "--requests", "16384"]);
        let spawned = command
            .env("RUST_LOG", "warn")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut child = spawned.map_err(|error| failed("eigentile", error.to_string()))?;
        let mut line = String::new();
        if let Some(output) = &mut child.stdout {
            let _ = BufReader::new(output).read_line(&mut line); // What is missing is said below.
        }
        let address = line
            .trim()
            .rsplit_once("http://")
            .and_then(|(_, at)| at.parse().ok());
        let Some(address) = address else {
            let _ = child.kill();
            let _ = child.wait();
            return Err(failed("eigentile", format!("it printed {line:?} and no address")));
        };
        let host = Self {
            name: "eigentile",
            address,
            child,
            configuration: None,
        };
        host.listening()
    }

    fn listening(self) -> Result<Self> {
        let begin = Instant::now();
        while TcpStream::connect(self.address).is_err() {
            if begin.elapsed() > PATIENCE {
                return Err(failed(
                    self.name,
                    format!("it does not listen on {}", self.address),
                ));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(self)
    }

    /// Memory of its processes in bytes; 0 where the system does not tell.
    pub(super) fn resident_bytes(&self) -> u64 {
        let own = self.child.id().to_string();
        let children = fs::read_to_string(format!("/proc/{own}/task/{own}/children")).unwrap_or_default();
        let ids = children.split_whitespace().chain([own.as_str()]);
        ids.filter_map(resident_bytes).sum()
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // Workers of an nginx that is killed would go on.
        if let Some(configuration) = &self.configuration {
            let mut command = nginx();
            command.args(["-s", "stop", "-c"]).arg(configuration);
            let stopped = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
            if stopped.is_ok_and(|status| status.success()) {
                let _ = self.child.wait();
                return;
            }
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Debian has it where only root's path leads.
fn nginx() -> Command {
    let system = Path::new("/usr/sbin/nginx");
    Command::new(if system.exists() {
        system
    } else {
        Path::new("nginx")
    })
}

pub(super) fn failed(program: &'static str, detail: String) -> Error {
    Error::Program { program, detail }
}
