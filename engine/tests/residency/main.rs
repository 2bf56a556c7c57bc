//! Residency: its rules one by one, and its promises over random traces, beside a plain model.

mod ahead;
mod driver;
mod plain;
mod rules;
mod scene;
mod traces;
