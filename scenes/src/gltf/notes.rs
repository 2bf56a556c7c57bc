//! What of a file is not shown, and what was mended.

use gltf::json::Root;

/// Most notes that are kept of a file; the last one counts the others.
pub const MAX_NOTES: usize = 100;

/// Notes, up to a limit.
#[derive(Default)]
pub(super) struct Notes {
    kept: Vec<String>,
    more: usize,
}

impl Notes {
    pub(super) fn add(&mut self, note: String) {
        if self.kept.len() < MAX_NOTES - 1 {
            self.kept.push(note);
        } else {
            self.more += 1;
        }
    }

    pub(super) fn finish(mut self) -> Vec<String> {
        if self.more > 0 {
            self.kept.push(format!("and {} more", self.more));
        }
        self.kept
    }

    /// What concerns the whole file.
    pub(super) fn survey(&mut self, root: &Root) {
        for (what, count) in [("animations", root.animations.len()), ("skins", root.skins.len())] {
            if count > 0 {
                self.add(format!("{count} {what} are not shown: meshes stand as they are"));
            }
        }
        let morphed = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let morphed = morphed.filter(|primitive| primitive.targets.is_some()).count();
        if morphed > 0 {
            self.add(format!(
                "{morphed} primitives have morph targets, which are not shown"
            ));
        }
        let textured = |material: &&gltf::json::Material| {
            let look = &material.pbr_metallic_roughness;
            look.base_color_texture.is_some()
                || look.metallic_roughness_texture.is_some()
                || material.normal_texture.is_some()
                || material.occlusion_texture.is_some()
                || material.emissive_texture.is_some()
        };
        let textured = root.materials.iter().filter(textured).count();
        if textured > 0 {
            self.add(format!(
                "{textured} materials have textures, which are not shown: baseColorFactor alone, diffuse"
            ));
        }
        let transparent = (root.materials.iter())
            .filter(|material| material.alpha_mode.as_ref() != checked_opaque())
            .count();
        if transparent > 0 {
            self.add(format!(
                "{transparent} materials are transparent or cut out; they are drawn opaque"
            ));
        }
    }
}

fn checked_opaque() -> gltf::json::validation::Checked<&'static gltf::json::material::AlphaMode> {
    gltf::json::validation::Checked::Valid(&gltf::json::material::AlphaMode::Opaque)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_bounded_and_counted() {
        let mut notes = Notes::default();
        (0..MAX_NOTES + 41).for_each(|n| notes.add(n.to_string()));
        let notes = notes.finish();
        assert_eq!((notes.len(), notes[99].as_str()), (MAX_NOTES, "and 42 more"));
    }
}
