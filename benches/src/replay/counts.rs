//! What came of a trace.

use engine::frame::{Counters, FrameStats};
use engine::stream::{NetworkStats, Request};
use serde::{Deserialize, Serialize};

/// FNV-1a of 64 bits (Fowler, Noll and Vo): the start, and by what each step multiplies.
const START: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// What came of a trace; the same numbers in every replay by the same program on the same adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Frames, those after the last camera until all has settled included.
    pub frames: u64,
    /// Whether it has settled.
    pub settled: bool,
    /// Records that came: indices of archives, columns and pages.
    pub indices: u64,
    /// See above.
    pub columns: u64,
    /// See above.
    pub pages: u64,
    /// Bytes over the line, headers and what was lost or given up on the way included.
    pub line_bytes: u64,
    /// Bytes that had been sent for requests that were given up, and bytes that giving up saved.
    pub wasted_bytes: u64,
    /// See above.
    pub saved_bytes: u64,
    /// Bytes that were sent again.
    pub resent_bytes: u64,
    /// Pages and columns placed in free slots, and in the place of others.
    pub added: u64,
    /// See above.
    pub swapped: u64,
    /// Requests given up because the camera left them behind.
    pub cancelled: u64,
    /// Most bytes of records and decoded pages on the host, and bytes on the GPU.
    pub most_host_bytes: u64,
    /// See above.
    pub most_gpu_bytes: u64,
    /// Root mean square error of reflectance that is predicted: mean over the frames, and in the last.
    pub predicted_rms_mean: f64,
    /// See above.
    pub predicted_rms_last: f64,
    /// A hash of which record came in which frame, in order, with its bytes; in hexadecimal.
    pub order: String,
}

/// Counts while frames go by.
pub(super) struct Counting {
    counts: Counts,
    order: u64,
}

impl Counting {
    pub(super) fn new() -> Self {
        Self {
            counts: Counts::default(),
            order: START,
        }
    }

    fn hash(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.order = (self.order ^ u64::from(*byte)).wrapping_mul(PRIME);
        }
    }

    /// A record that came in the present frame, with its bytes over the line.
    pub(super) fn came(&mut self, request: &Request, bytes: u64) {
        match request {
            Request::Index { .. } => self.counts.indices += 1,
            Request::Column { .. } => self.counts.columns += 1,
            Request::Page { .. } => self.counts.pages += 1,
        }
        self.hash(&self.counts.frames.to_le_bytes());
        self.hash(request.to_string().as_bytes());
        self.hash(&bytes.to_le_bytes());
    }

    /// After a frame.
    pub(super) fn frame(&mut self, stats: &FrameStats) {
        let counts = &mut self.counts;
        counts.frames += 1;
        counts.settled = stats.settled;
        counts.added += u64::from(stats.added);
        counts.swapped += u64::from(stats.swapped);
        counts.most_host_bytes = counts.most_host_bytes.max(stats.host_bytes);
        counts.most_gpu_bytes = counts.most_gpu_bytes.max(stats.gpu_bytes);
        counts.predicted_rms_mean += stats.predicted_rms;
        counts.predicted_rms_last = stats.predicted_rms;
    }

    pub(super) fn end(self, network: NetworkStats, counters: Counters) -> Counts {
        let frames = self.counts.frames.max(1) as f64;
        Counts {
            line_bytes: network.delivered_bytes + network.wasted_bytes,
            wasted_bytes: network.wasted_bytes,
            saved_bytes: network.saved_bytes,
            resent_bytes: network.resent_bytes,
            cancelled: counters.requests_cancelled,
            predicted_rms_mean: self.counts.predicted_rms_mean / frames,
            order: format!("{:016x}", self.order),
            ..self.counts
        }
    }
}

impl Counts {
    /// What differs, for people: name, this, the other.
    ///
    /// # Errors
    /// None that is expected.
    pub fn differences(&self, other: &Self) -> crate::Result<Vec<String>> {
        let value = |counts: &Self| {
            serde_json::to_value(counts)
                .map_err(|error| crate::Error::Trace(format!("cannot be counted: {error}")))
        };
        let (ours, theirs) = (value(self)?, value(other)?);
        let ours = ours.as_object().into_iter().flatten();
        Ok(ours
            .filter(|(name, value)| theirs[name.as_str()] != **value)
            .map(|(name, value)| format!("{name} is {value}, was {}", theirs[name.as_str()]))
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(requests: &[(&str, u64)]) -> Counts {
        let mut counting = Counting::new();
        for (archive, bytes) in requests {
            let archive = (*archive).into();
            counting.came(&Request::Index { archive }, *bytes);
            counting.frame(&FrameStats::default());
        }
        counting.end(NetworkStats::default(), Counters::default())
    }

    #[test]
    fn order_bytes_and_frames_count() {
        let counts = counted(&[("a", 1), ("b", 2)]);
        assert_eq!((counts.indices, counts.frames), (2, 2));
        assert_eq!(counts, counted(&[("a", 1), ("b", 2)]));
        for other in [[("b", 2), ("a", 1)], [("a", 2), ("b", 1)]] {
            let other = counted(&other);
            let differences = counts.differences(&other).unwrap();
            assert!(
                differences.len() == 1 && differences[0].starts_with("order is"),
                "{differences:?}"
            );
        }
        assert_eq!(counts.differences(&counts).unwrap(), [""; 0]);
    }
}
