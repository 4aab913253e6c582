//! Cores on which the two sides of an exchange run.

use rustix::thread::{CpuSet, sched_setaffinity};

/// Two cores, or one for both sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place<'a> {
    all: &'a [usize],
    plant: usize,
    controller: usize,
}

impl<'a> Place<'a> {
    /// Returns one core for each side, if there are two.
    pub(crate) fn apart(all: &'a [usize]) -> Option<Self> {
        match *all {
            [plant, controller, ..] => Some(Self {
                all,
                plant,
                controller,
            }),
            _ => None,
        }
    }

    /// Returns the first core for both sides.
    ///
    /// # Panics
    /// If there is none.
    pub(crate) const fn together(all: &'a [usize]) -> Self {
        Self {
            all,
            plant: all[0],
            controller: all[0],
        }
    }

    /// Returns the core of the plant.
    pub(super) const fn plant(self) -> usize {
        self.plant
    }

    /// Returns the core of the controller.
    pub(super) const fn controller(self) -> usize {
        self.controller
    }

    /// Returns true if there is only one core for both sides.
    pub(crate) const fn is_shared(self) -> bool {
        self.plant == self.controller
    }

    /// Lets the calling thread, so far restricted to one core, run on all cores again.
    pub(crate) fn leave(self) {
        let mut all = CpuSet::new();
        self.all.iter().for_each(|&core| all.set(core));
        sched_setaffinity(None, &all).expect("cores that this process may run on");
    }
}

impl std::fmt::Display for Place<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_shared() {
            write!(f, "both sides on core {}", self.plant)
        } else {
            write!(f, "cores {} and {}", self.plant, self.controller)
        }
    }
}
