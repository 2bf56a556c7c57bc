//! A screen without a screen: Xvfb on a free display, what is on it, and a hand on mouse and keyboard.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Width and height of the screen, pixels.
pub(crate) const SIZE: (u32, u32) = (1000, 700);

/// An X server, as long as this lives.
pub(crate) struct Screen {
    server: Child,
    pub(crate) display: String,
    folder: tempfile::TempDir,
}

/// What is on the screen: `[y][x]`, red, green, blue.
pub(crate) struct Shown {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Screen {
    pub(crate) fn start() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let size = format!("{}x{}x24", SIZE.0, SIZE.1);
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-screen",
                "0",
                &size,
                "-nolisten",
                "tcp",
                "-fbdir",
            ])
            .arg(folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb is there: `cargo xtask setup` installs it");
        let mut number = String::new();
        BufReader::new(server.stdout.as_mut().expect("piped"))
            .read_line(&mut number)
            .expect("the number of the display");
        Self {
            server,
            display: format!(":{}", number.trim()),
            folder,
        }
    }

    /// What is shown now, from the X server's own memory, which is a file in the form of xwd (X Window Dump,
    /// `X11/XWDFile.h`): a header of big-endian words, colours of 12 bytes, rows of four bytes a pixel, blue first.
    pub(crate) fn shown(&self) -> Shown {
        let file: PathBuf = self.folder.path().join("Xvfb_screen0");
        let bytes = std::fs::read(file).expect("the screen's memory");
        let word =
            |at: usize| u32::from_be_bytes(bytes[4 * at..][..4].try_into().expect("four bytes")) as usize;
        let (header, width, height, row, colors) = (word(0), word(4), word(5), word(12), word(19));
        assert_eq!((width as u32, height as u32, word(11)), (SIZE.0, SIZE.1, 32));
        let first = header + 12 * colors;
        let pixels = (0..height).flat_map(|y| bytes[first + y * row..][..4 * width].chunks_exact(4));
        Shown {
            width,
            pixels: pixels.map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect(),
        }
    }

    /// Moves, presses and types by the words of xdotool.
    pub(crate) fn hand(&self, words: &[&str]) {
        let done = Command::new("xdotool")
            .args(words)
            .env("DISPLAY", &self.display)
            .output()
            .expect("xdotool is there: `cargo xtask setup` installs it");
        let errors = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "xdotool {words:?}: {errors}");
    }

    /// Gives the only window the keyboard, as a window manager would.
    pub(crate) fn focus(&self) {
        self.hand(&[
            "search",
            "--sync",
            "--onlyvisible",
            "--name",
            "Eigentile",
            "windowfocus",
            "--sync",
        ]);
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Shown {
    /// Pixels of a rectangle.
    fn of(&self, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> impl Iterator<Item = [u8; 3]> + '_ {
        y.flat_map(move |y| x.clone().map(move |x| self.pixels[y * self.width + x]))
    }

    /// How many colours there are in a rectangle.
    pub(crate) fn colors(&self, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> usize {
        self.of(x, y).collect::<std::collections::HashSet<_>>().len()
    }

    /// The share of pixels in a rectangle that differ from those of another screen.
    pub(crate) fn differs(&self, other: &Self, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> f64 {
        let pairs: Vec<_> = self.of(x.clone(), y.clone()).zip(other.of(x, y)).collect();
        pairs.iter().filter(|(a, b)| a != b).count() as f64 / pairs.len() as f64
    }

    /// How many pixels of the whole screen have this colour.
    pub(crate) fn count(&self, color: [u8; 3]) -> usize {
        self.pixels.iter().filter(|pixel| **pixel == color).count()
    }
}
