//! The phases of a frame: feedback → votes → residency → requests → answers → decode → placement → picture.

use super::{Engine, events::Event, visibility::visibility};
use crate::{
    Result,
    decode::Decoded,
    gpu::{Ask, materials::Btf},
    residency::{Item, MaterialId, MaterialInfo, Placement, Summary},
    stream::Request,
};

impl Engine {
    /// Visibility, where the view is new, and votes, where some are missing.
    pub(super) fn look(&mut self, moved: bool) {
        self.look_ahead(moved);
        let pending = self.renderer.votes_pending();
        let stride = self.options.feedback_stride;
        let phase = self
            .window
            .next(self.view, pending)
            .filter(|_| !self.btfs.is_empty());
        let ask = phase.map(|phase| Ask {
            stride,
            phase,
            tag: self.window.tag(self.view, phase),
        });
        let camera = self.camera.as_ref().filter(|_| moved);
        let asked = self.renderer.look(camera, ask);
        match ask {
            Some(ask) if asked => self.window.asked(self.view, ask.phase),
            _ => self.counters.feedback_skipped += 1,
        }
    }

    /// Takes what has come back from the GPU; waits for it, if so chosen.
    pub(super) fn poll(&mut self) -> Result<()> {
        if self.options.wait {
            self.renderer.wait()?;
        }
        let (counted, gpu) = self.renderer.poll()?;
        self.gpu = gpu.or(self.gpu);
        for counted in counted {
            if let Some(counted) = self.ahead.insert(counted) {
                self.window.insert(counted);
            }
        }
        Ok(())
    }

    /// Votes to residency; its plan to the records.
    pub(super) fn decide(&mut self) {
        let plan = self.update_residency();
        let now = self.now();
        self.records.follow(
            &plan,
            &mut *self.residency,
            now,
            &self.btfs,
            &mut *self.source,
            &mut self.counters,
        );
    }

    /// Submits requests and takes the answers that are there: at most as many as can be in flight, so that a
    /// source that answers at once cannot hold up a frame.
    pub(super) fn receive(&mut self) {
        self.archives.submit(&mut *self.source);
        let now = self.now();
        let unknown = self.archives.count().saturating_sub(self.archives.decided());
        self.records.submit(now, unknown, &self.btfs, &mut *self.source);
        for _ in 0..self.source.capacity() {
            let Some(answer) = self.source.poll() else { break };
            self.wire_bytes += answer.wire_bytes;
            self.archives
                .count_bytes(answer.request.archive(), answer.wire_bytes);
            match answer.request {
                Request::Index { .. } => {
                    self.records.carried(answer.wire_bytes);
                    self.archives.receive(answer, &mut self.problems);
                }
                _ => self
                    .records
                    .receive(answer, now, &self.btfs, &mut self.counters, &mut self.problems),
            }
        }
        for material in self.records.take_changed() {
            self.reload(material);
        }
    }

    /// Asks for the index of an archive that has changed. What is there of the version before is shown until the new one is
    /// known; nothing more of it is asked for, so that no record of one is ever taken for one of the other.
    fn reload(&mut self, material: MaterialId) {
        if !self.archives.reload(material.0.into()) {
            return;
        }
        // Its failure counts, so that a source that says so again and again is asked ever more rarely.
        self.fail_items();
        self.residency.set_retired(material, true);
        self.records.forget(material, &self.btfs, &mut *self.source);
    }

    /// Tells residency what could not be had.
    fn fail_items(&mut self) {
        for item in self.records.take_failed() {
            self.residency.failed(item);
        }
    }

    /// Takes the materials whose archives have become known into tables and residency.
    pub(super) fn learn(&mut self) -> Result<()> {
        let mut read = self
            .archives
            .take_read(self.options.budgets.decodes_per_frame, &mut self.problems);
        if read.is_empty() {
            return Ok(());
        }
        read.retain(|(archive, btf)| {
            let shown = self.archives.shown(*archive);
            let same = shown.filter(|&shown| self.btfs[shown].index == btf.index);
            if let Some(same) = same {
                // It has not changed after all.
                self.archives.set_known(*archive, same);
                self.residency.set_retired(MaterialId(same as u16), false);
            }
            same.is_none()
        });
        let caches = self.caches();
        for (_, btf) in &mut read {
            btf.angular = self.options.angular;
            btf.page_format = self.format;
        }
        read.retain(|(archive, btf)| {
            let fits = self.renderer.layout(caches, btf.column_quads());
            let fits = fits.and_then(|_| self.renderer.add_btf(btf));
            if let Err(error) = &fits {
                self.archives.give_up(*archive, error, &mut self.problems);
            }
            fits.is_ok()
        });
        for (archive, btf) in read {
            self.archives.set_known(archive, self.btfs.len());
            self.residency.add_material(material_info(&btf));
            self.window.add_material(btf.pyramid().tile_count());
            self.worths.add(&btf);
            self.events.add(Event::MaterialKnown {
                archive: btf.archive.clone(),
            });
            self.btfs.push(btf.into());
        }
        self.resize_caches()?;
        self.renderer.show_btfs(&self.archives.btf_of_material())?;
        // All pixels vote again: some see what had no votes before.
        self.view += 1;
        self.ahead.ask_again();
        self.changed = true;
        Ok(())
    }

    /// Hands out what has arrived, takes back what has been decoded.
    pub(super) fn decode(&mut self) -> Vec<(Item, Decoded)> {
        self.records
            .start_decoding(&self.btfs, &mut self.counters, &mut self.problems);
        self.take_decoded()
    }

    /// Takes back what has been decoded.
    pub(super) fn take_decoded(&mut self) -> Vec<(Item, Decoded)> {
        let now = self.now();
        let decoded = self.records.finish_decoding(now, &self.btfs, &mut self.problems);
        self.fail_items();
        decoded
    }

    /// Puts what has arrived where residency says.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the GPU is to decode pages and cannot.
    pub(super) fn place(&mut self, arrived: Vec<(Item, Decoded)>) -> Result<()> {
        for (item, decoded) in arrived {
            let Placement::Place { slot, evicted } = self.residency.arrived(item) else {
                self.counters.arrivals_dropped += 1;
                continue;
            };
            evicted.into_iter().for_each(|item| self.remove(item));
            self.placed.set(item, slot, self.frames);
            match (item, decoded) {
                (Item::Page(material, page), Decoded::Page(texels)) => {
                    self.renderer.place_page(material.0.into(), page, slot, &texels);
                }
                (Item::Page(material, page), Decoded::Rounded(rounded)) => {
                    self.renderer
                        .place_rounded(material.0.into(), page, slot, rounded);
                }
                (Item::Page(material, page), Decoded::Coefficients(coefficients)) => {
                    self.renderer
                        .place_coefficients(material.0.into(), page, slot, coefficients)?;
                }
                (Item::Column(material, group), Decoded::Column(quads)) => {
                    self.renderer.place_column(material.0.into(), group, slot, quads);
                }
                _ => unreachable!("pages decode to pages, columns to columns"),
            }
            self.changed = true;
        }
        Ok(())
    }

    /// Takes what is not resident any more out of the page table.
    pub(super) fn remove(&mut self, item: Item) {
        match item {
            Item::Page(material, page) => self.renderer.remove_page(material.0.into(), page),
            Item::Column(material, group) => self.renderer.remove_column(material.0.into(), group),
        }
    }

    /// Draws, if anything has changed. Returns whether it did.
    pub(super) fn draw(&mut self) -> Result<bool> {
        let overlaid = self.tell_overlay()?;
        if !self.changed {
            self.counters.draws_skipped += 1;
            if overlaid {
                self.renderer.draw_screen(self.options.exposure_stops.exp2());
            }
            return Ok(overlaid);
        }
        self.renderer.draw(self.options.exposure_stops.exp2());
        self.changed = false;
        self.poll()?;
        Ok(true)
    }

    pub(super) fn settled(&self, summary: &Summary) -> bool {
        let counted = self.window.complete(self.view) && self.ahead.complete();
        self.archives.decided() == self.archives.count()
            && (counted || self.btfs.is_empty())
            && summary.settled
            && self.records.idle()
            && !self.renderer.fading()
            && self.format_is_final()
    }
}

/// What residency knows of a BTF.
pub(super) fn material_info(btf: &Btf) -> MaterialInfo {
    MaterialInfo {
        pyramid: *btf.pyramid(),
        groups: btf.groups(),
        weights: btf.weights().collect(),
        visibility: visibility(btf),
        page_bytes: btf.index.pages().iter().map(|record| record.length).collect(),
        column_bytes: btf.index.columns().iter().map(|record| record.length).collect(),
    }
}
