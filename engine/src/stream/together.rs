//! Which requests go to a tile server together: the same for the client and for the model of a line to it.

use super::Request;

/// Bytes in front of each record of a batch.
pub(super) const FRAME_BYTES: usize = 16;
/// Most records of one batch; servers take 256.
pub(super) const MAX_RECORDS: usize = 64;
/// Connections to one tile server. While all are busy, records wait, and more of them go out together: fewer connections make
/// fewer heads, but each is idle for a round trip between two answers.
pub(super) const CONNECTIONS: usize = 16;

/// A request that waits for a connection.
pub(super) trait Waiting {
    fn request(&self) -> &Request;
    /// It is to pass caches on the way, and shares no answer with others.
    fn is_alone(&self) -> bool;
}

/// Takes what goes out next, in one exchange: an index, because all else of its archive waits for it; else the first record
/// and those behind it of the same archive, at most as many as `most` says of that archive.
pub(super) fn take_next<W: Waiting>(waiting: &mut Vec<W>, most: impl Fn(&str) -> usize) -> Vec<W> {
    let is_index = |waiting: &W| matches!(waiting.request(), Request::Index { .. });
    let first = waiting.iter().position(is_index).unwrap_or(0);
    let Some(found) = waiting.get(first) else {
        return Vec::new();
    };
    if is_index(found) || found.is_alone() {
        return vec![waiting.remove(first)];
    }
    let archive = found.request().archive().clone();
    let (most, mut taken) = (most(&archive).max(1), 0);
    let together = waiting.extract_if(.., |waiting| {
        let joins = taken < most && !waiting.is_alone() && *waiting.request().archive() == archive;
        taken += usize::from(joins);
        joins
    });
    together.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct One(Request, bool);

    impl Waiting for One {
        fn request(&self) -> &Request {
            &self.0
        }
        fn is_alone(&self) -> bool {
            self.1
        }
    }

    #[test]
    fn an_index_first_then_records_of_one_archive() {
        let column = |archive: &str, group| Request::Column {
            archive: archive.into(),
            group,
        };
        let mut waiting: Vec<One> = [
            (column("a", 0), false),
            (column("b", 0), false),
            (column("a", 1), true),
            (column("a", 2), false),
            (Request::Index { archive: "c".into() }, false),
            (column("a", 3), false),
        ]
        .map(|(request, alone)| One(request, alone))
        .into();
        let mut exchanges = Vec::new();
        while !waiting.is_empty() {
            let taken = take_next(&mut waiting, |archive| if archive == "a" { 2 } else { 0 });
            exchanges.push(taken.iter().map(|one| one.0.to_string()).collect::<Vec<_>>());
        }
        let column = |archive: &str, group| column(archive, group).to_string();
        let expected = [
            vec![Request::Index { archive: "c".into() }.to_string()],
            vec![column("a", 0), column("a", 2)],
            vec![column("b", 0)],
            vec![column("a", 1)],
            vec![column("a", 3)],
        ];
        assert_eq!(exchanges, expected);
    }
}
