//! Pictures and camera paths to files.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use viewer::{Viewer, recorder::Motion};

use crate::Show;

/// Files of one name are numbered up to here.
const MOST_FILES: u32 = 9999;
/// Longest time until a picture of a turntable has settled.
const SETTLE: std::time::Duration = std::time::Duration::from_secs(60);

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

/// Frames of a video, once around, each settled, in a folder of their own.
pub(crate) fn turntable(viewer: &mut Viewer, show: &Show, frames: usize) -> Result<String> {
    ensure!(frames > 0, "a turntable has one frame at least");
    let folder = free(&show.folder, &format!("{}-turntable", show.title), "frames")?;
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    for (number, camera) in viewer.turntable().frames(frames).iter().enumerate() {
        viewer.engine_mut().settle(camera, SETTLE)?;
        let path = folder.join(format!("frame_{number:04}.png"));
        (show.save.png)(&path, viewer.size(), &viewer.engine().tonemapped()?)?;
    }
    Ok(format!(
        "{frames} frames in {}; ffmpeg -framerate 30 -i frame_%04d.png turntable.mp4 makes a video of them",
        folder.display()
    ))
}

/// A path that is not taken: NAME-0001.png and so on.
fn free(folder: &Path, title: &str, extension: &str) -> Result<PathBuf> {
    let plain = |letter: char| if letter.is_alphanumeric() || "-_".contains(letter) { letter } else { '-' };
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
