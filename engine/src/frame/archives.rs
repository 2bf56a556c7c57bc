//! The archives of a scene: asking for their indices, and what comes of it.

use std::{collections::HashMap, sync::Arc, time::Duration};

use scenes::{Scene, Surface};
use tileset::archive::Index;

use super::{problems::Problems, workers::Workers};
use crate::{
    Error, Result,
    gpu::materials::Btf,
    stream::{Answer, Request, Ticket, TileSource},
};

/// How often an index is asked for before its material is given up.
const ATTEMPTS: u32 = 3;

enum State {
    /// To be asked for, or in flight.
    Waiting { attempts: u32, ticket: Option<Ticket> },
    /// Here, and being read.
    Read { attempts: u32 },
    /// The engine's BTF with this number.
    Known(usize),
    /// Its materials stay as they are without an archive.
    Failed(Failure),
}

/// Why an archive was given up.
struct Failure {
    /// The engine's memory is too small for it.
    budget: bool,
    detail: String,
}

/// How far an archive's index is.
pub(super) enum Progress<'a> {
    /// Asked for, or being read.
    Pending,
    Known,
    /// Why it was given up.
    Failed(&'a str),
}

/// The archives of a scene, each once, in the order of its materials.
pub(super) struct Archives {
    names: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, usize>,
    /// Bytes that crossed the wire for each.
    wire_bytes: Vec<u64>,
    states: Vec<State>,
    /// The BTF that each is shown as: while a new version is on its way, the one before.
    shown: Vec<Option<usize>>,
    /// For each material of the scene its archive.
    of_material: Vec<Option<usize>>,
    /// Read indices and triangulate directions: archive and what came of it.
    workers: Workers<(usize, Result<Btf>)>,
}

impl Archives {
    /// # Errors
    /// [`Error::Scene`] if there are more than ids for them.
    pub(super) fn new(scene: &Scene, workers: Workers<(usize, Result<Btf>)>) -> Result<Self> {
        let mut ids: HashMap<&str, usize> = HashMap::new();
        let mut names: Vec<Arc<str>> = Vec::new();
        let of_material = scene.materials.iter().map(|material| match &material.surface {
            Surface::Btf { archive, .. } => Some(*ids.entry(archive).or_insert_with(|| {
                names.push(Arc::from(archive.as_str()));
                names.len() - 1
            })),
            Surface::Diffuse { .. } => None,
        });
        let of_material: Vec<_> = of_material.collect();
        if names.len() > usize::from(u16::MAX) {
            return Err(Error::Scene(format!(
                "{} archives, more than {}",
                names.len(),
                u16::MAX
            )));
        }
        let states = names
            .iter()
            .map(|_| State::Waiting {
                attempts: 0,
                ticket: None,
            })
            .collect();
        Ok(Self {
            shown: vec![None; names.len()],
            ids: names.iter().cloned().zip(0..).collect(),
            wire_bytes: vec![0; names.len()],
            names,
            states,
            of_material,
            workers,
        })
    }

    /// Asks for what is not in flight, as far as the source takes it.
    pub(super) fn submit(&mut self, source: &mut dyn TileSource) {
        for ((name, state), shown) in self.names.iter().zip(&mut self.states).zip(&self.shown) {
            if let State::Waiting {
                ticket: ticket @ None,
                ..
            } = state
            {
                let archive = name.clone();
                *ticket = match shown {
                    None => source.submit(Request::Index { archive }),
                    Some(_) => source.submit_anew(Request::Index { archive }),
                };
            }
        }
    }

    /// Asks for the index of the archive behind a BTF anew, if it is the version that is shown and not asked for yet. Returns
    /// whether it was so.
    pub(super) fn reload(&mut self, btf: usize) -> bool {
        let known = |state: &State| matches!(state, State::Known(known) if *known == btf);
        let Some(state) = self.states.iter_mut().find(|state| known(state)) else {
            return false;
        };
        *state = State::Waiting {
            attempts: 0,
            ticket: None,
        };
        true
    }

    /// The BTF that an archive is shown as.
    pub(super) fn shown(&self, archive: usize) -> Option<usize> {
        self.shown[archive]
    }

    /// The same, of any number.
    pub(super) fn shown_of(&self, archive: usize) -> Option<usize> {
        self.shown.get(archive).copied()?
    }

    /// The archive of a name.
    pub(super) fn index_of(&self, name: &str) -> Option<usize> {
        self.ids.get(name).copied()
    }

    /// Counts bytes that crossed the wire.
    pub(super) fn count_bytes(&mut self, name: &str, bytes: u64) {
        if let Some(&archive) = self.ids.get(name) {
            self.wire_bytes[archive] += bytes;
        }
    }

    /// Name of an archive, bytes that crossed the wire for it, and how far its index is.
    pub(super) fn progress(&self, archive: usize) -> (&Arc<str>, u64, Progress<'_>) {
        let progress = match &self.states[archive] {
            State::Waiting { .. } | State::Read { .. } => Progress::Pending,
            State::Known(_) => Progress::Known,
            State::Failed(failure) => Progress::Failed(&failure.detail),
        };
        (&self.names[archive], self.wire_bytes[archive], progress)
    }

    /// Takes an answer that is about an index.
    pub(super) fn receive(&mut self, answer: Answer, problems: &mut Problems) {
        let waiting = self.states.iter().position(
            |state| matches!(state, State::Waiting { ticket, .. } if *ticket == Some(answer.ticket)),
        );
        let Some(archive) = waiting else { return };
        let State::Waiting { attempts, .. } = self.states[archive] else {
            return;
        };
        let attempts = attempts + 1;
        match answer.bytes {
            Ok(bytes) => {
                let name = self.names[archive].clone();
                self.states[archive] = State::Read { attempts };
                self.workers.start(move || {
                    let btf = Index::parse(&bytes).map(|index| Btf::new(name, index));
                    (archive, btf.map_err(Error::from))
                });
            }
            Err(error) => self.retry(archive, attempts, &error, problems),
        }
    }

    fn retry(&mut self, archive: usize, attempts: u32, error: &Error, problems: &mut Problems) {
        if attempts >= ATTEMPTS || matches!(error, Error::NotFound(_)) {
            return self.give_up(archive, error, problems);
        }
        problems.add(format!("index of {}: {error}", self.names[archive]));
        self.states[archive] = State::Waiting {
            attempts,
            ticket: None,
        };
    }

    /// BTFs whose indices have been read since the last call, at most so many, with their archives.
    pub(super) fn take_read(&mut self, most: usize, problems: &mut Problems) -> Vec<(usize, Btf)> {
        let mut read = Vec::new();
        for (archive, result) in self.workers.finished(most) {
            let State::Read { attempts } = self.states[archive] else {
                continue;
            };
            match result {
                Ok(btf) => read.push((archive, btf)),
                Err(error) => self.retry(archive, attempts, &error, problems),
            }
        }
        read
    }

    /// Asks for those that were given up again.
    pub(super) fn ask_again(&mut self) {
        for state in &mut self.states {
            if let State::Failed(Failure { budget: false, .. }) = state {
                *state = State::Waiting {
                    attempts: 0,
                    ticket: None,
                };
            }
        }
    }

    /// Gives an archive up.
    pub(super) fn give_up(&mut self, archive: usize, error: &Error, problems: &mut Problems) {
        self.states[archive] = State::Failed(Failure {
            budget: matches!(error, Error::Budget(_)),
            detail: problems.add(format!("index of {}: {error}", self.names[archive])),
        });
    }

    /// From now on an archive is this BTF.
    pub(super) fn set_known(&mut self, archive: usize, btf: usize) {
        self.states[archive] = State::Known(btf);
        self.shown[archive] = Some(btf);
    }

    /// For each material of the scene its BTF, as far as it is known.
    pub(super) fn btf_of_material(&self) -> Vec<Option<usize>> {
        let btf = |archive: &Option<usize>| self.shown[(*archive)?];
        self.of_material.iter().map(btf).collect()
    }

    /// Archives of the scene.
    pub(super) fn count(&self) -> usize {
        self.names.len()
    }

    /// How many are known.
    pub(super) fn known(&self) -> usize {
        let known = |state: &&State| matches!(state, State::Known(_));
        self.states.iter().filter(known).count()
    }

    /// How many are known or given up.
    pub(super) fn decided(&self) -> usize {
        let decided = |state: &&State| matches!(state, State::Known(_) | State::Failed(_));
        self.states.iter().filter(decided).count()
    }

    /// Waits for an index that is being read. Returns whether there is one.
    pub(super) fn wait(&mut self, limit: Duration) -> bool {
        self.workers.wait(limit);
        self.workers.unfinished() > 0
    }

    /// Fails if an archive was given up.
    pub(super) fn check(&self) -> Result<()> {
        self.names
            .iter()
            .zip(&self.states)
            .try_for_each(|(name, state)| match state {
                State::Failed(Failure { budget: true, detail }) => Err(Error::Budget(detail.clone())),
                State::Failed(Failure { detail, .. }) => Err(Error::Source {
                    what: format!("archive {name}"),
                    detail: detail.clone(),
                }),
                _ => Ok(()),
            })
    }
}
