//! Processes of a test: a tile server that can be killed, and tests that need limits of their own.

use std::{
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

use tileserver::{Collection, Options};

/// Names the folder to serve, and where.
const FOLDER: &str = "EIGENTILE_TEST_FOLDER";
const LISTEN: &str = "EIGENTILE_TEST_LISTEN";

/// A tile server in a process of its own: the test program itself, which must have a test named `server_process` that calls
/// [`serve_if_asked`].
pub struct ServerProcess {
    /// `http://127.0.0.1:PORT`.
    pub address: String,
    child: Child,
}

impl ServerProcess {
    /// Serves a folder on a free port.
    ///
    /// # Panics
    /// If the process does not start.
    pub fn start(folder: &Path) -> Self {
        Self::at(folder, "127.0.0.1:0")
    }

    fn at(folder: &Path, listen: &str) -> Self {
        let mut child = own("server_process")
            .env(FOLDER, folder)
            .env(LISTEN, listen)
            .stdout(Stdio::piped())
            .spawn()
            .expect("this program starts");
        let output = BufReader::new(child.stdout.take().expect("its output"));
        let mut lines = output.lines().map_while(Result::ok);
        // Those of the test harness come first.
        let address = lines.find_map(|line| Some(line.split_once("listening on ")?.1.to_owned()));
        Self {
            address: address.expect("an address"),
            child,
        }
    }

    /// Ends it without a word, in the middle of whatever it does, and starts it again at the same address.
    ///
    /// # Panics
    /// If it does not start again.
    pub fn kill_and_restart(&mut self, folder: &Path) {
        self.kill();
        let listen = self.address.trim_start_matches("http://").to_owned();
        *self = Self::at(folder, &listen);
    }

    /// Its memory in bytes.
    ///
    /// # Panics
    /// If the system does not tell.
    pub fn resident_bytes(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).expect("a process");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib: u64 = line
            .and_then(|line| line.split_whitespace().next()?.parse().ok())
            .expect("a number");
        kib << 10
    }

    fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        self.kill();
    }
}

/// This program, for one of its tests alone.
///
/// # Panics
/// If it cannot be found.
pub fn own(test: &str) -> Command {
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--exact", test, "--nocapture", "--test-threads=1"]);
    command
}

/// The body of a server process; nothing for anybody else.
///
/// # Panics
/// If the folder cannot be served.
pub fn serve_if_asked() {
    let (Ok(folder), Ok(listen)) = (std::env::var(FOLDER), std::env::var(LISTEN)) else {
        return;
    };
    tileserver::raise_open_files();
    let runtime = tokio::runtime::Runtime::new().expect("threads");
    let collection = Collection::open(folder).expect("a folder of archives");
    let options = Options {
        list_age: Duration::from_millis(50),
        ..Options::default()
    };
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::bind(listen).await.expect("a port");
        println!(
            "\nlistening on http://{}",
            listener.local_addr().expect("an address")
        );
        let served = tileserver::run(listener, collection, options, std::future::pending()).await;
        served.expect("it is killed");
    });
}
