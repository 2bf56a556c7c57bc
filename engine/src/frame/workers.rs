//! Work that must not hold up a frame.
//!
//! Where there are threads, work runs on a few of its own: in the pool that a frame itself uses, a frame would have to
//! wait behind it. Without threads (browsers), and where every frame is to do the same with the same inputs, work
//! waits in a queue, and each frame does as much of it as it is told.

#[cfg(not(target_arch = "wasm32"))]
use std::sync::mpsc;
use std::{collections::VecDeque, time::Duration};

type Job<T> = Box<dyn FnOnce() -> T + Send>;

/// Work under way, and its results.
pub(super) struct Workers<T> {
    /// Given out and not yet taken back as results.
    unfinished: usize,
    place: Place<T>,
}

enum Place<T> {
    Queue(VecDeque<Job<T>>),
    #[cfg(not(target_arch = "wasm32"))]
    Threads {
        pool: &'static rayon::ThreadPool,
        sender: mpsc::Sender<T>,
        receiver: mpsc::Receiver<T>,
        /// Taken out of the channel by somebody who waited for it.
        ready: Option<T>,
    },
}

impl<T: Send + 'static> Workers<T> {
    /// In the frame's own time, in the order in which it was given: results depend on nothing else.
    pub(super) fn in_frames() -> Self {
        Self {
            unfinished: 0,
            place: Place::Queue(VecDeque::new()),
        }
    }

    /// Beside the frames, where that is possible.
    pub(super) fn beside_frames() -> Self {
        #[cfg(not(target_arch = "wasm32"))]
        if let Some(pool) = threads() {
            let (sender, receiver) = mpsc::channel();
            return Self {
                unfinished: 0,
                place: Place::Threads {
                    pool,
                    sender,
                    receiver,
                    ready: None,
                },
            };
        }
        Self::in_frames()
    }

    /// Results that have not been taken yet, of work done or not.
    pub(super) fn unfinished(&self) -> usize {
        self.unfinished
    }

    /// Gives work out. Whoever does so bounds how much is [unfinished](Self::unfinished).
    pub(super) fn start(&mut self, job: impl FnOnce() -> T + Send + 'static) {
        self.unfinished += 1;
        match &mut self.place {
            Place::Queue(queue) => queue.push_back(Box::new(job)),
            #[cfg(not(target_arch = "wasm32"))]
            Place::Threads { pool, sender, .. } => {
                let sender = sender.clone();
                // Nobody listens any more when the engine is gone.
                pool.spawn_fifo(move || drop(sender.send(job())));
            }
        }
    }

    /// Takes up to `most` results, without waiting for what others work on.
    pub(super) fn finished(&mut self, most: usize) -> Vec<T> {
        let results: Vec<T> = match &mut self.place {
            Place::Queue(queue) => run(queue.drain(..most.min(queue.len())).collect()),
            #[cfg(not(target_arch = "wasm32"))]
            Place::Threads { receiver, ready, .. } => {
                let results = ready.take().into_iter().chain(receiver.try_iter());
                results.take(most).collect()
            }
        };
        self.unfinished -= results.len();
        results
    }

    /// Waits until a result may be there, at most `limit`.
    #[cfg(not(target_arch = "wasm32"))]
    pub(super) fn wait(&mut self, limit: Duration) {
        if let Place::Threads { receiver, ready, .. } = &mut self.place
            && self.unfinished > 0
            && ready.is_none()
        {
            *ready = receiver.recv_timeout(limit).ok();
        }
    }

    /// Nobody else works: there is nothing to wait for.
    #[cfg(target_arch = "wasm32")]
    pub(super) fn wait(&mut self, _limit: Duration) {}
}

/// All at once; the results are in the order of the jobs.
#[cfg(not(target_arch = "wasm32"))]
fn run<T: Send>(jobs: Vec<Job<T>>) -> Vec<T> {
    use rayon::prelude::*;
    jobs.into_par_iter().map(|job| job()).collect()
}

#[cfg(target_arch = "wasm32")]
fn run<T: Send>(jobs: Vec<Job<T>>) -> Vec<T> {
    jobs.into_iter().map(|job| job()).collect()
}

/// Threads for the work of all engines: one processor is left to those who draw.
#[cfg(not(target_arch = "wasm32"))]
fn threads() -> Option<&'static rayon::ThreadPool> {
    /// Decoding keeps up with any wire long before.
    const MOST: usize = 8;
    static POOL: std::sync::LazyLock<Option<rayon::ThreadPool>> = std::sync::LazyLock::new(|| {
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        rayon::ThreadPoolBuilder::new()
            .num_threads(processors.saturating_sub(1).clamp(1, MOST))
            .thread_name(|at| format!("eigentile decoder {at}"))
            .build()
            .ok()
    });
    POOL.as_ref()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn queued_work_is_done_in_order_and_no_more_than_told() {
        let mut workers = Workers::in_frames();
        for n in 0..10 {
            workers.start(move || n);
        }
        workers.wait(Duration::from_secs(10));
        assert_eq!(workers.finished(4), [0, 1, 2, 3]);
        assert_eq!(workers.unfinished(), 6);
        assert_eq!(workers.finished(100), [4, 5, 6, 7, 8, 9]);
        assert_eq!((workers.finished(1), workers.unfinished()), (vec![], 0));
    }

    #[test]
    fn work_beside_frames_holds_nobody_up_and_is_done_in_the_end() {
        let mut workers = Workers::beside_frames();
        let (release, gate) = mpsc::channel::<()>();
        workers.start(move || {
            // Until the test lets it go.
            let _ = gate.recv();
            0
        });
        assert_eq!((workers.finished(10), workers.unfinished()), (vec![], 1));
        drop(release);
        (1..50).for_each(|n| workers.start(move || n));
        let mut results = BTreeSet::new();
        while workers.unfinished() > 0 {
            workers.wait(Duration::from_secs(10));
            let some = workers.finished(7);
            assert!(!some.is_empty() && some.len() <= 7);
            results.extend(some);
        }
        assert_eq!(results, (0..50).collect());
    }
}
