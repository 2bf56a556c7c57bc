//! How good is the choice of what is resident? Traces of votes, replayed through several policies.
//!
//! - [`Trace`]: votes of each frame and the weights of the materials, as lines of JSON; [`generate`](fn@generate) makes one, [`record`](fn@record)
//!   records one of a real scene.
//! - `view`: what follows from the votes of one frame, and the error of a set of resident pages, the same for all.
//! - `ours`: `engine::residency`. `recency`: all that is wanted, least recently wanted goes. `paper`: Schwartz, Ruiters,
//!   Klein 2013, section 5, by its plain formulas. `optimum`: the least error that any closed set of pages has.
//! - [`run`](fn@run) replays, [`table`](fn@table) and [`plot`](fn@plot) show.
//!
//! Columns are given: every policy has all columns of what it sees, at no cost, so that pages alone are compared.

mod generate;
mod optimum;
mod ours;
mod paper;
mod recency;
mod record;
mod report;
mod run;
mod trace;
mod view;

pub use generate::{Synthetic, generate};
pub use optimum::optimum;
pub use record::record;
pub use report::{plot, table};
pub use run::{Plan, Point, Policy, Results, run};
pub use trace::{Trace, TraceMaterial};
