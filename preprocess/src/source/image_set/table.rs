//! A table of directions beside the images, as comma-separated values (RFC 4180).
//!
//! The first line names the columns: `file`, and `theta_view`, `phi_view`, `theta_light`, `phi_light` in degrees, or
//! with `_rad` after the name in radians, in any order; other columns are left out. Without the columns of the view all
//! images have the view along the normal, and likewise with the light. `file` is a path relative to the table.

use super::names::{Angles, check};

/// A line of the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    /// From 1, the header being line 1.
    pub(super) line: usize,
    pub(super) file: String,
    pub(super) view: Option<Angles>,
    pub(super) light: Option<Angles>,
}

/// Reads the table; `Ok(None)` if it is another one, without a column `file`.
///
/// # Errors
/// What is wrong, and in which line.
pub(super) fn parse(text: &str) -> Result<Option<Vec<Row>>, String> {
    let mut records = records(text.strip_prefix('\u{feff}').unwrap_or(text))?.into_iter();
    let Some((_, header)) = records.next() else {
        return Ok(None);
    };
    let header: Vec<String> = header
        .iter()
        .map(|name| name.trim().to_ascii_lowercase())
        .collect();
    let Some(file) = header.iter().position(|name| name == "file") else {
        return Ok(None);
    };
    let columns = |what: &str| -> Result<Option<[Column; 2]>, String> {
        match (
            Column::find(&header, "theta", what),
            Column::find(&header, "phi", what),
        ) {
            (Some(theta), Some(phi)) => Ok(Some([theta, phi])),
            (None, None) => Ok(None),
            _ => Err(format!(
                "line 1: only one of the columns theta_{what} and phi_{what}"
            )),
        }
    };
    let (view, light) = (columns("view")?, columns("light")?);
    if view.is_none() && light.is_none() {
        return Err(format!(
            "line 1: columns {}, expected file,theta_view,phi_view,theta_light,phi_light",
            header.join(",")
        ));
    }
    let mut rows = Vec::new();
    for (line, fields) in records {
        if fields.len() != header.len() {
            return Err(format!(
                "line {line}: {} fields, expected {}",
                fields.len(),
                header.len()
            ));
        }
        let angles = |what: &str, columns: Option<[Column; 2]>| -> Result<Option<Angles>, String> {
            let Some([theta, phi]) = columns else {
                return Ok(None);
            };
            let angles = [theta.degrees(&fields)?, phi.degrees(&fields)?];
            check(what, angles).map(Some)
        };
        let at = |detail: String| format!("line {line}: {detail}");
        rows.push(Row {
            line,
            file: clean(&fields[file]),
            view: angles("view", view).map_err(at)?,
            light: angles("light", light).map_err(at)?,
        });
    }
    if rows.is_empty() {
        return Err("no line after the names of the columns".into());
    }
    Ok(Some(rows))
}

/// A column of angles.
#[derive(Clone, Copy)]
struct Column {
    index: usize,
    radians: bool,
}

impl Column {
    fn find(header: &[String], angle: &str, what: &str) -> Option<Self> {
        let find = |suffix: &str| {
            header
                .iter()
                .position(|name| *name == format!("{angle}_{what}{suffix}"))
        };
        let degrees = find("").or_else(|| find("_deg")).map(|index| (index, false));
        let (index, radians) = degrees.or_else(|| find("_rad").map(|index| (index, true)))?;
        Some(Self { index, radians })
    }

    fn degrees(self, fields: &[String]) -> Result<f64, String> {
        let text = fields[self.index].trim();
        let angle: f64 = text.parse().map_err(|_| format!("{text:?} is no angle"))?;
        Ok(if self.radians { angle.to_degrees() } else { angle })
    }
}

/// A path as collections name it.
fn clean(path: &str) -> String {
    let path = path.trim().replace('\\', "/");
    path.strip_prefix("./").unwrap_or(&path).to_owned()
}

/// Lines and their fields; empty lines are left out.
fn records(text: &str) -> Result<Vec<(usize, Vec<String>)>, String> {
    let mut records = Vec::new();
    let (mut fields, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let (mut line, mut began) = (1, 1);
    let mut characters = text.chars().peekable();
    loop {
        let character = characters.next();
        match character {
            Some('"') if quoted && characters.peek() == Some(&'"') => {
                field.push('"');
                characters.next();
            }
            Some('"') if quoted || field.trim().is_empty() => quoted = !quoted,
            Some(',') if !quoted => fields.push(std::mem::take(&mut field)),
            Some('\r') if !quoted => {}
            None if quoted => return Err(format!("line {began}: a quotation mark is not closed")),
            Some('\n') | None if !quoted => {
                if !fields.is_empty() || !field.trim().is_empty() {
                    fields.push(std::mem::take(&mut field));
                    records.push((began, std::mem::take(&mut fields)));
                }
                field.clear();
                line += 1;
                began = line;
            }
            Some(other) => {
                line += usize::from(other == '\n');
                field.push(other);
            }
            None => {}
        }
        if character.is_none() {
            return Ok(records);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_in_degrees_and_radians_are_read() {
        let text = "\u{feff}phi_light_rad, theta_light_rad,File,exposure\r\n0.5,0.25,\"a, \"\"b\"\".png\",1\r\n\r\n0,0,./c.png,2";
        let rows = parse(text).unwrap().unwrap();
        assert_eq!((rows[0].line, rows[0].file.as_str()), (2, "a, \"b\".png"));
        assert_eq!(rows[0].light, Some([0.25f64.to_degrees(), 0.5f64.to_degrees()]));
        assert_eq!(
            (rows[1].line, rows[1].file.as_str(), rows[1].view),
            (4, "c.png", None)
        );

        let rows = parse("file,theta_view,phi_view\nx.png,90,360\n")
            .unwrap()
            .unwrap();
        assert_eq!((rows[0].view, rows[0].light), (Some([90.0, 360.0]), None));
        assert_eq!(parse("name,size\nx,1\n"), Ok(None), "another table");
        assert_eq!(parse(""), Ok(None));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        for (text, expected) in [
            (
                "file,theta_view\nx,1",
                "only one of the columns theta_view and phi_view",
            ),
            ("file,size\nx,1", "columns file,size"),
            (
                "file,theta_view,phi_view\nx,1,2\ny,1",
                "line 3: 2 fields, expected 3",
            ),
            ("file,theta_view,phi_view\nx,one,2", "line 2: \"one\" is no angle"),
            (
                "file,theta_view,phi_view\nx,91,2",
                "line 2: the view has theta 91",
            ),
            (
                "file,theta_view,phi_view\nx,nan,2",
                "line 2: the view has theta NaN",
            ),
            ("file,theta_view,phi_view\n\"x,1,2", "line 2: a quotation mark"),
            ("file,theta_view,phi_view\n", "no line after"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
    }
}
