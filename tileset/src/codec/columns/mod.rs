//! Eigen-ABRDFs with loss, in the one unit of error: a hundredth to a ninth of the bytes of
//! [`super::encode_column`].
//!
//! 1. An orthonormal transform along views, lights and colours makes most coefficients nothing. The bases of
//!    views and lights follow from the directions (`basis`), that of colours is stored.
//! 2. One uniform quantizer a component. [`column_step`] gives the step that is worth its bytes as much as the
//!    step of the pages; levels are chosen by rate and distortion.
//! 3. Levels are coded by rANS with static models, chosen by the magnitude that the archive's profile and the
//!    neighbours let expect (`context`).
//!
//! - [`encode_columns`]: all columns of an archive, to [`ColumnTables`] and one record a group.
//! - [`ColumnTables::decode`]: one group. Groups do not depend on each other.
//!
//! A record is the level of each of the four components (`i8`, mean magnitude in quarter octaves, -128 for a
//! component that is zero) and the bytes of the entropy coder. Results have the same bits on every platform: bases
//! are computed by f64, columns by f32 operations of IEEE 754 in a fixed order, never fused.
//!
//! It deliberately does not predict one group from another: each can be had alone.

mod basis;
mod context;
mod eigen;
mod encode;
mod symbols;
mod tables;
mod transform;

pub use encode::{EncodedColumns, column_step, encode_columns};
pub use tables::{ColumnTables, MAX_COLUMN_TABLE_BYTES};
