//! UBO `.btf` files, written byte by byte: every signature, scalar, order of storage and colour model against
//! numbers computed in f64; every contradiction named; no bytes that panic.

mod bdi;
mod common;
mod damage;
mod dfmf;
mod fmf;
mod pvf;
mod spectral;
