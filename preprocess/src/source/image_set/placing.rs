//! Which image shows which directions: by a table, or by names.

use std::collections::{HashMap, HashSet};

use super::collection::{Collection, has_extension};
use super::grid::Placed;
use super::names::{self, Angles, Scheme};
use super::table;
use super::wording::{count, list};
use crate::Result;

/// Largest table of directions.
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// Extensions of images that are read.
pub(super) const READ: [&str; 6] = ["jpg", "jpeg", "png", "exr", "hdr", "pic"];
/// Where nothing says the direction of the view or the light.
const NORMAL: Angles = [0.0, 0.0];

/// The images that have directions, in no order.
#[derive(Debug)]
pub(super) struct Placing {
    pub(super) images: Vec<Placed>,
    pub(super) scheme: Scheme,
    /// What keeps the set from being a BTF.
    pub(super) problems: Vec<String>,
    /// What is worth knowing.
    pub(super) notes: Vec<String>,
}

impl Placing {
    fn new(scheme: Scheme) -> Self {
        Self {
            images: Vec::new(),
            scheme,
            problems: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// Images placed by a table; `None` if there is no table. `wanted` is its name.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] for a table that is wrong, or one too many.
pub(super) fn by_table(collection: &Collection, wanted: Option<&str>) -> Result<Option<Placing>> {
    let Some((table, rows)) = the_table(collection, wanted)? else {
        return Ok(None);
    };
    let mut placing = Placing::new(Scheme::Table);
    let files = collection.files();
    let table = &files[table].name;
    let folder = table.rfind('/').map_or("", |slash| &table[..=slash]);
    let by_name: HashMap<&str, usize> = files
        .iter()
        .enumerate()
        .map(|(index, file)| (file.name.as_str(), index))
        .collect();
    let (mut absent, mut used) = (Vec::new(), HashSet::new());
    for row in rows {
        let name = format!("{folder}{}", row.file);
        match by_name.get(name.as_str()) {
            Some(&file) => {
                used.insert(file);
                let (view, light) = (row.view.unwrap_or(NORMAL), row.light.unwrap_or(NORMAL));
                placing.images.push(Placed { file, view, light });
            }
            None => absent.push(format!("{name} (line {})", row.line)),
        }
    }
    let left_out =
        (0..files.len()).filter(|file| !used.contains(file) && has_extension(&files[*file].name, &READ));
    let left_out: Vec<&str> = left_out.map(|file| files[file].name.as_str()).collect();
    if !left_out.is_empty() {
        let note = format!(
            "{} not in {table} and left out: {}",
            count(left_out.len(), "image"),
            list(&left_out)
        );
        placing.notes.push(note);
    }
    if !absent.is_empty() {
        let detail = format!(
            "{} named in {table} not there: {}",
            count(absent.len(), "file"),
            list(&absent)
        );
        placing.problems.push(detail);
    }
    Ok(Some(placing))
}

/// The only table of directions in a set, and its rows.
fn the_table(collection: &Collection, wanted: Option<&str>) -> Result<Option<(usize, Vec<table::Row>)>> {
    let files = collection.files();
    let candidates = (0..files.len()).filter(|&file| match wanted {
        Some(wanted) => files[file].name == wanted,
        None => has_extension(&files[file].name, &["csv"]),
    });
    let mut found: Option<(usize, Vec<table::Row>)> = None;
    for file in candidates {
        let bytes = collection.read_first(file, MAX_TABLE_BYTES + 1)?;
        if bytes.len() as u64 > MAX_TABLE_BYTES {
            let detail = format!("is larger than {MAX_TABLE_BYTES} bytes");
            return Err(collection.error(file, detail));
        }
        let text = String::from_utf8_lossy(&bytes);
        let rows = table::parse(&text).map_err(|detail| collection.error(file, detail))?;
        match (rows, &found) {
            (Some(_), Some((other, _))) => {
                let other = &files[*other].name;
                let detail = format!("is a second table of directions beside {other}: name the one to use");
                return Err(collection.error(file, detail));
            }
            (Some(rows), None) => found = Some((file, rows)),
            (None, _) if wanted.is_some() => {
                let detail = "has no column file, expected file,theta_view,phi_view,theta_light,phi_light";
                return Err(collection.error(file, detail));
            }
            (None, _) => {}
        }
    }
    Ok(found)
}

/// Images placed by their names.
pub(super) fn by_names(collection: &Collection) -> Placing {
    let mut placing = Placing::new(Scheme::Angles);
    let files = collection.files();
    let images = (0..files.len()).filter(|&file| has_extension(&files[file].name, &READ));
    let (mut found, mut nameless, mut wrong) = (Vec::new(), Vec::new(), Vec::new());
    for file in images {
        let name = files[file].name.as_str();
        match names::parse(name) {
            Ok(directions) if directions.view.is_none() && directions.light.is_none() => nameless.push(name),
            Ok(directions) => found.push((file, directions)),
            Err(detail) => wrong.push(format!("{name}: {detail}")),
        }
    }
    // One view only has names without views, but then all of them.
    let views = found.iter().any(|(_, directions)| directions.view.is_some());
    let lights = found.iter().any(|(_, directions)| directions.light.is_some());
    for (file, directions) in found {
        let lacks = |any: bool, own: Option<Angles>| any && own.is_none();
        if lacks(views, directions.view) || lacks(lights, directions.light) {
            let what = if directions.view.is_none() {
                "view"
            } else {
                "light"
            };
            wrong.push(format!(
                "{}: its name lacks the {what}, other names have it",
                files[file].name
            ));
            continue;
        }
        let (view, light) = (
            directions.view.unwrap_or(NORMAL),
            directions.light.unwrap_or(NORMAL),
        );
        placing.images.push(Placed { file, view, light });
    }
    if let Some(first) = placing.images.first() {
        placing.scheme = Scheme::of(&files[first.file].name);
        for (is_there, what) in [(views, "view"), (lights, "light")] {
            if !is_there {
                placing.notes.push(format!(
                    "no name says the direction of the {what}: taken as the normal"
                ));
            }
        }
    }
    if !nameless.is_empty() && !placing.images.is_empty() {
        let note = format!(
            "{} without directions left out: {}",
            count(nameless.len(), "image"),
            list(&nameless)
        );
        placing.notes.push(note);
    }
    if !wrong.is_empty() {
        placing.problems.push(format!(
            "{} with unclear directions: {}",
            count(wrong.len(), "image"),
            list(&wrong)
        ));
    }
    placing
}
