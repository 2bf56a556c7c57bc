//! The import resolver: `#import name` on a line of its own stands for the file `wgsl/name.wgsl`, once. Lines that enable
//! extensions of WGSL come first, as it wants them.

/// An import that cannot be resolved.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no such file.
    #[error("{importer}: #import {name}: no such shader; there are {known}")]
    Unknown {
        /// Who imports.
        importer: String,
        /// What.
        name: String,
        /// All names.
        known: String,
    },
    /// Files import each other in a circle.
    #[error("{importer}: #import {name}: {name} already imports {importer}")]
    Cycle {
        /// Who closes the circle.
        importer: String,
        /// What it imports.
        name: String,
    },
}

macro_rules! embed {
    ($($name:literal),* $(,)?) => {
        /// Names of all shader files.
        pub const NAMES: &[&str] = &[$($name),*];

        fn embedded(name: &str) -> Option<&'static str> {
            match name {
                $($name => Some(include_str!(concat!("../wgsl/", $name, ".wgsl"))),)*
                _ => None,
            }
        }
    };
}

embed!(
    "btf",
    "byte_slots",
    "classify",
    "columns",
    "compact",
    "decode",
    "delaunay",
    "directions",
    "eigen",
    "feedback",
    "finite",
    "frame",
    "geometry",
    "half",
    "half_slots",
    "hemisphere",
    "light",
    "material",
    "overlay",
    "pages",
    "present",
    "resident",
    "shade",
    "single",
    "stitch",
    "surface",
    "tonemap",
    "tones",
    "visibility",
    "work",
);

/// Imports that stand for one of several files, which define the same functions in different ways. The first is meant
/// where none is chosen.
pub const CHOICES: &[(&str, &[&str])] = &[
    ("angular", &["delaunay", "hemisphere"]),
    ("arithmetic", &["single", "half"]),
    ("slots", &["half_slots", "byte_slots"]),
    ("textures", &["eigen", "resident"]),
];

/// The source of a shader file with all that it imports, each file once and before its first importer.
///
/// # Errors
/// [`Error::Unknown`] if there is no such shader, or one of its imports does not exist.
pub fn shader(name: &str) -> Result<String, Error> {
    variant(name, &[])
}

/// As [`shader`], with files for imports that are [`CHOICES`]: pairs of import and file.
///
/// # Errors
/// [`Error`], naming importer and import.
pub fn variant(name: &str, choices: &[(&str, &str)]) -> Result<String, Error> {
    resolve(name, &|import| {
        let chosen = choices.iter().find(|(choice, _)| *choice == import);
        let first = CHOICES.iter().find(|(choice, _)| *choice == import);
        let file = chosen.map(|(_, file)| *file).or(first.map(|(_, files)| files[0]));
        embedded(file.unwrap_or(import))
    })
}

/// As [`shader`], with the files from elsewhere.
///
/// # Errors
/// [`Error`], naming importer and import.
pub fn resolve<'a>(name: &str, source: &dyn Fn(&str) -> Option<&'a str>) -> Result<String, Error> {
    let mut resolver = Resolver {
        source,
        done: Vec::new(),
        open: Vec::new(),
        enabled: String::new(),
        text: String::new(),
    };
    resolver.include("caller", name)?;
    Ok(resolver.enabled + &resolver.text)
}

struct Resolver<'s, 'a> {
    source: &'s dyn Fn(&str) -> Option<&'a str>,
    done: Vec<String>,
    open: Vec<String>,
    enabled: String,
    text: String,
}

impl Resolver<'_, '_> {
    fn include(&mut self, importer: &str, name: &str) -> Result<(), Error> {
        if self.done.iter().any(|done| done == name) {
            return Ok(());
        }
        if self.open.iter().any(|open| open == name) {
            return Err(Error::Cycle {
                importer: importer.into(),
                name: name.into(),
            });
        }
        let source = (self.source)(name).ok_or_else(|| Error::Unknown {
            importer: importer.into(),
            name: name.into(),
            known: NAMES.join(", "),
        })?;
        self.open.push(name.into());
        for line in source.lines() {
            if let Some(import) = line.strip_prefix("#import ") {
                self.include(name, import.trim())?;
            }
        }
        for line in source.lines().filter(|line| !line.starts_with("#import ")) {
            let text = match line.starts_with("enable ") {
                true => &mut self.enabled,
                false => &mut self.text,
            };
            text.push_str(line);
            text.push('\n');
        }
        self.open.pop();
        self.done.push(name.into());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(name: &str) -> Option<&'static str> {
        Some(match name {
            "a" => "#import b\n#import c\nA",
            "b" => "#import c\nB",
            "c" => "C\nenable x;",
            "circle" => "#import circle",
            "lost" => "#import nowhere",
            _ => return None,
        })
    }

    #[test]
    fn each_file_comes_once_and_before_its_importers() {
        assert_eq!(resolve("a", &files).unwrap(), "enable x;\nC\nB\nA\n");
    }

    #[test]
    fn errors_name_importer_and_import() {
        assert!(
            matches!(resolve("circle", &files), Err(Error::Cycle { importer, .. }) if importer == "circle")
        );
        let error = resolve("lost", &files).unwrap_err().to_string();
        assert!(error.contains("lost") && error.contains("nowhere"), "{error}");
        assert!(shader("nonsense").is_err());
    }

    #[test]
    fn every_file_of_the_folder_is_embedded() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/wgsl");
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| {
                entry
                    .unwrap()
                    .path()
                    .file_stem()
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_owned()
            })
            .collect();
        names.sort();
        assert_eq!(names, NAMES);
    }
}
