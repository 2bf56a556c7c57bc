//! Factorization against naive f64 algebra.

mod accuracy;
#[path = "../common/mod.rs"]
mod common;
mod low_rank;
mod refusals;
mod rounds;
mod support;
