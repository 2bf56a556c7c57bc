//! What a long run is doing, for a progress bar.

/// A stage of preprocessing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// The first pass: random sums of rows; units are rows of the matrix.
    Sketch,
    /// The numbered power iteration: one pass over the BTF; units are rows of the matrix.
    PowerIteration(u32),
    /// The pass that projects the BTF on the subspace found; units are rows of the matrix.
    Projection,
    /// The pass that measures what the factors leave out, where that is too little to be computed from the
    /// norms; units are rows of the matrix.
    Residual,
    /// Coding of pages and columns; units are component groups.
    Encoding,
    /// Decoding of an archive for export; units are component groups.
    Decoding,
}

impl std::fmt::Display for Phase {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Phase::Sketch => write!(f, "sketch"),
            Phase::PowerIteration(number) => write!(f, "power iteration {number}"),
            Phase::Projection => write!(f, "projection"),
            Phase::Residual => write!(f, "residual"),
            Phase::Encoding => write!(f, "encoding"),
            Phase::Decoding => write!(f, "decoding"),
        }
    }
}

/// How far a stage is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The stage.
    pub phase: Phase,
    /// Units done.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}

/// Is told about progress, from any thread; `&|_| ()` for none.
pub type ProgressFn<'a> = &'a (dyn Fn(Progress) + Sync);
