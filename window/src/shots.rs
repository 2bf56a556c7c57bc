//! Pictures and camera paths to files.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use scenes::Camera;
use viewer::{Viewer, recorder::Motion};

use crate::Show;

/// Files of one name are numbered up to here.
const MOST_FILES: u32 = 9999;

/// The picture as it is on the screen.
pub(crate) fn png(viewer: &mut Viewer, show: &Show) -> Result<String> {
    let path = free(&show.folder, &show.title, "png")?;
    (show.save.png)(&path, viewer.size(), &viewer.engine().tonemapped()?)?;
    Ok(written(&path))
}

/// Its radiance, before exposure.
pub(crate) fn exr(viewer: &mut Viewer, show: &Show) -> Result<String> {
    let path = free(&show.folder, &show.title, "exr")?;
    (show.save.exr)(&path, &viewer.engine().picture()?)?;
    Ok(written(&path))
}

/// The camera path that was recorded last.
pub(crate) fn path(viewer: &mut Viewer, show: &Show) -> Result<String> {
    let Some(Motion::Path(recorded)) = viewer.motion() else {
        anyhow::bail!("no camera path was recorded yet: V begins and ends it");
    };
    let path = free(&show.folder, &format!("{}-path", show.title), "json")?;
    recorded.save(&path)?;
    Ok(written(&path))
}

/// Frames of a video, once around: a camera after the other is shown until its picture has settled.
pub(crate) struct Video {
    folder: PathBuf,
    cameras: Vec<Camera>,
    written: usize,
}

impl Video {
    /// Into a folder of its own.
    pub(crate) fn new(viewer: &Viewer, show: &Show, frames: usize) -> Result<Self> {
        ensure!(frames > 0, "a turntable has one frame at least");
        let folder = free(&show.folder, &format!("{}-turntable", show.title), "frames")?;
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(Self {
            folder,
            cameras: viewer.turntable().frames(frames),
            written: 0,
        })
    }

    /// The camera that is due.
    pub(crate) fn camera(&self) -> Option<&Camera> {
        self.cameras.get(self.written)
    }

    /// After a frame with that camera: writes it, if it has settled. Returns how far it is.
    pub(crate) fn follow(&mut self, viewer: &Viewer, show: &Show) -> Result<String> {
        if viewer.report().frame.settled {
            let path = self.folder.join(format!("frame_{:04}.png", self.written));
            (show.save.png)(&path, viewer.size(), &viewer.engine().tonemapped()?)?;
            self.written += 1;
        }
        let (folder, frames) = (self.folder.display(), self.cameras.len());
        Ok(if self.written < frames {
            format!("Frame {} of {frames}; Esc ends it", self.written + 1)
        } else {
            format!(
                "Written: {frames} frames in {folder}; ffmpeg -framerate 30 -i frame_%04d.png turntable.mp4 makes a video"
            )
        })
    }
}

/// A path that is not taken: NAME-0001.png and so on.
fn free(folder: &Path, title: &str, extension: &str) -> Result<PathBuf> {
    let plain = |letter: char| {
        if letter.is_alphanumeric() || "-_".contains(letter) {
            letter
        } else {
            '-'
        }
    };
    let name: String = title.chars().map(plain).take(80).collect();
    let path = |number: u32| folder.join(format!("{name}-{number:04}.{extension}"));
    (1..=MOST_FILES)
        .map(path)
        .find(|path| !path.exists())
        .with_context(|| format!("{} is full of {name}-*.{extension}", folder.display()))
}

fn written(path: &Path) -> String {
    format!("Written: {}", path.display())
}
