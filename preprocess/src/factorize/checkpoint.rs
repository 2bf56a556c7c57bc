//! What an interrupted factorization continues from.
//!
//! A folder OUTPUT.partial beside the output holds one file `state` with all blocks of the subspace and the sums of the
//! pass that is under way. It is written under another name and renamed, now and then; so what is there is whole at
//! any moment, and a checksum guards against a machine that lost power. It begins with the identity of the run (input,
//! its size and time, settings, blocks): whatever else continues from nothing.
//!
//! Layout, little-endian: magic, length and text of the identity, xxh3 of all that follows; then numbers u64: step,
//! next row, passes, number of blocks, rows totalled, exponent plus
//! 1024; then matrices (two u64 and f32 columns): q and y of each block, q, y
//! and z of the pass; then totals, f64.

use std::fs::{self, File};
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use faer::{Mat, MatRef};
use xxhash_rust::xxh3::Xxh3;

use super::krylov::{Pass, Projected, State, Step};
use super::plan::Plan;
use super::stream::Totals;
use super::{Settings, once};
use crate::{Btf, Error, Result};

const MAGIC: &[u8; 16] = b"eigentile part 2";
/// Makes exponents positive numbers.
const EXPONENT_BIAS: i32 = 1024;
/// Files of a folder of images that are looked at for its identity.
const MAX_FILES: usize = 1 << 20;

/// Where and how often the state of a factorization is saved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    folder: PathBuf,
    interval: Duration,
}

impl Checkpoint {
    /// The time between two saves of [`Checkpoint::beside`]: a second of work in twenty is what an interruption may cost
    /// at most, and saving takes a hundredth of that.
    pub const INTERVAL: Duration = Duration::from_secs(20);

    /// In the folder NAME.partial beside `output`, NAME, every `interval`.
    pub fn beside(output: &Path, interval: Duration) -> Self {
        let mut name = output.file_name().unwrap_or_default().to_owned();
        name.push(".partial");
        Self {
            folder: output.with_file_name(name),
            interval,
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Deletes the state, and the folder if nothing else is in it.
    pub fn delete(&self) {
        for name in ["state", "state.new"] {
            let _ = fs::remove_file(self.folder.join(name));
        }
        let _ = fs::remove_dir(&self.folder);
    }
}

/// A checkpoint in use.
pub(super) struct Saver<'a> {
    checkpoint: &'a Checkpoint,
    identity: Vec<u8>,
    last: Instant,
    /// Seconds that saving took.
    pub(super) seconds: f64,
}

impl<'a> Saver<'a> {
    pub(super) fn new(checkpoint: &'a Checkpoint, btf: &Btf, settings: &Settings, plan: &Plan) -> Self {
        // Memory does not matter but for the blocks.
        let settings = Settings {
            memory_bytes: 0,
            ..*settings
        };
        let files = fingerprint(btf);
        let sizes = (btf.rows(), btf.columns(), btf.stored_bytes());
        let program = (env!("CARGO_PKG_VERSION"), std::env::consts::ARCH);
        let identity = format!(
            "{:?} {} {sizes:?} {:?} {files:x} {settings:?} {plan:?} {program:?}",
            std::path::absolute(btf.path()).unwrap_or_else(|_| btf.path().to_owned()),
            btf.format(),
            btf.sampling(),
        );
        Self {
            checkpoint,
            identity: identity.into_bytes(),
            last: Instant::now(),
            seconds: 0.0,
        }
    }

    /// Saves the state if the last time is long enough ago.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn save_when_due(&mut self, state: &State) -> Result<()> {
        if self.last.elapsed() < self.checkpoint.interval {
            return Ok(());
        }
        let began = Instant::now();
        let folder = &self.checkpoint.folder;
        fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
        let (new, path) = (folder.join("state.new"), folder.join("state"));
        write(&new, &self.identity, state).map_err(Error::io(&new, "write"))?;
        fs::rename(&new, &path).map_err(Error::io(&path, "complete"))?;
        self.last = Instant::now();
        self.seconds += began.elapsed().as_secs_f64();
        Ok(())
    }

    /// The state of an earlier run of the same work. One of other work, or a damaged one, is deleted.
    pub(super) fn load(&self, btf: &Btf, plan: &Plan) -> Option<State> {
        let path = self.checkpoint.folder.join("state");
        let state = read(&path, &self.identity, btf.rows(), btf.columns(), plan);
        if state.is_none() {
            self.checkpoint.delete();
        }
        state
    }
}

/// Sizes and times of the file, or of all files of the folder; and the first image, which shows how files are understood.
fn fingerprint(btf: &Btf) -> u64 {
    let path = btf.path();
    let mut hash = Xxh3::new();
    let mut buffer = Vec::new();
    if let Ok(samples) = btf.samples(0..1, &mut buffer) {
        (0..samples.len()).for_each(|index| hash.update(&samples.get(index).to_le_bytes()));
    }
    let mut folders = vec![path.to_owned(), path.with_extension("json")];
    let mut left = MAX_FILES;
    while let Some(path) = folders.pop() {
        let Ok(about) = fs::metadata(&path) else { continue };
        let modified = about
            .modified()
            .ok()
            .and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
        hash.update(path.as_os_str().as_encoded_bytes());
        hash.update(&about.len().to_le_bytes());
        hash.update(&modified.unwrap_or_default().as_nanos().to_le_bytes());
        if about.is_dir()
            && let Ok(entries) = fs::read_dir(&path)
        {
            let mut paths: Vec<PathBuf> = entries.flatten().take(left).map(|entry| entry.path()).collect();
            paths.sort();
            left -= paths.len();
            folders.extend(paths);
        }
    }
    hash.digest()
}

/// Writes what is hashed.
struct Hashed<W> {
    to: W,
    hash: Xxh3,
}

impl<W: Write> Hashed<W> {
    fn put(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.hash.update(bytes);
        self.to.write_all(bytes)
    }

    fn numbers(&mut self, numbers: &[u64]) -> std::io::Result<()> {
        numbers
            .iter()
            .try_for_each(|number| self.put(&number.to_le_bytes()))
    }

    fn matrix(&mut self, matrix: MatRef<'_, f32>) -> std::io::Result<()> {
        self.numbers(&[matrix.nrows() as u64, matrix.ncols() as u64])?;
        for column in matrix.col_iter() {
            match column.try_as_col_major() {
                Some(column) => self.put(bytemuck::cast_slice(column.as_slice()))?,
                None => column
                    .iter()
                    .try_for_each(|value| self.put(&value.to_le_bytes()))?,
            }
        }
        Ok(())
    }
}

fn write(path: &Path, identity: &[u8], state: &State) -> std::io::Result<()> {
    let mut out = Hashed {
        to: BufWriter::with_capacity(1 << 20, File::create(path)?),
        hash: Xxh3::new(),
    };
    out.put(MAGIC)?;
    out.numbers(&[identity.len() as u64])?;
    out.put(identity)?;
    let Pass {
        step,
        next_row,
        q,
        y,
        z,
    } = &state.pass;
    let numbers = [
        *step as usize,
        *next_row,
        state.passes as usize,
        state.blocks.len(),
        state.totals.energies.len(),
        (state.exponent + EXPONENT_BIAS) as usize,
    ];
    out.numbers(&numbers.map(|number| number as u64))?;
    for block in &state.blocks {
        out.matrix(block.q.as_ref())?;
        out.matrix(block.y.as_ref())?;
    }
    for matrix in [q, y, z] {
        out.matrix(matrix.as_ref())?;
    }
    out.put(bytemuck::cast_slice(&state.totals.energies))?;
    out.put(bytemuck::cast_slice(&state.totals.sums))?;
    let digest = out.hash.digest();
    out.to.write_all(&digest.to_le_bytes())?;
    out.to.flush()
}

/// Reads what is hashed; `None` for anything that does not fit.
struct Checked {
    from: std::io::BufReader<File>,
    hash: Xxh3,
}

impl Checked {
    fn get(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.from.read_exact(bytes).ok()?;
        self.hash.update(bytes);
        Some(())
    }

    fn number(&mut self, most: usize) -> Option<usize> {
        let mut bytes = [0; 8];
        self.get(&mut bytes)?;
        usize::try_from(u64::from_le_bytes(bytes))
            .ok()
            .filter(|number| *number <= most)
    }

    fn matrix(&mut self, rows: usize, columns: usize) -> Option<Mat<f32>> {
        let (rows, columns) = (self.number(rows)?, self.number(columns)?);
        let mut matrix = Mat::<f32>::zeros(rows, columns);
        let mut values = vec![0f32; rows];
        for column in 0..columns {
            self.get(bytemuck::cast_slice_mut(&mut values))?;
            for (to, from) in matrix.as_mut().col_mut(column).iter_mut().zip(&values) {
                *to = *from;
            }
        }
        Some(matrix)
    }
}

fn read(path: &Path, identity: &[u8], rows: usize, columns: usize, plan: &Plan) -> Option<State> {
    let mut from = Checked {
        from: std::io::BufReader::with_capacity(1 << 20, File::open(path).ok()?),
        hash: Xxh3::new(),
    };
    let mut magic = [0; 16];
    from.get(&mut magic)?;
    let mut text = vec![0; from.number(identity.len())?];
    from.get(&mut text)?;
    if magic != *MAGIC || text != identity {
        return None;
    }
    let step = match from.number(3)? {
        0 => Step::Sketch,
        1 => Step::Both,
        2 => Step::Project,
        _ => Step::Once,
    };
    let next_row = from.number(rows)?;
    let passes = from.number(u32::MAX as usize)? as u32;
    let (count, totalled) = (from.number(plan.most)?, from.number(rows)?);
    let exponent = from.number(2 * EXPONENT_BIAS as usize)? as i32 - EXPONENT_BIAS;
    let width = plan.width;
    let blocks = (0..count).map(|_| {
        Some(Projected {
            q: from.matrix(width, columns)?,
            y: from.matrix(width, rows)?,
        })
    });
    let blocks = blocks.collect::<Option<Vec<_>>>()?;
    let tests = if step == Step::Once {
        once::tests(width)
    } else {
        width
    };
    let pass = Pass {
        step,
        next_row,
        q: from.matrix(tests, columns)?,
        y: from.matrix(tests, rows)?,
        z: from.matrix(columns, width)?,
    };
    let mut totals = Totals {
        energies: vec![0.0; totalled],
        sums: [0.0; 3],
    };
    from.get(bytemuck::cast_slice_mut(&mut totals.energies))?;
    from.get(bytemuck::cast_slice_mut(&mut totals.sums))?;
    let mut digest = [0; 8];
    from.from.read_exact(&mut digest).ok()?;
    let whole = u64::from_le_bytes(digest) == from.hash.digest() && from.from.read(&mut [0]).ok()? == 0;
    let state = State {
        blocks,
        pass,
        totals,
        passes,
        exponent,
    };
    (whole && fits(&state, rows, columns)).then_some(state)
}

/// Whether all sizes are those that a run of this program would have.
fn fits(state: &State, rows: usize, columns: usize) -> bool {
    let projected = |q: &Mat<f32>, y: &Mat<f32>| {
        q.nrows() > 0 && q.ncols() == columns && (y.nrows(), y.ncols()) == (q.nrows(), rows)
    };
    let Pass {
        step,
        next_row,
        q,
        y,
        z,
    } = &state.pass;
    let pass = match step {
        Step::Sketch => q.nrows() == 0 && z.nrows() == columns && z.ncols() > 0,
        Step::Once => projected(q, y) && z.nrows() == columns && q.nrows() == once::tests(z.ncols()),
        Step::Project => projected(q, y) && z.nrows() == 0,
        Step::Both => projected(q, y) && (z.nrows(), z.ncols()) == (columns, q.nrows()),
    };
    let totalled = if matches!(step, Step::Sketch | Step::Once) {
        *next_row
    } else {
        rows
    };
    pass && totalled == state.totals.energies.len()
        && state.blocks.iter().all(|block| projected(&block.q, &block.y))
}
