//! A camera at random for an hour of simulated time, over a line that fails: what may not grow does not, no budget is ever
//! exceeded, and in the end there is the right picture.
//!
//! Four frames stand for a second. All of it follows from a seed: the camera (`wander`), the phases in which the connection is lost, records come
//! damaged, the server starts again, the line is slow (`weather`), and what the network does to each answer
//! (`engine::stream::NetworkSource`). `line` sees all requests, and adds up what is in flight. `run` looks after every frame.

mod line;
mod run;
mod wander;
mod weather;

pub use run::{Endured, Most, Plan, endure, table};
pub use weather::Weather;
