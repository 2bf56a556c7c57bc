//! Eigenvectors of a symmetric matrix, with the same bits on every platform.
//!
//! Decoders derive their transforms with this, so it must not depend on a linear algebra library, its threads
//! or its vector units: f64 additions, multiplications, divisions and square roots in a fixed order.
//!
//! Source: Householder reduction and implicit QL, Bowdler, Martin, Reinsch, Wilkinson, "The QR and QL
//! algorithms for symmetric matrices", 1968 (the procedures tred2 and tql2 of EISPACK).

/// Iterations for one eigenvalue; two or three are usual.
const MAX_ITERATIONS: usize = 60;

/// Eigenvectors of a symmetric matrix `[row][column]` of n×n, `[vector][element]`, by falling eigenvalue;
/// orthonormal to a few units in the last place. Takes about 8·n³ operations.
pub(super) fn eigenvectors(mut matrix: Vec<f64>, n: usize) -> Vec<f64> {
    assert_eq!(matrix.len(), n * n);
    if n == 0 {
        return matrix;
    }
    let (mut diagonal, mut off_diagonal) = tridiagonalize(&mut matrix, n);
    diagonalize(&mut matrix, &mut diagonal, &mut off_diagonal, n);
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| diagonal[b].total_cmp(&diagonal[a]));
    order
        .iter()
        .flat_map(|&vector| matrix[vector * n..][..n].iter().copied())
        .collect()
}

/// Replaces a symmetric matrix by the rows of an orthogonal Q so that Q·A·Qᵀ is tridiagonal; gives its
/// diagonal and, from element 1 on, what stands beside it.
fn tridiagonalize(a: &mut [f64], n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut diagonal = vec![0.0; n];
    let mut beside = vec![0.0; n];
    // Householder vectors stay in the lower rows of `a`; `diagonal` keeps half their squared lengths.
    for i in (1..n).rev() {
        let (before, row) = a.split_at_mut(i * n);
        let row = &mut row[..i];
        let scale: f64 = row[..i - 1].iter().map(|x| x.abs()).sum();
        if i == 1 || scale == 0.0 {
            beside[i] = row[i - 1];
            continue;
        }
        let scale = scale + row[i - 1].abs();
        let mut h = 0.0;
        for x in row.iter_mut() {
            *x /= scale;
            h += *x * *x;
        }
        let f = row[i - 1];
        let g = if f > 0.0 { -h.sqrt() } else { h.sqrt() };
        beside[i] = scale * g;
        h -= f * g;
        row[i - 1] = f - g;
        diagonal[i] = h;
        // p = A·u / h, by the lower triangle; then A -= u·qᵀ + q·uᵀ.
        let mut p = vec![0.0; i];
        for j in 0..i {
            let line = &before[j * n..][..=j];
            let mut sum = 0.0;
            for k in 0..j {
                sum += line[k] * row[k];
                p[k] += line[k] * row[j];
            }
            p[j] += sum + line[j] * row[j];
        }
        let mut uap = 0.0;
        for (p, u) in p.iter_mut().zip(row.iter()) {
            *p /= h;
            uap += *p * u;
        }
        let half = uap / (h + h);
        for (p, u) in p.iter_mut().zip(row.iter()) {
            *p -= half * u;
        }
        for j in 0..i {
            for k in 0..=j {
                before[j * n + k] -= row[j] * p[k] + p[j] * row[k];
            }
        }
    }
    // The diagonal is taken out, and the product of all reflections is built in its place, row by row.
    for i in 0..n {
        let h = std::mem::replace(&mut diagonal[i], a[i * n + i]);
        if h != 0.0 {
            let (before, row) = a.split_at_mut(i * n);
            for line in before.chunks_exact_mut(n) {
                // Lines are the columns of Q so far: Q is kept transposed.
                let sum: f64 = line[..i].iter().zip(row.iter()).map(|(x, u)| x * u).sum();
                let factor = sum / h;
                for (x, u) in line[..i].iter_mut().zip(row.iter()) {
                    *x -= factor * u;
                }
            }
        }
        for j in 0..i {
            a[i * n + j] = 0.0;
            a[j * n + i] = 0.0;
        }
        a[i * n + i] = 1.0;
    }
    // Lines hold columns of Q; what follows wants its rows' images: line j becomes vector j.
    (diagonal, beside)
}

/// Implicit QL: turns the tridiagonal matrix into a diagonal one and takes the vectors along, `[vector][element]`.
fn diagonalize(vectors: &mut [f64], diagonal: &mut [f64], beside: &mut [f64], n: usize) {
    beside.rotate_left(1);
    beside[n - 1] = 0.0;
    for l in 0..n {
        for _ in 0..MAX_ITERATIONS {
            let small = |i: &usize| {
                let size = diagonal[*i].abs() + diagonal[*i + 1].abs();
                beside[*i].abs() <= f64::EPSILON * size
            };
            let m = (l..n - 1).find(small).unwrap_or(n - 1);
            if m == l {
                break;
            }
            let mut g = (diagonal[l + 1] - diagonal[l]) / (2.0 * beside[l]);
            let mut r = (g * g + 1.0).sqrt();
            g = diagonal[m] - diagonal[l] + beside[l] / (g + if g < 0.0 { -r } else { r });
            let (mut sine, mut cosine, mut p) = (1.0, 1.0, 0.0);
            let mut split = false;
            for i in (l..m).rev() {
                let f = sine * beside[i];
                let b = cosine * beside[i];
                r = (f * f + g * g).sqrt();
                beside[i + 1] = r;
                if r == 0.0 {
                    diagonal[i + 1] -= p;
                    beside[m] = 0.0;
                    split = true;
                    break;
                }
                sine = f / r;
                cosine = g / r;
                g = diagonal[i + 1] - p;
                r = (diagonal[i] - g) * sine + 2.0 * cosine * b;
                p = sine * r;
                diagonal[i + 1] = g + p;
                g = cosine * r - b;
                let (low, high) = vectors[i * n..].split_at_mut(n);
                for (low, high) in low.iter_mut().zip(&mut high[..n]) {
                    let old = *high;
                    *high = sine * *low + cosine * old;
                    *low = cosine * *low - sine * old;
                }
            }
            if !split {
                diagonal[l] -= p;
                beside[l] = g;
                beside[m] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(matrix: &[f64], n: usize) {
        let vectors = eigenvectors(matrix.to_vec(), n);
        let norm = matrix.iter().fold(1e-300, |max: f64, x| max.max(x.abs())) * n as f64;
        let mut last = f64::INFINITY;
        for (i, a) in vectors.chunks_exact(n).enumerate() {
            for (j, b) in vectors.chunks_exact(n).enumerate() {
                let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12, "{i} {j} {dot}");
            }
            let image: Vec<f64> = matrix
                .chunks_exact(n)
                .map(|row| row.iter().zip(a).map(|(m, a)| m * a).sum())
                .collect();
            let value: f64 = image.iter().zip(a).map(|(x, y)| x * y).sum();
            for (x, a) in image.iter().zip(a) {
                assert!(
                    (x - value * a).abs() < 1e-12 * norm,
                    "vector {i}: {x} is not {value} times {a}"
                );
            }
            assert!(value <= last + 1e-12 * norm);
            last = value;
        }
    }

    #[test]
    fn vectors_are_orthonormal_and_belong_to_falling_values() {
        for n in [1, 2, 3, 10, 81] {
            let mut state = 1u64;
            let mut noise = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            };
            let half: Vec<f64> = (0..n * n).map(|_| noise()).collect();
            let symmetric: Vec<f64> = (0..n * n).map(|i| half[i] + half[i % n * n + i / n]).collect();
            check(&symmetric, n);
            // Smooth kernels have values down to nothing, equal ones, and rings are circulant.
            let kernel = |i: usize, j: usize| {
                let distance = (i.abs_diff(j)).min(n - i.abs_diff(j)) as f64;
                1.0 / (1.0 + distance * distance)
            };
            check(&(0..n * n).map(|i| kernel(i / n, i % n)).collect::<Vec<_>>(), n);
            check(
                &(0..n * n)
                    .map(|i| f64::from(u8::from(i / n == i % n)))
                    .collect::<Vec<_>>(),
                n,
            );
            check(&vec![1.0; n * n], n);
            check(&vec![0.0; n * n], n);
        }
    }
}
