//! Entropy coder: interleaved range asymmetric numeral systems (rANS) with static models.
//!
//! Four states share one stream of 16-bit words, so a decoder has four independent chains of work. A caller
//! names the state, called lane, of each symbol; natural is one lane for each component of a group. Symbols
//! are decoded in the order in which they were pushed, each with any model that the decoder can know by then,
//! so contexts may depend on everything decoded before. Bits without a model take the same way through
//! [`Encoder::bits`]: there is no second stream and no length to store.
//!
//! Integers only, so the same bytes come and go on every platform. Damaged bytes give wrong symbols of the
//! model's alphabet, never a panic or a read out of bounds. [`Decoder::finish`] tells of some damage, but not
//! of all: a changed sign, say, is another valid stream. Checksums are for the container.
//!
//! Streams are short, some twenty bytes, so states begin and are stored with no more bits than they need. When all words
//! are taken, states are not renormalized any more: an encoder begins with 1 and not with 2¹⁶, and loses no word by it.
//!
//! What symbol a slot belongs to is found by the alias method: each bucket of slots is shared by two symbols at most, so
//! that one entry of eight bytes answers, and all models of a codec fit the first-level cache.
//!
//! Source: Duda, "Asymmetric numeral systems: entropy coding combining speed of Huffman coding with
//! compression rate of arithmetic coding", 2013; Giesen, "Interleaved entropy coders", 2014, for the lanes,
//! the shared stream and the word-wise renormalization (one step always suffices with states of 2¹⁶ to 2³²); Walker, "An efficient method for
//! generating discrete random variables with general distributions", 1977, for the aliases.

mod alias;
mod decoder;
mod encoder;
mod model;
mod stored;

#[cfg(target_arch = "x86_64")]
pub(crate) use alias::Bucket;
pub(crate) use alias::Buckets;
pub(crate) use decoder::Decoder;
pub(crate) use encoder::Encoder;
pub(crate) use model::Model;
pub(crate) use stored::{read_models, write_models};

/// Independent states.
pub(crate) const LANES: usize = 4;
/// Probabilities are multiples of 2⁻¹².
pub(crate) const PROBABILITY_BITS: u32 = 12;
/// Slots of a model, shared by its symbols in proportion to their probabilities.
const SLOTS: usize = 1 << PROBABILITY_BITS;
/// Least state between two symbols.
const LEAST_STATE: u32 = 1 << WORD_BITS;
const WORD_BITS: u32 = 16;
/// Most symbols of an alphabet.
pub(crate) const MAX_SYMBOLS: usize = 64;
/// Most models of one set.
pub(crate) const MAX_MODELS: usize = 256;

#[cfg(test)]
mod tests;
