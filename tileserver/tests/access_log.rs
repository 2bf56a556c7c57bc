//! One line in the log for each request, with what was really sent.

mod common;

use std::{
    io::Write,
    sync::{Arc, Mutex},
    time::Duration,
};

use common::{Server, archive, large_archive, send};

/// Keeps what is logged.
#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<u8>>>);

impl Write for Lines {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Lines {
    /// Waits for the line of a request, which is written after its answer was sent.
    async fn of(&self, path: &str) -> serde_json::Map<String, serde_json::Value> {
        for _ in 0..1000 {
            let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
            if let Some(line) = text
                .lines()
                .find(|line| line.contains(&format!("path=\"{path}\"")))
            {
                let fields = line.split(' ').filter_map(|field| field.split_once('='));
                return fields
                    .map(|(name, value)| (name.into(), value.trim_matches('"').into()))
                    .collect();
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("no line for {path}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_are_logged() {
    let lines = Lines::default();
    let writer = lines.clone();
    tracing_subscriber::fmt()
        .with_ansi(false)
        .with_writer(move || writer.clone())
        .init();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cloth.bsvtf"), archive(1)).unwrap();
    std::fs::write(folder.path().join("large.bsvtf"), large_archive(8 << 20)).unwrap();
    std::fs::write(folder.path().join("broken.bsvtf"), b"none").unwrap();
    let server = Server::start(folder.path()).await;

    let sent = server.get("/v1/cloth").await.body.len();
    let line = lines.of("/v1/cloth").await;
    for (name, value) in [
        ("method", "GET"),
        ("status", "200"),
        ("bytes", &*sent.to_string()),
        ("complete", "true"),
    ] {
        assert_eq!(line[name], value, "{name} in {line:?}");
    }
    assert!(line["ms"].as_str().unwrap().parse::<f64>().unwrap() > 0.0);

    server.get("/v1/nothing%0Ainjected").await;
    assert_eq!(lines.of("/v1/nothing%0Ainjected").await["status"], "404");
    server.request("HEAD", "/v1/cloth.bsvtf", &[]).await;
    let line = lines.of("/v1/cloth.bsvtf").await;
    assert_eq!((&line["method"], &line["bytes"]), (&"HEAD".into(), &"0".into()));

    let mut hangs_up = server.connect().await;
    send(&mut hangs_up, "GET", "/v1/large.bsvtf", &[]).await;
    hangs_up.readable().await.unwrap();
    drop(hangs_up);
    let line = lines.of("/v1/large.bsvtf").await;
    assert_eq!(line["complete"], "false");
    assert!(line["bytes"].as_str().unwrap().parse::<u64>().unwrap() < 16 << 20);

    let log = String::from_utf8(lines.0.lock().unwrap().clone()).unwrap();
    assert!(
        log.lines()
            .any(|line| line.contains("WARN") && line.contains("broken")),
        "{log}"
    );
    server.stop().await;
}
