//! The picture: its size, a part of a target for it, and the split view.

use engine::{
    Result,
    decode::PAGE_BYTES,
    frame::{Budgets, Engine, FrameStats, Options},
    gpu::{Area, PageFormat, Present},
    stream::TileSource,
};

use super::Viewer;

/// Most bytes of each cache of the reference picture; of larger scenes it shows what fits, and its error says so.
const MOST_REFERENCE_BYTES: u64 = 1 << 30;

impl Viewer {
    /// Pixels of the picture.
    pub fn size(&self) -> (u32, u32) {
        self.engine.size()
    }

    /// Changes the size of the picture.
    ///
    /// # Errors
    /// Those of [`Engine::resize`].
    pub fn resize(&mut self, size: (u32, u32)) -> Result<()> {
        if size == self.engine.size() {
            return Ok(());
        }
        self.engine.resize(size)?;
        if let Some((reference, _)) = &mut self.reference {
            reference.resize(size)?;
        }
        self.controls.set_height(size.1);
        Ok(())
    }

    /// Draws the last frame into `area` of a target of `size`; the rest becomes black. With a [`Viewer::reference`], what lies to
    /// the right of `split` (from 0, the left edge, to 1) is that one's picture.
    ///
    /// # Errors
    /// [`engine::Error::Adapter`] if the device fails.
    pub fn present(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        format: wgpu::TextureFormat,
        size: (u32, u32),
        area: Area,
        split: f32,
    ) -> Result<()> {
        let present = match &mut self.present {
            Some((of, present)) if *of == format => present,
            place => {
                let made = Present::new(self.engine.context(), format)?;
                &mut place.insert((format, made)).1
            }
        };
        let mut pictures = vec![(self.engine.screen(), area, area)];
        if let Some((reference, _)) = &self.reference {
            let left = (area.width as f32 * split.clamp(0.0, 1.0)) as u32;
            let right = Area {
                x: area.x.saturating_add(left),
                width: area.width - left.min(area.width),
                ..area
            };
            pictures.push((reference.screen(), area, right));
        }
        present.encode(encoder, target, size, &pictures);
        Ok(())
    }

    /// The engine whose picture is on the right of the split, if there is one, and what its last frame did.
    pub fn reference(&self) -> Option<(&Engine, &FrameStats)> {
        self.reference.as_ref().map(|(engine, stats)| (engine, stats))
    }

    /// Shows the picture of a second engine beside: of half floats, nothing left out, with room for all pages and columns of the
    /// archives that are known, within a gibibyte a cache, from `source`; `None` ends that. It streams like the first: until it
    /// has settled, its own error says how far it is.
    ///
    /// # Errors
    /// Those of [`Engine::new`].
    pub fn set_reference(&mut self, source: Option<Box<dyn TileSource>>) -> Result<()> {
        self.reference = match source {
            None => None,
            Some(source) => {
                let options = Options {
                    budgets: self.ample(),
                    component_error: 0.0,
                    page_format: Some(PageFormat::Half),
                    ..self.engine.options().clone()
                };
                let context = self.engine.context().clone();
                let engine = Engine::new(context, &self.scene(), source, options)?;
                Some((engine, FrameStats::default()))
            }
        };
        Ok(())
    }

    /// Budgets with room for all that is known, and at least what there is now.
    fn ample(&self) -> Budgets {
        let now = self.engine.budgets();
        let (_, column_bytes) = self.engine.column_slots();
        let (mut pages, mut columns) = (0, 0);
        for material in self.engine.material_infos() {
            let groups = u64::from(material.groups);
            pages += u64::from(material.pyramid.tile_count()) * groups * PAGE_BYTES;
            columns += groups * column_bytes;
        }
        // Budgets are rounded down to whole layers and rows.
        let room = |bytes: u64, least: u64| {
            (bytes + bytes / 8)
                .max(least)
                .min(MOST_REFERENCE_BYTES.max(least))
        };
        Budgets {
            page_cache_bytes: room(pages, now.page_cache_bytes),
            column_cache_bytes: room(columns, now.column_cache_bytes),
            ..now
        }
    }
}
