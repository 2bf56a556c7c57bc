//! The numbers of a report, by place.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

/// Longest text that names an entry of a list.
const LONGEST_NAME: usize = 40;

/// The numbers and texts of a report, or of several of the same measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// By place the values of all rounds and reports.
    pub numbers: BTreeMap<String, Vec<f64>>,
    /// By place, those of the first report; whether something is so counts as a text.
    pub texts: BTreeMap<String, String>,
}

impl Figures {
    /// Of one report.
    pub fn of(report: &Value) -> Self {
        let mut figures = Self::default();
        figures.add(report);
        figures
    }

    /// Adds another report of the same measurement by the same program.
    pub fn add(&mut self, report: &Value) {
        self.walk(String::new(), report);
    }

    fn walk(&mut self, place: String, value: &Value) {
        match value {
            Value::Null => {}
            Value::Bool(so) => self.text(place, so.to_string()),
            Value::String(text) => self.text(place, text.clone()),
            Value::Number(number) => {
                let values = self.numbers.entry(place).or_default();
                values.extend(number.as_f64());
            }
            Value::Object(fields) => {
                for (name, value) in fields {
                    let place = if place.is_empty() {
                        name.clone()
                    } else {
                        format!("{place}.{name}")
                    };
                    self.walk(place, value);
                }
            }
            Value::Array(values) if place.ends_with("rounds") && values.iter().all(Value::is_number) => {
                let rounds = values.iter().filter_map(Value::as_f64);
                self.numbers.entry(place).or_default().extend(rounds);
            }
            Value::Array(values) => {
                let mut names = BTreeSet::new();
                for (at, value) in values.iter().enumerate() {
                    let name = name(value).unwrap_or_else(|| at.to_string());
                    let name = if names.contains(&name) {
                        format!("{name} #{at}")
                    } else {
                        name
                    };
                    self.walk(format!("{place}[{name}]"), value);
                    names.insert(name);
                }
            }
        }
    }

    fn text(&mut self, place: String, text: String) {
        self.texts.entry(place).or_insert(text);
    }
}

/// The short texts in an entry of a list.
fn name(value: &Value) -> Option<String> {
    let fields = value.as_object()?.values();
    let texts = fields.filter_map(Value::as_str);
    let short: Vec<&str> = texts
        .filter(|text| text.chars().count() <= LONGEST_NAME)
        .collect();
    (!short.is_empty()).then(|| short.join("/"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn places_are_named_by_what_stands_there() {
        let report = json!({
            "device": "llvmpipe",
            "cases": [
                { "name": "tori", "ms": 2.5, "settled": true, "ms_rounds": [1, 2, 3] },
                { "name": "tori", "ms": 3.5, "left": null },
                [7],
            ],
        });
        let mut figures = Figures::of(&report);
        assert_eq!(
            figures.numbers.keys().collect::<Vec<_>>(),
            [
                "cases[2][0]",
                "cases[tori #1].ms",
                "cases[tori].ms",
                "cases[tori].ms_rounds"
            ]
        );
        assert_eq!(figures.numbers["cases[tori].ms_rounds"], [1.0, 2.0, 3.0]);
        assert_eq!(figures.texts["cases[tori].settled"], "true");
        figures.add(&report);
        assert_eq!(figures.numbers["cases[tori].ms"], [2.5, 2.5]);
    }
}
