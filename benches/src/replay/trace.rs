//! A way of the camera over a network, on disk.

use std::io::{Read, Write};
use std::time::Duration;

use engine::stream::{Network, OpenOptions};
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::Counts;
use crate::engine::{Archives, Subject};
use crate::{Error, Result, stream::close_up};

const FORMAT: &str = "eigentile camera and network 1";
/// Most frames, an hour of them, and bytes of a file.
const MOST_FRAMES: usize = 60 * 3600;
const MOST_BYTES: u64 = 256 << 20;

/// What is looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Footage {
    /// The grid of tori with so many materials made by formula: [`crate::stream::close_up`].
    Made {
        /// How many.
        materials: usize,
    },
    /// A scene file, and a tile server or folder of its archives.
    Scene {
        /// .gltf or .glb.
        path: String,
        /// Address or folder.
        tiles: String,
    },
}

/// A network, in numbers that files can hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// As [`Network::bits_per_second`].
    pub bits_per_second: u64,
    /// As [`Network::round_trip`].
    pub round_trip_ns: u64,
    /// As [`Network::jitter`].
    pub jitter_ns: u64,
    /// As [`Network::loss`].
    pub loss: f64,
    /// As [`Network::reorder`].
    pub reorder: f64,
    /// As [`Network::connections`].
    pub connections: u64,
    /// As [`Network::streams`].
    pub streams: u64,
    /// As [`Network::batch`].
    pub batch: u64,
    /// As [`Network::header_bytes`].
    pub header_bytes: u64,
    /// As [`Network::frame_bytes`].
    pub frame_bytes: u64,
}

impl From<Network> for Line {
    fn from(network: Network) -> Self {
        let nanoseconds = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        Self {
            bits_per_second: network.bits_per_second,
            round_trip_ns: nanoseconds(network.round_trip),
            jitter_ns: nanoseconds(network.jitter),
            loss: network.loss,
            reorder: network.reorder,
            connections: network.connections as u64,
            streams: network.streams as u64,
            batch: network.batch as u64,
            header_bytes: network.header_bytes,
            frame_bytes: network.frame_bytes,
        }
    }
}

impl From<Line> for Network {
    fn from(line: Line) -> Self {
        let count = |value: u64| usize::try_from(value).unwrap_or(usize::MAX);
        Self {
            bits_per_second: line.bits_per_second,
            round_trip: Duration::from_nanos(line.round_trip_ns),
            jitter: Duration::from_nanos(line.jitter_ns),
            loss: line.loss,
            reorder: line.reorder,
            connections: count(line.connections),
            streams: count(line.streams),
            batch: count(line.batch),
            header_bytes: line.header_bytes,
            frame_bytes: line.frame_bytes,
        }
    }
}

/// A way of the camera over a network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trace {
    /// Tells the file from others; [`Trace::new`] sets it.
    pub format: String,
    /// What it shows, for people.
    pub name: String,
    /// What is looked at.
    pub footage: Footage,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Bytes of the page cache.
    pub page_cache_bytes: u64,
    /// Bytes of the column cache.
    pub column_cache_bytes: u64,
    /// The network.
    pub line: Line,
    /// The camera of each frame; it stays at the last until all has settled.
    pub cameras: Vec<Camera>,
    /// What came of it when it was recorded.
    pub counts: Option<Counts>,
}

impl Trace {
    /// A trace that was never replayed.
    pub fn new(
        name: String,
        footage: Footage,
        size: (u32, u32),
        network: Network,
        cameras: Vec<Camera>,
    ) -> Self {
        Self {
            format: FORMAT.to_owned(),
            name,
            footage,
            size,
            page_cache_bytes: 256 << 20,
            column_cache_bytes: 128 << 20,
            line: network.into(),
            cameras,
            counts: None,
        }
    }

    /// Writes the trace as JSON.
    ///
    /// # Errors
    /// [`Error::Trace`] if it cannot be written.
    pub fn write(&self, mut to: impl Write) -> Result<()> {
        let written = serde_json::to_writer(&mut to, self).map_err(std::io::Error::from);
        written
            .and_then(|()| writeln!(to))
            .map_err(|error| Error::Trace(format!("cannot be written: {error}")))
    }

    /// Reads what [`Trace::write`] has written.
    ///
    /// # Errors
    /// [`Error::Trace`] for anything else, with what is wrong.
    pub fn read(from: impl Read) -> Result<Self> {
        let trace: Self = serde_json::from_reader(from.take(MOST_BYTES))
            .map_err(|error| Error::Trace(format!("not a trace of camera and network: {error}")))?;
        trace.check()?;
        Ok(trace)
    }

    fn check(&self) -> Result<()> {
        let wrong = |text: String| Err(Error::Trace(text));
        if self.format != FORMAT {
            return wrong(format!("the format is {:?}, {FORMAT:?} is expected", self.format));
        }
        if self.cameras.is_empty() || self.cameras.len() > MOST_FRAMES {
            return wrong(format!(
                "{} cameras: 1 to {MOST_FRAMES} are expected",
                self.cameras.len()
            ));
        }
        for (frame, camera) in self.cameras.iter().enumerate() {
            if let Some(problem) = camera.problem() {
                return wrong(format!("the camera of frame {frame} {problem}"));
            }
        }
        if !(0.0..=0.5).contains(&self.line.loss) || !(0.0..=1.0).contains(&self.line.reorder) {
            return wrong(format!(
                "a loss of {} and a reordering of {}: at most 0.5 and 1 are expected",
                self.line.loss, self.line.reorder
            ));
        }
        if let Footage::Made { materials: 0 } | Footage::Made { materials: 101.. } = self.footage {
            return wrong("materials are made for 1 to 100".to_owned());
        }
        Ok(())
    }

    /// The scene and its archives.
    ///
    /// # Errors
    /// [`Error::Trace`] if the scene cannot be opened.
    pub(super) fn subject(&self) -> Result<Subject> {
        match &self.footage {
            Footage::Made { materials } => close_up(*materials, 1),
            Footage::Scene { path, tiles } => {
                let opened = scenes::gltf::open(std::path::Path::new(path));
                let loaded = opened.map_err(|error| Error::Trace(format!("its scene: {error}")))?;
                Ok(Subject {
                    name: self.name.clone(),
                    scene: loaded.scene,
                    archives: Archives::At(tiles.clone(), OpenOptions::default()),
                    cameras: Vec::new(),
                    flight: Vec::new(),
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace() -> Trace {
        let cameras = close_up(1, 3).unwrap().cameras;
        let network = Network::named("4g").unwrap();
        Trace::new(
            "tori".into(),
            Footage::Made { materials: 1 },
            (64, 36),
            network,
            cameras,
        )
    }

    #[test]
    fn what_is_written_is_read() {
        let mut bytes = Vec::new();
        trace().write(&mut bytes).unwrap();
        let read = Trace::read(&bytes[..]).unwrap();
        assert_eq!(read, trace());
        assert_eq!(Network::from(read.line), Network::named("4g").unwrap());
    }

    #[test]
    fn what_is_wrong_is_named() {
        let says = |change: fn(&mut Trace), what: &str| {
            let mut trace = trace();
            change(&mut trace);
            let mut bytes = Vec::new();
            trace.write(&mut bytes).unwrap();
            let error = Trace::read(&bytes[..]).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        says(|trace| trace.format = "eigentile votes 1".into(), "votes 1");
        says(|trace| trace.cameras.clear(), "0 cameras");
        says(
            |trace| trace.cameras[1].fov_y = 0.0,
            "frame 1 has a vertical field of view",
        );
        says(|trace| trace.line.loss = 0.9, "a loss of 0.9");
        says(|trace| trace.footage = Footage::Made { materials: 0 }, "1 to 100");
        let error = Trace::read(&b"{\"format\":1"[..]).unwrap_err().to_string();
        assert!(error.contains("not a trace"), "{error}");
    }
}
