//! Files of the disk cache: found by what they hold, added under a lock, bounded.
//!
//! Every file is written under one other name and renamed, by whoever holds the lock. A process that ends at any moment
//! leaves at most that one file, which the next writer overwrites, and the system lets go of its lock. After a crash of the
//! system a file may have its name and not its content: what is read is checked by the reader. Nobody ever waits for
//! the lock for long: what cannot be added is not added.

use std::{
    fs::{self, File, FileTimes, OpenOptions, TryLockError},
    io::{self, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    time::{Duration, Instant, SystemTime},
};

use super::super::room::Room;

/// Space is given out by file systems in blocks of this size, as a rule, so files count as that many.
const BLOCK_BYTES: u64 = 4096;
/// Longest wait for another process that is adding something.
const LOCK_PATIENCE: Duration = Duration::from_millis(50);
/// Recency is a file's time, and written only when it is off by this much.
const RECENT: Duration = Duration::from_secs(60);
/// What is left after files were thrown away: listing all files is too much work to do for every one that is added.
const KEPT_SHARE: f64 = 7.0 / 8.0;

/// A folder of files of at most so many bytes.
pub(super) struct Store {
    folder: PathBuf,
    /// What all its files may take; what they take stands in the file of the lock.
    room: Room,
}

/// What a file takes.
fn cost(length: u64) -> u64 {
    length.div_ceil(BLOCK_BYTES).max(1) * BLOCK_BYTES
}

impl Store {
    /// Makes the folder where it is missing, and throws away what is beyond the budget.
    pub(super) fn open(folder: &Path, budget_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let store = Self {
            folder: folder.to_owned(),
            room: Room::new(budget_bytes),
        };
        if let Some(mut lock) = store.lock()? {
            let used = store.evict(budget_bytes)?;
            write_used(&mut lock, used)?;
        }
        Ok(store)
    }

    /// Reads a file of at most `limit` bytes and marks it as used. `None` if there is none, or it is longer.
    pub(super) fn read(&self, name: &str, limit: u64) -> Option<Vec<u8>> {
        let path = self.folder.join(name);
        let file = File::open(&path).ok()?;
        let metadata = file.metadata().ok()?;
        if metadata.len() > limit {
            return None;
        }
        let mut bytes = Vec::with_capacity(metadata.len() as usize);
        (&file).take(limit).read_to_end(&mut bytes).ok()?;
        let now = SystemTime::now();
        let recent = metadata
            .modified()
            .is_ok_and(|used| now.duration_since(used).is_ok_and(|age| age < RECENT));
        if !recent && let Ok(file) = OpenOptions::new().append(true).open(&path) {
            // A folder that cannot be written to can still be read.
            let _ = file.set_times(FileTimes::new().set_modified(now));
        }
        Some(bytes)
    }

    /// Drops a file that does not hold.
    pub(super) fn remove(&self, name: &str) {
        // What it took is found at the next listing.
        let _ = fs::remove_file(self.folder.join(name));
    }

    /// Adds a file, unless it is larger than the budget or somebody else is at it. Returns whether it is there.
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> io::Result<bool> {
        let cost = cost(bytes.len() as u64);
        if !self.room.admits(cost) {
            return Ok(false);
        }
        let path = self.folder.join(name);
        let Some(mut lock) = self.lock()? else {
            return Ok(false);
        };
        let budget = self.room.budget_bytes();
        let before = || fs::metadata(&path).map_or(0, |old| self::cost(old.len()));
        let used = match read_used(&mut lock)? {
            Some(used) => used,
            None => self.evict(budget)?,
        };
        let mut room = self.room.with_used(used);
        room.replace(before(), cost);
        if room.is_over() {
            let kept = (budget as f64 * KEPT_SHARE) as u64;
            room = self.room.with_used(self.evict(kept.min(budget - cost))?);
            room.replace(before(), cost);
        }
        // Counted before it is written: a process that ends in between has counted too much, not too little.
        write_used(&mut lock, room.used_bytes())?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        let unfinished = self.folder.join("unfinished");
        let written = File::create(&unfinished)
            .and_then(|mut file| file.write_all(bytes))
            .and_then(|()| fs::rename(&unfinished, &path));
        if let Err(error) = written {
            let _ = fs::remove_file(&unfinished);
            return Err(error);
        }
        Ok(true)
    }

    /// The lock, and in its file the bytes that all others take. `None` if another process keeps it for too long.
    fn lock(&self) -> io::Result<Option<File>> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let file = options.open(self.folder.join("lock"))?;
        let begin = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(Some(file)),
                Err(TryLockError::Error(error)) => return Err(error),
                Err(TryLockError::WouldBlock) if begin.elapsed() >= LOCK_PATIENCE => return Ok(None),
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    /// Throws away what was used least recently until at most `budget` bytes are left; returns what is left. Only under the
    /// lock: then a file that is not finished is a dead process's.
    fn evict(&self, budget: u64) -> io::Result<u64> {
        let _ = fs::remove_file(self.folder.join("unfinished"));
        let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            if !entry.file_type()?.is_dir() {
                continue;
            }
            for file in fs::read_dir(entry.path())? {
                let file = file?;
                // Gone since it was listed, by its reader.
                let Ok(metadata) = file.metadata() else { continue };
                if metadata.is_file() {
                    let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                    files.push((used, cost(metadata.len()), file.path()));
                }
            }
        }
        let mut left: u64 = files.iter().map(|(_, cost, _)| cost).sum();
        if left > budget {
            files.sort_unstable();
            for (_, cost, path) in &files {
                if left <= budget {
                    break;
                }
                match fs::remove_file(path) {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => {}
                    _ => left -= cost,
                }
            }
        }
        Ok(left)
    }

    /// Bytes that all files take, counted.
    #[cfg(test)]
    pub(super) fn used_bytes(&self) -> u64 {
        self.evict(u64::MAX).unwrap()
    }
}

fn read_used(lock: &mut File) -> io::Result<Option<u64>> {
    let mut bytes = [0; 8];
    lock.seek(SeekFrom::Start(0))?;
    match lock.read_exact(&mut bytes) {
        Ok(()) => Ok(Some(u64::from_le_bytes(bytes))),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

fn write_used(lock: &mut File, used: u64) -> io::Result<()> {
    lock.seek(SeekFrom::Start(0))?;
    lock.write_all(&used.to_le_bytes())
}
