//! Bytes of a cache: what it may take, and what it takes.

/// A budget, and what is used of it. Who keeps something asks [`Room::admits`], counts it, and lets others go while the room
/// [is over](Room::is_over) its budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    budget_bytes: u64,
    used_bytes: u64,
}

impl Room {
    pub(super) fn new(budget_bytes: u64) -> Self {
        Self {
            budget_bytes,
            used_bytes: 0,
        }
    }

    /// The same budget, of which somebody else has counted what is used: the disk cache, which browsers do not have.
    #[cfg(not(target_arch = "wasm32"))]
    pub(super) fn with_used(self, used_bytes: u64) -> Self {
        Self { used_bytes, ..self }
    }

    #[cfg(not(target_arch = "wasm32"))]
    pub(super) fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    pub(super) fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// Whether something of this cost has room when all else is gone.
    pub(super) fn admits(&self, cost: u64) -> bool {
        cost <= self.budget_bytes
    }

    pub(super) fn take(&mut self, cost: u64) {
        self.replace(0, cost);
    }

    pub(super) fn give_back(&mut self, cost: u64) {
        self.replace(cost, 0);
    }

    /// Something new comes in place of something old.
    pub(super) fn replace(&mut self, old: u64, new: u64) {
        self.used_bytes = self.used_bytes.saturating_sub(old).saturating_add(new);
    }

    /// Whether something has to go.
    pub(super) fn is_over(&self) -> bool {
        self.used_bytes > self.budget_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_and_goes_is_counted() {
        let mut room = Room::new(10);
        assert!(room.admits(10) && !room.admits(11));
        room.take(6);
        room.take(4);
        assert!(!room.is_over());
        room.replace(4, 5);
        assert!(room.is_over() && room.used_bytes() == 11);
        room.give_back(6);
        assert_eq!((room.used_bytes(), room.is_over()), (5, false));
        // Counted by others, who may err: never below nothing, never beyond all.
        room.give_back(u64::MAX);
        assert_eq!(room.used_bytes(), 0);
        room = room.with_used(u64::MAX);
        room.take(1);
        assert!(room.is_over());
    }
}
