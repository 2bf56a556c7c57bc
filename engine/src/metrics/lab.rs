//! CIELAB and its colour differences, for the light of an sRGB screen with the white D65.
//!
//! Sources: IEC 61966-2-1 (primaries); CIE 15:2004 (CIELAB, ΔE of 1976); Sharma, Wu, Dalal: The CIEDE2000
//! Color-Difference Formula, 2005 (ΔE of 2000, with its test data).

/// XYZ from linear sRGB.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [0.4124, 0.3576, 0.1805],
    [0.2126, 0.7152, 0.0722],
    [0.0193, 0.1192, 0.9505],
];
/// Sums of the rows: so greys have a* and b* of exactly zero.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.0890];

/// L*, a*, b* of linear sRGB.
pub fn lab_from_linear(rgb: [f64; 3]) -> [f64; 3] {
    let curve = |t: f64| {
        const EDGE: f64 = 6.0 / 29.0;
        if t > EDGE * EDGE * EDGE {
            t.cbrt()
        } else {
            t / (3.0 * EDGE * EDGE) + 4.0 / 29.0
        }
    };
    let [x, y, z] = [0, 1, 2].map(|row| {
        let xyz: f64 = XYZ_FROM_RGB[row]
            .iter()
            .zip(rgb)
            .map(|(weight, channel)| weight * channel)
            .sum();
        curve(xyz / WHITE[row])
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// ΔE of 1976: distance in CIELAB.
pub fn delta_e_76(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// ΔE of 2000, with all parametric factors one.
pub fn delta_e_2000([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    let mean_chroma = (a1.hypot(b1) + a2.hypot(b2)) / 2.0;
    // 25 ^ 7.
    let share = |chroma: f64| (chroma.powi(7) / (chroma.powi(7) + 6_103_515_625.0)).sqrt();
    let stretch = 1.0 + 0.5 * (1.0 - share(mean_chroma));
    let (a1, a2) = (a1 * stretch, a2 * stretch);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    let hue = |a: f64, b: f64| {
        if a == 0.0 && b == 0.0 {
            0.0
        } else {
            b.atan2(a).to_degrees().rem_euclid(360.0)
        }
    };
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));

    let grey = c1 * c2 == 0.0;
    let turn = match h2 - h1 {
        _ if grey => 0.0,
        turn if turn > 180.0 => turn - 360.0,
        turn if turn < -180.0 => turn + 360.0,
        turn => turn,
    };
    let (dl, dc) = (l2 - l1, c2 - c1);
    let dh = 2.0 * (c1 * c2).sqrt() * (turn / 2.0).to_radians().sin();

    let (l, c) = ((l1 + l2) / 2.0, (c1 + c2) / 2.0);
    let h = match h1 + h2 {
        sum if grey => sum,
        sum if (h1 - h2).abs() <= 180.0 => sum / 2.0,
        sum if sum < 360.0 => (sum + 360.0) / 2.0,
        sum => (sum - 360.0) / 2.0,
    };
    let cosine = |degrees: f64| degrees.to_radians().cos();
    let t = 1.0 - 0.17 * cosine(h - 30.0) + 0.24 * cosine(2.0 * h) + 0.32 * cosine(3.0 * h + 6.0)
        - 0.20 * cosine(4.0 * h - 63.0);
    let rotation = 60.0 * (-((h - 275.0) / 25.0).powi(2)).exp();
    let (sl, sc, sh) = {
        let square = (l - 50.0).powi(2);
        (
            1.0 + 0.015 * square / (20.0 + square).sqrt(),
            1.0 + 0.045 * c,
            1.0 + 0.015 * c * t,
        )
    };
    let turned = -rotation.to_radians().sin() * 2.0 * share(c) * (dc / sc) * (dh / sh);
    ((dl / sl).powi(2) + (dc / sc).powi(2) + (dh / sh).powi(2) + turned)
        .max(0.0)
        .sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sharma, Wu, Dalal 2005, table 1: pairs that reach every branch.
    #[test]
    fn ciede2000_has_the_published_values() {
        let pairs = [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0009], 7.1792),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0011], 7.2195),
            ([50.0, -0.0010, 2.4900], [50.0, 0.0009, -2.4900], 4.8045),
            ([50.0, 2.5, 0.0], [50.0, 0.0, -2.5], 4.3065),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
            ([22.7233, 20.0904, -46.6940], [23.0331, 14.9730, -42.5619], 2.0373),
            ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
        ];
        for (a, b, expected) in pairs {
            assert!(
                (delta_e_2000(a, b) - expected).abs() < 1e-4,
                "{a:?} {b:?}: {}",
                delta_e_2000(a, b)
            );
            assert!((delta_e_2000(b, a) - expected).abs() < 1e-4);
        }
    }

    #[test]
    fn white_is_100_and_greys_have_no_colour() {
        for grey in [0.0, 0.001, 0.2, 1.0] {
            let [l, a, b] = lab_from_linear([grey; 3]);
            assert!(a.abs() < 1e-9 && b.abs() < 1e-9 && (0.0..=100.0 + 1e-9).contains(&l));
        }
        assert!((lab_from_linear([1.0; 3])[0] - 100.0).abs() < 1e-9);
    }
}
