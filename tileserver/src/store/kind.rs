//! What is served, by its name: archives, and a few kinds of files beside them.

use std::collections::BTreeMap;

use crate::{MAX_ARCHIVES, MAX_FILES};

/// What a file is, as its ending says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `.bsvtf`.
    Archive,
    /// `.gltf` and `.glb`.
    Scene,
    /// `.png`, `.jpg`, `.jpeg`, `.webp`: a thumbnail, or a texture of a scene.
    Picture,
    /// `.bin`: buffers of a scene.
    Data,
}

/// Endings, what they stand for, and media types. Nothing that a browser would run.
const KINDS: [(&str, Kind, &str); 8] = [
    ("bsvtf", Kind::Archive, "application/octet-stream"),
    ("gltf", Kind::Scene, "model/gltf+json"),
    ("glb", Kind::Scene, "model/gltf-binary"),
    ("webp", Kind::Picture, "image/webp"),
    ("jpg", Kind::Picture, "image/jpeg"),
    ("jpeg", Kind::Picture, "image/jpeg"),
    ("png", Kind::Picture, "image/png"),
    ("bin", Kind::Data, "application/octet-stream"),
];

impl Kind {
    /// What a file of this name is served as, and its media type; `None` for others, for hidden ones, and for names that
    /// addresses cannot carry.
    pub fn of(file: &str) -> Option<(Self, &'static str)> {
        let (name, ending) = file.rsplit_once('.')?;
        let known = KINDS.iter().find(|(known, ..)| *known == ending);
        let refused = name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']);
        let (_, kind, media) = known.filter(|_| !refused && !name.contains(char::is_control))?;
        // Would be taken for the file of another archive.
        let confusing = *kind == Self::Archive && name.ends_with(".bsvtf");
        (!confusing).then_some((*kind, *media))
    }
}

/// The name under which an archive is served; `None` for other files.
pub(crate) fn archive_name(file: &str) -> Option<&str> {
    Kind::of(file).filter(|(kind, _)| *kind == Kind::Archive)?;
    file.strip_suffix(".bsvtf")
}

/// Files of a list as they are found, within the limits: the first by name stay.
pub(crate) struct Found<T> {
    archives: BTreeMap<String, T>,
    others: BTreeMap<String, T>,
}

impl<T> Found<T> {
    pub(crate) fn new() -> Self {
        Self {
            archives: BTreeMap::new(),
            others: BTreeMap::new(),
        }
    }

    /// Takes a file if it is of those that are served. `false` if there were too many, so that one had to go.
    pub(crate) fn add(&mut self, file: &str, value: T) -> bool {
        let (of_kind, limit) = match Kind::of(file) {
            None => return true,
            Some((Kind::Archive, _)) => (&mut self.archives, MAX_ARCHIVES),
            Some(_) => (&mut self.others, MAX_FILES),
        };
        of_kind.insert(file.to_owned(), value);
        of_kind.len() <= limit || of_kind.pop_last().is_none()
    }

    /// All, in the order of their names.
    pub(crate) fn all(mut self) -> BTreeMap<String, T> {
        self.archives.append(&mut self.others);
        self.archives
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_archives() {
        for (file, name) in [
            ("cloth.bsvtf", Some("cloth")),
            ("wool 2.bsvtf", Some("wool 2")),
            ("größe.bsvtf", Some("größe")),
            ("cloth.png.bsvtf", Some("cloth.png")),
            ("cloth.BSVTF", None),
            ("cloth.bsvtf.part", None),
            ("cloth.bsvtf.bsvtf", None),
            (".bsvtf", None),
            (".hidden.bsvtf", None),
            ("new\nline.bsvtf", None),
            ("in/ner.bsvtf", None),
        ] {
            assert_eq!(archive_name(file), name, "{file:?}");
        }
    }

    #[test]
    fn files_beside_archives() {
        for (file, kind) in [
            ("cloth.png", Some((Kind::Picture, "image/png"))),
            ("table.gltf", Some((Kind::Scene, "model/gltf+json"))),
            ("table.bin", Some((Kind::Data, "application/octet-stream"))),
            ("page.html", None),
            ("drawing.svg", None),
            ("cloth.bsvtf.new", None),
            (".hidden.png", None),
            ("..png", None),
            ("a\\b.png", None),
            ("png", None),
        ] {
            assert_eq!(Kind::of(file), kind, "{file:?}");
        }
    }

    #[test]
    fn the_first_stay() {
        let mut found = Found::new();
        for at in (0..MAX_FILES).rev() {
            assert!(found.add(&format!("{at:06}.png"), at));
        }
        assert!(found.add("page.html", 0), "is not served, and in nobody's way");
        assert!(!found.add("999999.png", 0));
        assert!(found.add("z.bsvtf", 0), "archives are counted by themselves");
        let all = found.all();
        assert_eq!(all.len(), MAX_FILES + 1);
        assert!(all.contains_key("000000.png") && !all.contains_key("999999.png"));
    }
}
