//! What is seen after how many bytes and seconds, under networks.
//!
//! - [`measure`] (`run`) replays standing views and a way of the camera in simulated time, through `engine::stream::NetworkSource`, frame by
//!   frame of a sixtieth of a second: the same on every machine.
//! - [`Contender`]: our residency, and what it is measured against. `baseline` is a `engine::frame::Policy` with an order in which
//!   records are asked for (`order`); the engine, its budgets, its host cache and its decoder are the same for all.
//!   `schedule` is the best order for the gains that we count by, for those who know all from the start.
//! - `line`: the source of a replay, and what came over it. `replay`: one contender on one way. `truth`: settled pictures.
//! - [`table`](fn@table) and [`plot`](fn@plot) show.

mod baseline;
mod line;
mod order;
mod plot;
mod replay;
mod report;
mod run;
mod schedule;
mod slots;
mod truth;

pub(crate) use line::Line;
pub use order::Contender;
pub use plot::plot;
pub use replay::{Mark, Point, Replay};
pub use report::{moving, still, table};
pub(crate) use run::repeatable;
pub use run::{NamedNetwork, Plan, Results, Way, close_up, measure, middles, views, views_of_middles};
