//! [`Reader::read`] with vectors of the four components, for processors with AVX2. Integers, and the same products of
//! floats: the same bits.

use std::arch::x86_64::*;

use super::{ESCAPE, Reader};
use crate::codec::pyramid_dct::context::{
    CORNER_WEIGHTS, FIRST_SHIFTED, FIRST_SHIFTED_MODEL, FIRST_WHOLE, GRID_AREA, GRID_SIDE, SECOND_WEIGHTS,
    SIDE_WEIGHTS, context,
};
use crate::codec::pyramid_dct::scan::Scan;
use crate::codec::pyramid_dct::transform::Block;
use crate::codec::rans::{Bucket, PROBABILITY_BITS};
use crate::codec::texel::Texel;

/// For each set of lanes that take a word: where in the next words, byte by byte, those of each lane lie.
const SPREAD: [[u8; 16]; 16] = {
    let mut spread = [[0x80; 16]; 16];
    let mut set = 0;
    while set < 16 {
        let (mut lane, mut taken) = (0, 0);
        while lane < 4 {
            if set >> lane & 1 == 1 {
                spread[set][4 * lane] = 2 * taken;
                spread[set][4 * lane + 1] = 2 * taken + 1;
                taken += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    spread
};

/// The lowest `count` lanes of a set.
fn lowest(mut set: usize, count: u32) -> usize {
    while set.count_ones() > count {
        set ^= 1 << set.ilog2();
    }
    set
}

/// The lanes as indices into tables of 64 times 64 entries.
#[inline]
#[target_feature(enable = "avx2")]
fn indices(vector: __m128i) -> [usize; 4] {
    let (low, high) = (
        _mm_cvtsi128_si64(vector) as u64,
        _mm_extract_epi64::<1>(vector) as u64,
    );
    [low, low >> 32, high, high >> 32].map(|index| index as usize % 4096)
}

impl Reader<'_> {
    /// As [`Reader::read`].
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    pub(in crate::codec::pyramid_dct) fn read_avx2(
        &mut self,
        scan: &Scan,
        step: f32,
        block: &mut Block,
    ) -> usize {
        let mut reader = *self;
        let end = reader.end();
        let buckets: &[u64] = bytemuck::cast_slice(reader.buckets.as_flattened());
        let buckets: &[u64; 4096] = buckets.try_into().expect("64 times 64 buckets");
        let values: &[f32; 4096] = reader
            .values
            .as_flattened()
            .try_into()
            .expect("64 times 64 values");
        let mut expected = [_mm_setzero_si128(); GRID_AREA];
        let mut states: __m128i = bytemuck::cast(reader.decoder.states);
        let steps = _mm_set1_ps(step);
        let factors: __m128i = bytemuck::cast(reader.means.factors);
        let all = |value: i32| _mm_set1_epi32(value);
        for place in scan.places(end) {
            let grid = usize::from(place.grid);
            // As `Means::at`.
            let mean = all(reader.means.places[usize::from(place.like)]);
            let means = _mm_add_epi32(_mm_srai_epi32::<6>(_mm_mullo_epi32(mean, factors)), all(1));
            let bits = _mm_castps_si128(_mm_cvtepi32_ps(_mm_add_epi32(expected[grid], means)));
            let classes = _mm_sub_epi32(_mm_srli_epi32::<21>(bits), all(127 << 2));
            let shifted = _mm_cmpgt_epi32(classes, all(FIRST_SHIFTED - 1));
            let models = _mm_blendv_epi8(
                _mm_max_epi32(
                    _mm_srli_epi32::<1>(classes),
                    _mm_sub_epi32(classes, all(FIRST_WHOLE / 2)),
                ),
                _mm_add_epi32(_mm_and_si128(classes, all(3)), all(FIRST_SHIFTED_MODEL)),
                shifted,
            );

            // As `alias::meaning` of all four.
            let numbers = _mm_and_si128(_mm_srli_epi32::<6>(states), all(63));
            let positions = _mm_and_si128(states, all(63));
            let first_of_model = _mm_slli_epi32::<6>(models);
            let [a, b, c, d] =
                indices(_mm_or_si128(first_of_model, numbers)).map(|index| buckets[index] as i64);
            let (ab, cd) = (
                _mm_castsi128_ps(_mm_set_epi64x(b, a)),
                _mm_castsi128_ps(_mm_set_epi64x(d, c)),
            );
            let lower = _mm_castps_si128(_mm_shuffle_ps::<0b10_00_10_00>(ab, cd));
            let upper = _mm_castps_si128(_mm_shuffle_ps::<0b11_01_11_01>(ab, cd));
            let own = _mm_cmpgt_epi32(_mm_and_si128(lower, all(Bucket::CUTOFF_MASK)), positions);
            let others = _mm_and_si128(_mm_srli_epi32::<8>(lower), all(0xff));
            let symbols = _mm_blendv_epi8(others, numbers, own);
            let frequencies = _mm_blendv_epi8(
                _mm_and_si128(upper, all(0xffff)),
                _mm_srli_epi32::<16>(lower),
                own,
            );
            let offsets = _mm_andnot_si128(own, _mm_srai_epi32::<16>(upper));
            let advanced =
                _mm_mullo_epi32(frequencies, _mm_srli_epi32::<{ PROBABILITY_BITS as i32 }>(states));
            let advanced = _mm_add_epi32(advanced, _mm_add_epi32(positions, offsets));

            // As `Decoder::renormalize_all`.
            let mut short = _mm_cmpeq_epi32(_mm_srli_epi32::<16>(advanced), _mm_setzero_si128());
            let mut taking = _mm_movemask_ps(_mm_castsi128_ps(short)) as usize % 16;
            let window = match reader.decoder.window() {
                Some((window, _)) => window,
                None => {
                    let (window, left) = reader.decoder.last_words();
                    taking = lowest(taking, left);
                    let lanes = _mm_set_epi32(8, 4, 2, 1);
                    short = _mm_cmpeq_epi32(_mm_and_si128(all(taking as i32), lanes), lanes);
                    window
                }
            };
            let window = _mm_cvtsi64_si128(window as i64);
            let words = _mm_shuffle_epi8(window, bytemuck::cast(SPREAD[taking]));
            let longer = _mm_or_si128(_mm_slli_epi32::<16>(advanced), words);
            states = _mm_blendv_epi8(advanced, longer, short);
            reader.decoder.take(taking.count_ones());

            let incomplete = _mm_or_si128(shifted, _mm_cmpeq_epi32(symbols, all(ESCAPE as i32)));
            let (coefficients, magnitudes);
            if _mm_movemask_epi8(incomplete) == 0 {
                let [a, b, c, d] = indices(_mm_or_si128(first_of_model, symbols)).map(|index| values[index]);
                coefficients = _mm_set_ps(d, c, b, a);
                magnitudes = _mm_srli_epi32::<1>(_mm_add_epi32(symbols, all(1)));
            } else {
                reader.decoder.states = bytemuck::cast(states);
                let classes: [i32; 4] = bytemuck::cast(classes);
                let symbols: [u32; 4] = bytemuck::cast(symbols);
                let rest = reader.rest_of_all(classes.map(context), symbols.map(|symbol| symbol as usize));
                coefficients = bytemuck::cast(rest.0);
                magnitudes = bytemuck::cast(rest.1);
                states = bytemuck::cast(reader.decoder.states);
            }
            block[usize::from(place.at)] = Texel(bytemuck::cast(_mm_mul_ps(coefficients, steps)));

            // As `Expected::add`.
            let pairs = _mm_add_epi32(magnitudes, _mm_shuffle_epi32::<0b01_00_11_10>(magnitudes));
            let sum = _mm_add_epi32(pairs, _mm_shuffle_epi32::<0b10_11_00_01>(pairs));
            let share = |[own, others]: [i32; 2]| {
                _mm_add_epi32(
                    _mm_mullo_epi32(magnitudes, all(own)),
                    _mm_mullo_epi32(sum, all(others)),
                )
            };
            let (side, corner, second) = (share(SIDE_WEIGHTS), share(CORNER_WEIGHTS), share(SECOND_WEIGHTS));
            if let Some(sums) = expected.get_mut(grid..=grid + 2 * GRID_SIDE) {
                sums[1] = _mm_add_epi32(sums[1], side);
                sums[2] = _mm_add_epi32(sums[2], second);
                sums[GRID_SIDE] = _mm_add_epi32(sums[GRID_SIDE], side);
                sums[GRID_SIDE + 1] = _mm_add_epi32(sums[GRID_SIDE + 1], corner);
                sums[2 * GRID_SIDE] = _mm_add_epi32(sums[2 * GRID_SIDE], second);
            }
        }
        reader.decoder.states = bytemuck::cast(states);
        *self = reader;
        end
    }
}
