//! Which format a path holds.

use std::path::Path;

use crate::npy::NpyBtf;
use crate::{Btf, Result};

pub(super) fn open(path: &Path) -> Result<Btf> {
    let npy = NpyBtf::open(path)?;
    let (sampling, size) = (npy.sampling().clone(), (npy.width(), npy.height()));
    Btf::new(path, sampling, size, Box::new(npy))
}
