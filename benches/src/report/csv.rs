//! Lines for spreadsheets and other programs, of whatever serializes.

use serde::Serialize;
use serde_json::Value;

use crate::{Error, Result};

/// A line for each row and a column for each number, text or truth inside of it, called by its path (`full.rmse`, `size.0`);
/// columns are those of all rows, in the order in which they first come. What a row does not have is empty. RFC 4180.
///
/// # Errors
/// [`Error::Invalid`] for what does not serialize as JSON.
pub fn csv<T: Serialize>(rows: &[T]) -> Result<String> {
    let mut columns: Vec<String> = Vec::new();
    let mut lines = Vec::new();
    for row in rows {
        let value = serde_json::to_value(row).map_err(|error| Error::Invalid {
            what: "a row of a table",
            found: error.to_string(),
            expected: "what JSON can hold",
        })?;
        let mut line = vec![String::new(); columns.len()];
        flatten("", &value, &mut |path, text| {
            let at = columns
                .iter()
                .position(|column| column == path)
                .unwrap_or_else(|| {
                    columns.push(path.to_owned());
                    line.push(String::new());
                    columns.len() - 1
                });
            line[at] = text;
        });
        lines.push(line);
    }
    let mut text = joined(columns.iter().map(String::as_str), 0);
    for line in lines {
        let missing = columns.len() - line.len();
        text += &joined(line.iter().map(String::as_str), missing);
    }
    Ok(text)
}

fn flatten(path: &str, value: &Value, cell: &mut impl FnMut(&str, String)) {
    let below = |name: &str| {
        if path.is_empty() {
            name.to_owned()
        } else {
            format!("{path}.{name}")
        }
    };
    match value {
        Value::Object(members) => members
            .iter()
            .for_each(|(name, value)| flatten(&below(name), value, cell)),
        Value::Array(values) => {
            for (at, value) in values.iter().enumerate() {
                flatten(&below(&at.to_string()), value, cell);
            }
        }
        Value::Null => cell(path, String::new()),
        Value::String(text) => cell(path, text.clone()),
        Value::Bool(_) | Value::Number(_) => cell(path, value.to_string()),
    }
}

fn joined<'a>(cells: impl Iterator<Item = &'a str>, missing: usize) -> String {
    let quoted = |cell: &str| {
        if cell.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell.to_owned()
        }
    };
    let cells: Vec<_> = cells.map(quoted).collect();
    cells.join(",") + &",".repeat(missing) + "\n"
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn nested_rows_become_lines() {
        let rows = [
            json!({"a": 1, "b": {"x": 0.5, "y": null}, "c": "one, \"two\""}),
            json!({"a": 2, "b": {"x": true}, "c": "", "d": [3, 4]}),
        ];
        assert_eq!(
            csv(&rows).unwrap(),
            "a,b.x,b.y,c,d.0,d.1\n1,0.5,,\"one, \"\"two\"\"\",,\n2,true,,,3,4\n"
        );
        assert_eq!(csv::<Value>(&[]).unwrap(), "\n");
    }
}
