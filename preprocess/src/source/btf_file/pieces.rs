//! Rows of a buffer, cut so that every task gets the same texels of every row.

/// Cuts the rows of `buffer`, each of `bounds`' last texels, at `bounds`: piece `b` of every row holds the texels
/// from `bounds[b]` to `bounds[b + 1]`. Returned as `[piece][row]`.
///
/// # Panics
/// If the bounds do not begin with 0 and grow, or the buffer holds no whole number of rows.
pub(super) fn pieces<'a>(buffer: &'a mut [f32], bounds: &[usize]) -> Vec<Vec<&'a mut [f32]>> {
    let texels = *bounds.last().expect("bounds end with the number of texels");
    assert!(
        bounds[0] == 0 && buffer.len().is_multiple_of(texels),
        "whole rows"
    );
    let rows = buffer.len() / texels;
    let mut pieces: Vec<Vec<&mut [f32]>> = Vec::new();
    pieces.resize_with(bounds.len() - 1, || Vec::with_capacity(rows));
    for mut row in buffer.chunks_exact_mut(texels) {
        for (piece, bounds) in pieces.iter_mut().zip(bounds.windows(2)) {
            let (head, tail) = row.split_at_mut(bounds[1] - bounds[0]);
            piece.push(head);
            row = tail;
        }
    }
    pieces
}

/// Bounds of pieces of `count` texels.
pub(super) fn even_bounds(texels: usize, count: usize) -> Vec<usize> {
    (0..texels).step_by(count).chain([texels]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_every_row() {
        let mut buffer: Vec<f32> = (0..10).map(|i| i as f32).collect();
        let cut = pieces(&mut buffer, &even_bounds(5, 2));
        assert_eq!(
            cut,
            [
                [&[0.0, 1.0][..], &[5.0, 6.0]],
                [&[2.0, 3.0], &[7.0, 8.0]],
                [&[4.0], &[9.0]]
            ]
        );
    }
}
