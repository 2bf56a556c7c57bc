//! What a page asks before there is a picture: files of a scene, and words to show.

use engine::Overlay;
use viewer::keys;
use wasm_bindgen::prelude::*;

/// URIs of the buffers that lie beside a glTF file, to be loaded before [`Session::scene`].
///
/// # Errors
/// If it is no glTF, or names files outside of its folder.
#[wasm_bindgen]
pub fn externals(name: &str, bytes: &[u8]) -> Result<Vec<String>, JsError> {
    Ok(scenes::gltf::externals(name, bytes)?)
}

/// Keys and gestures, and what they do, in turns.
#[wasm_bindgen]
pub fn help() -> Vec<String> {
    let pairs = keys::HELP.iter();
    pairs
        .flat_map(|(key, does)| [(*key).into(), (*does).into()])
        .collect()
}

/// Names of what can lie over the picture, and what they say in words, in turns.
#[wasm_bindgen]
pub fn overlays() -> Vec<String> {
    let pairs = Overlay::ALL.iter();
    pairs
        .flat_map(|overlay| [overlay.name().into(), overlay.title().into()])
        .collect()
}

/// Labels and colours (`#rrggbb`) of an overlay's legend, in turns; none for an unknown name.
#[wasm_bindgen]
pub fn legend(overlay: &str) -> Vec<String> {
    let legend = Overlay::from_name(overlay)
        .map(Overlay::legend)
        .unwrap_or_default();
    let pairs = legend.into_iter();
    pairs
        .flat_map(|(label, [r, g, b])| [label, format!("#{r:02x}{g:02x}{b:02x}")])
        .collect()
}
