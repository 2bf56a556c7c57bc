//! The archives of a scene: asking for their indices, and what comes of it.

use std::{collections::HashMap, sync::Arc};

use scenes::{Scene, Surface};
use tileset::archive::Index;

use super::problems::Problems;
use crate::{
    Error, Result,
    gpu::materials::Btf,
    stream::{Answer, Request, Ticket, TileSource},
};

/// How often an index is asked for before its material is given up.
const ATTEMPTS: u32 = 3;

enum State {
    /// To be asked for, or in flight.
    Waiting {
        attempts: u32,
        ticket: Option<Ticket>,
    },
    Known(Box<Btf>),
    /// Its materials stay as they are without an archive.
    Failed(String),
}

/// The archives of a scene, each once, in the order of its materials.
pub(super) struct Archives {
    names: Vec<Arc<str>>,
    states: Vec<State>,
    /// For each material of the scene its archive.
    of_material: Vec<Option<usize>>,
}

impl Archives {
    /// # Errors
    /// [`Error::Scene`] if there are more than ids for them.
    pub(super) fn new(scene: &Scene) -> Result<Self> {
        let mut ids: HashMap<&str, usize> = HashMap::new();
        let mut names = Vec::new();
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
            names,
            states,
            of_material,
        })
    }

    /// Asks for what is not in flight, as far as the source takes it.
    pub(super) fn submit(&mut self, source: &mut dyn TileSource) {
        for (name, state) in self.names.iter().zip(&mut self.states) {
            if let State::Waiting {
                ticket: ticket @ None,
                ..
            } = state
            {
                *ticket = source.submit(Request::Index {
                    archive: name.clone(),
                });
            }
        }
    }

    /// Takes an answer that is about an index.
    pub(super) fn receive(&mut self, answer: Answer, problems: &mut Problems) {
        let waiting = self
            .states
            .iter_mut()
            .zip(&self.names)
            .find_map(|(state, name)| match state {
                State::Waiting { attempts, ticket } if *ticket == Some(answer.ticket) => {
                    Some((*attempts + 1, state, name))
                }
                _ => None,
            });
        let Some((attempts, state, name)) = waiting else {
            return;
        };
        *state = match answer.bytes.and_then(|bytes| Ok(Index::parse(&bytes)?)) {
            Ok(index) => State::Known(Box::new(Btf::new(name.clone(), index))),
            Err(error) => {
                let text = problems.add(format!("index of {name}: {error}"));
                if attempts >= ATTEMPTS || matches!(error, Error::NotFound(_)) {
                    State::Failed(text)
                } else {
                    State::Waiting {
                        attempts,
                        ticket: None,
                    }
                }
            }
        };
    }

    /// Once all are known or given up: the BTFs, and for each material of the scene its BTF.
    pub(super) fn finish(&self) -> Option<(Vec<Btf>, Vec<Option<usize>>)> {
        if self
            .states
            .iter()
            .any(|state| matches!(state, State::Waiting { .. }))
        {
            return None;
        }
        let mut btfs = Vec::new();
        let btf_of_archive: Vec<_> = self
            .states
            .iter()
            .map(|state| match state {
                State::Known(btf) => {
                    btfs.push(Btf::clone(btf));
                    Some(btfs.len() - 1)
                }
                _ => None,
            })
            .collect();
        let of_material = self
            .of_material
            .iter()
            .map(|archive| btf_of_archive[(*archive)?])
            .collect();
        Some((btfs, of_material))
    }

    /// Fails if an archive was given up.
    pub(super) fn check(&self) -> Result<()> {
        self.names
            .iter()
            .zip(&self.states)
            .try_for_each(|(name, state)| match state {
                State::Failed(detail) => Err(Error::Source {
                    what: format!("archive {name}"),
                    detail: detail.clone(),
                }),
                _ => Ok(()),
            })
    }
}
