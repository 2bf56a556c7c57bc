//! How many files this process may have open, connections included.

/// Raises the limit of open files to what the system lets this process have, and says how many that is; `None` if there is no limit, or
/// none that is known. For programs, before [`fn@crate::run`]: shells often begin with 1024.
pub fn raise_open_files() -> Option<u64> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, getrlimit, setrlimit};
        let mut limit = getrlimit(Resource::Nofile);
        if limit.current != limit.maximum {
            limit.current = limit.maximum;
            // Where it is refused the old limit stands, which is what is returned.
            let _ = setrlimit(Resource::Nofile, limit);
        }
    }
    allowed()
}

/// The limit as it is.
pub(crate) fn allowed() -> Option<u64> {
    #[cfg(unix)]
    return rustix::process::getrlimit(rustix::process::Resource::Nofile).current;
    #[cfg(not(unix))]
    return None;
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_raised_to_the_hard_one() {
        let hard = rustix::process::getrlimit(rustix::process::Resource::Nofile).maximum;
        assert_eq!(raise_open_files(), hard);
        assert_eq!(allowed(), hard);
    }
}
