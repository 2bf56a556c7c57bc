//! The window, on a screen of its own: what it shows, and what it does with keys, mouse, and hosts that are not there.

#[path = "../program/mod.rs"]
mod program;
mod screen;

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::LazyLock;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use program::{Server, command, succeed};
use screen::Screen;
use serde_json::Value;

/// Longest time for anything.
const PATIENCE: Duration = Duration::from_secs(60);
/// Colour of the banner when the host cannot be reached.
const BANNER: [u8; 3] = [140, 40, 20];
/// Of the window: the picture begins at 0, the panel here.
const SIZE: &str = "900x600";
const PANEL: usize = 600;

/// A folder with one material.
static TILES: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeed(
        at,
        &[
            "synth",
            "leather",
            "-o",
            "leather.npy",
            "--size",
            "80",
            "--rays",
            "1",
        ],
    );
    let archive = [
        "preprocess",
        "leather.npy",
        "-o",
        "tiles/leather.bsvtf",
        "--components",
        "16",
    ];
    succeed(at, &archive);
    folder
});

/// A window of the program.
struct Window<'a> {
    child: Child,
    events: Receiver<Value>,
    screen: &'a Screen,
    folder: tempfile::TempDir,
}

impl<'a> Window<'a> {
    fn open(screen: &'a Screen, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut child = command(&["view", "--events", "--size", SIZE])
            .args(arguments)
            .arg("-o")
            .arg(folder.path())
            .env("DISPLAY", &screen.display)
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let (told, events) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let event = serde_json::from_str(&line).expect("an object a line");
                if told.send(event).is_err() {
                    break;
                }
            }
        });
        let window = Self {
            child,
            events,
            screen,
            folder,
        };
        window.wait("opened");
        screen.focus();
        window
    }

    /// Waits for an event of this name; its detail.
    fn wait(&self, name: &str) -> Value {
        let start = Instant::now();
        let mut seen = Vec::new();
        while let Ok(event) = self.events.recv_timeout(PATIENCE.saturating_sub(start.elapsed())) {
            if event["event"] == name {
                return event["detail"].clone();
            }
            seen.push(event);
        }
        panic!("no {name:?} in {PATIENCE:?}, but {seen:?}");
    }

    /// Waits until the connection is in this state.
    fn wait_for_connection(&self, state: &str) {
        while self.wait("connection")["state"] != state {}
    }

    /// Presses a key and waits until the program says that it has understood.
    fn press(&self, key: &str, command: &str) {
        self.screen.hand(&["key", key]);
        while self.wait("command") != command {}
    }

    /// Waits until the screen looks as wanted.
    fn until(&self, what: &str, wanted: impl Fn(&screen::Shown) -> bool) -> screen::Shown {
        let start = Instant::now();
        loop {
            let shown = self.screen.shown();
            if wanted(&shown) {
                return shown;
            }
            assert!(start.elapsed() < PATIENCE, "not seen: {what}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Closes it, as a user does.
    fn close(mut self) {
        self.screen.hand(&["key", "ctrl+q"]);
        self.wait("closed");
        assert!(self.child.wait().expect("it ends").success());
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        // After a failed test; one that has ended cannot be killed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn tiles() -> String {
    TILES.path().join("tiles").to_str().unwrap().to_owned()
}

fn files(folder: &Path, extension: &str) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    entries
        .filter(|path| path.extension().is_some_and(|is| is == extension))
        .collect()
}

#[test]
fn a_window_shows_a_material_and_follows_keys_and_mouse() {
    let screen = Screen::start();
    let window = Window::open(
        &screen,
        &["leather", "--tiles", &tiles(), "--link", "shape=sphere"],
    );
    window.wait("first_picture");
    window.wait("settled");
    let first = window.until("a picture", |shown| shown.colors(0..PANEL, 0..600) > 500);
    assert!(first.colors(PANEL + 5..895, 5..400) > 10, "the panel has text");

    // The panel goes, and the picture takes its place.
    window.press("p", "Panel");
    let wide = window.until("the wide picture", |shown| {
        shown.differs(&first, PANEL..900, 0..600) > 0.5
    });
    window.press("p", "Panel");
    window.until("the panel again", |shown| {
        shown.differs(&wide, PANEL..900, 0..600) > 0.5
    });

    // Dragging turns the camera; with control the light.
    let before = window.until("rest", |shown| shown.differs(&first, 0..PANEL, 0..600) < 0.5);
    window.screen.hand(&["mousemove", "250", "300", "mousedown", "1"]);
    window.screen.hand(&["mousemove", "330", "320", "mouseup", "1"]);
    let turned = window.until("another view", |shown| {
        shown.differs(&before, 0..PANEL, 0..600) > 0.1
    });
    window.screen.hand(&[
        "mousemove",
        "250",
        "300",
        "keydown",
        "Control_L",
        "mousedown",
        "1",
    ]);
    window
        .screen
        .hand(&["mousemove", "120", "300", "mouseup", "1", "keyup", "Control_L"]);
    window.until("another light", |shown| {
        shown.differs(&turned, 0..PANEL, 0..600) > 0.1
    });

    let plain = screen.shown();
    window.press("question", "Help");
    let keys = window.until("the keys", |shown| shown.differs(&plain, 0..900, 0..600) > 0.05);
    window.press("Escape", "Escape");
    window.until("no keys", |shown| shown.differs(&keys, 0..900, 0..600) > 0.05);

    window.press("c", "Screenshot");
    window.press("x", "Radiance");
    let pictures = files(window.folder.path(), "png");
    let picture = image::open(&pictures[0]).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (PANEL as u32, 600));
    assert!(picture.pixels().any(|pixel| pixel.0[0] > 60));
    window.wait("written");
    assert_eq!(files(window.folder.path(), "exr").len(), 1);
    window.close();
}

#[test]
fn a_host_that_is_missing_or_goes_away_is_told_and_asked_again() {
    let screen = Screen::start();
    // A port where nobody listens, and where the server will.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let (address, listen) = (format!("http://127.0.0.1:{port}"), format!("127.0.0.1:{port}"));
    let far = "cam=0,0,34,0,0,0,40";
    let window = Window::open(&screen, &["leather", "--tiles", &address, "--link", far]);
    window.wait_for_connection("lost");
    window.until("the banner", |shown| shown.count(BANNER) > 2000);

    let folder = tiles();
    let server = Server::start_at(Path::new(&folder), &listen);
    window.screen.hand(&["key", "F5"]);
    window.wait_for_connection("fine");
    window.wait("settled");
    window.until("no banner", |shown| shown.count(BANNER) == 0);

    // Gone in the middle: near by, finer pages are needed.
    drop(server);
    window.screen.hand(&["mousemove", "300", "300"]);
    (0..28).for_each(|_| window.screen.hand(&["click", "4"]));
    window.wait_for_connection("waiting");
    let near = window.until("the nearer picture", |shown| {
        shown.colors(0..PANEL, 80..600) > 100
    });

    let _server = Server::start_at(Path::new(&folder), &listen);
    window.screen.hand(&["key", "F5"]);
    window.wait_for_connection("fine");
    window.wait("settled");
    window.until("a finer picture", |shown| {
        shown.differs(&near, 0..PANEL, 80..600) > 0.05
    });
    window.close();
}

#[test]
fn what_cannot_be_opened_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, says) in [
        (&["view", "none.gltf"][..], "none.gltf"),
        (&["view", "none.bsvtf"], "give an archive"),
        (&["view", "x", "--tiles", "/no/such/folder"], "folder"),
        (
            &["view", "x", "--tiles", ".", "--link", "shape=cube"],
            "plane, sphere",
        ),
    ] {
        let said = program::fail(folder.path(), arguments);
        assert!(said.contains(says), "{arguments:?}: {said}");
    }
    // Without a display.
    let output = command(&["view", "x", "--tiles", "."])
        .current_dir(folder.path())
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && said.contains("no display"), "{said}");
}
