//! [`Reader::read`] with vectors of the four components, for processors with AVX2. Integers, and the same products of
//! floats: the same bits.

use std::arch::x86_64::*;

use super::{ESCAPE, Reader};
use crate::codec::pyramid_dct::context::{
    CORNER_WEIGHTS, Expected, FIRST_SHIFTED, FIRST_SHIFTED_MODEL, FIRST_WHOLE, GRID_AREA, GRID_SIDE,
    SECOND_WEIGHTS, SIDE_WEIGHTS, context,
};
use crate::codec::pyramid_dct::scan::Scan;
use crate::codec::pyramid_dct::transform::Block;
use crate::codec::rans::{Bucket, LANES, PROBABILITY_BITS};
use crate::codec::texel::Texel;

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
        end: usize,
        step: f32,
        block: &mut Block,
        known: &mut Expected,
    ) {
        let mut reader = *self;
        let buckets: &[u64] = bytemuck::cast_slice(reader.buckets.as_flattened());
        let buckets: &[u64; 4096] = buckets.try_into().expect("64 times 64 buckets");
        let values: &[f32; 4096] = reader
            .values
            .as_flattened()
            .try_into()
            .expect("64 times 64 values");
        let expected: &mut [__m128i; GRID_AREA] = bytemuck::cast_mut(&mut known.0);
        let mut states: __m128i = bytemuck::cast(reader.decoder.states);
        let steps = _mm_set1_ps(step);
        let factors: __m128i = bytemuck::cast(reader.means.factors);
        let all = |value: i32| _mm_set1_epi32(value);
        for place in scan.places(end) {
            let (window, left) = reader.decoder.window();
            let window = _mm_cvtsi64_si128(window as i64);
            let grid = usize::from(place.grid);
            // As `Means::at`.
            let mean = all(reader.means.places[usize::from(place.like)]);
            let means = _mm_add_epi32(_mm_srai_epi32::<6>(_mm_mullo_epi32(mean, factors)), all(1));
            let known = std::mem::replace(&mut expected[grid], _mm_setzero_si128());
            let bits = _mm_castps_si128(_mm_cvtepi32_ps(_mm_add_epi32(known, means)));
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
            // Where each lane's word lies in the window, in bytes: two for each lane before it that takes one. A table by the
            // mask would be shorter, but the next symbol waits for this.
            let taken = _mm_slli_si128::<4>(_mm_and_si128(short, all(0x0202)));
            let places = _mm_add_epi32(
                _mm_add_epi32(taken, all(0x8080_0100_u32 as i32)),
                _mm_add_epi32(_mm_slli_si128::<4>(taken), _mm_slli_si128::<8>(taken)),
            );
            if left < LANES as u32 {
                // Those for which no words are left go without.
                let places = _mm_and_si128(places, all(0xff));
                short = _mm_and_si128(short, _mm_cmpgt_epi32(all(2 * left as i32), places));
            }
            let words = _mm_shuffle_epi8(window, places);
            let longer = _mm_or_si128(_mm_slli_epi32::<16>(advanced), words);
            states = _mm_blendv_epi8(advanced, longer, short);
            reader
                .decoder
                .take(_mm_movemask_ps(_mm_castsi128_ps(short)).count_ones());

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
        known.forget(scan, end);
        reader.decoder.states = bytemuck::cast(states);
        *self = reader;
    }
}
