//! What can be set while a picture is shown.

use engine::{Overlay, frame::Budgets};
use viewer::Link;
use wasm_bindgen::prelude::*;

use super::Session;

/// Least bytes of both caches together.
const LEAST_CACHE_BYTES: f64 = (1u64 << 20) as f64;

#[wasm_bindgen]
impl Session {
    /// Camera, light, exposure and shape as a string.
    pub fn link(&self) -> String {
        self.viewer.link().to_string()
    }

    /// Restores what a link says.
    ///
    /// # Errors
    /// If it is none.
    pub fn follow(&mut self, link: &str) -> Result<(), JsError> {
        Ok(self.viewer.follow(&Link::parse(link)?)?)
    }

    /// Stops by which the picture is brightened.
    #[wasm_bindgen(getter)]
    pub fn exposure(&self) -> f32 {
        self.viewer.exposure_stops()
    }

    /// Brightens or darkens the picture.
    #[wasm_bindgen(setter)]
    pub fn set_exposure(&mut self, stops: f32) {
        self.viewer.set_exposure_stops(stops);
    }

    /// What a lone archive is shown on.
    #[wasm_bindgen(getter)]
    pub fn shape(&self) -> Option<String> {
        self.viewer.shape().map(|shape| shape.name().to_owned())
    }

    /// Shows a lone archive on another shape: `plane`, `sphere`, `cylinder`, `cloth`.
    ///
    /// # Errors
    /// For another name, or if the device fails.
    pub fn set_shape(&mut self, name: &str) -> Result<(), JsError> {
        let shape = scenes::lone::Shape::named(name)
            .ok_or_else(|| JsError::new(&format!("no shape {name:?}: plane, sphere, cylinder or cloth")))?;
        Ok(self.viewer.set_shape(shape)?)
    }

    /// What lies over the picture.
    #[wasm_bindgen(getter)]
    pub fn overlay(&self) -> String {
        self.viewer.engine().overlay().name().to_owned()
    }

    /// Lays what is known of pages over the picture, by a name of [`overlays`].
    ///
    /// # Errors
    /// For another name, or if the device fails.
    pub fn set_overlay(&mut self, name: &str) -> Result<(), JsError> {
        let overlay =
            Overlay::from_name(name).ok_or_else(|| JsError::new(&format!("no overlay {name:?}")))?;
        Ok(self.viewer.engine_mut().set_overlay(overlay)?)
    }

    /// Bytes of both caches on the GPU.
    #[wasm_bindgen(getter)]
    pub fn cache_bytes(&self) -> f64 {
        let budgets = self.viewer.budgets();
        (budgets.page_cache_bytes + budgets.column_cache_bytes) as f64
    }

    /// Changes the bytes of both caches, at once.
    ///
    /// # Errors
    /// For fewer than one page or column takes; then all stays as it is.
    pub fn set_cache_bytes(&mut self, bytes: f64) -> Result<(), JsError> {
        Ok(self.viewer.set_budgets(caches(self.viewer.budgets(), bytes))?)
    }
}

/// Budgets with so many bytes for both caches: columns are large and few, pages small and many.
pub(super) fn caches(budgets: Budgets, bytes: f64) -> Budgets {
    let bytes = bytes.max(LEAST_CACHE_BYTES) as u64;
    Budgets {
        page_cache_bytes: bytes - bytes / 3,
        column_cache_bytes: bytes / 3,
        ..budgets
    }
}
