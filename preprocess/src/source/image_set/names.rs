//! Directions in the names of images.
//!
//! `tl` and `pl` are theta and phi of the light, `tv` and `pv` those of the view, in degrees, decimals allowed, in any
//! order. What the name of the file does not say is taken from the folders above it.
//!
//! Source: University of Bonn, BTF database 2003: `tv030_pv030/00008 tl000 pl000 tv030 pv030.jpg`;
//! UTIA BTF database, "Data description": `tv000_pv000/tl000_pl000_tv000_pv000.png`.

/// Theta and phi in degrees, as found in a name or a table.
pub(super) type Angles = [f64; 2];

/// What a name says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Directions {
    pub(super) view: Option<Angles>,
    pub(super) light: Option<Angles>,
}

/// A family of names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scheme {
    /// The databases of Bonn: UBO2003 and ATRIUM.
    Bonn,
    /// The database of UTIA.
    Utia,
    /// Any other names with angles.
    Angles,
    /// A table beside the images.
    Table,
}

impl Scheme {
    /// The scheme that a name follows.
    pub(super) fn of(name: &str) -> Self {
        let file = name.rsplit('/').next().unwrap_or(name);
        let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
        let is = |pattern: &str, text: &str| {
            pattern.len() == text.len()
                && pattern.bytes().zip(text.bytes()).all(|(wanted, found)| {
                    if wanted == b'0' {
                        found.is_ascii_digit()
                    } else {
                        wanted == found
                    }
                })
        };
        match stem.split_once(' ') {
            Some((number, angles))
                if number.bytes().all(|digit| digit.is_ascii_digit())
                    && is("tl000 pl000 tv000 pv000", angles) =>
            {
                Self::Bonn
            }
            _ if is("tl000_pl000_tv000_pv000", stem) => Self::Utia,
            _ => Self::Angles,
        }
    }

    /// For people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Bonn => "named as in UBO2003 and ATRIUM",
            Self::Utia => "named as in the UTIA database",
            Self::Angles => "with angles in their names",
            Self::Table => "with a table of directions",
        }
    }

    /// Whether samples include the cosine of the light's polar angle, unless the user says otherwise. Those of the
    /// databases are photographs under a lamp of constant distance: radiance over a constant. Müller et al.:
    /// Acquisition, Synthesis and Rendering of Bidirectional Texture Functions, 2005, section 2, on apparent BRDFs.
    pub(super) fn cosine(self) -> bool {
        matches!(self, Self::Bonn | Self::Utia)
    }
}

/// The directions in a name; the file's own part first, then the folders from the innermost.
///
/// # Errors
/// Says which angle is out of range or contradicts itself.
pub(super) fn parse(name: &str) -> Result<Directions, String> {
    // Only an extension that is no number: "tv23.5" has none.
    let stem = match name.rsplit_once('.') {
        Some((stem, extension)) if extension.starts_with(|first: char| first.is_ascii_alphabetic()) => stem,
        _ => name,
    };
    let mut angles = [None; 4];
    for part in stem.rsplit('/') {
        let own = scan(part)?;
        for (angle, own) in angles.iter_mut().zip(own) {
            *angle = angle.or(own);
        }
    }
    let [theta_view, phi_view, theta_light, phi_light] = angles;
    let pair = |what: &str, theta: Option<f64>, phi: Option<f64>| match (theta, phi) {
        (Some(theta), Some(phi)) => check(what, [theta, phi]).map(Some),
        (None, None) => Ok(None),
        _ => Err(format!("its name has only one of the two angles of the {what}")),
    };
    Ok(Directions {
        view: pair("view", theta_view, phi_view)?,
        light: pair("light", theta_light, phi_light)?,
    })
}

/// Checks the range of a direction's angles in degrees.
pub(super) fn check(what: &str, angles: Angles) -> Result<Angles, String> {
    let [theta, phi] = angles;
    // As much slack as `Sampling` has, for tables of few digits.
    if (0.0..=90.005).contains(&theta) && phi.abs() <= 3600.0 {
        return Ok(angles);
    }
    Err(format!(
        "the {what} has theta {theta} and phi {phi} degrees, expected theta from 0 to 90 and a phi around 0 to 360"
    ))
}

/// Angles tv, pv, tl, pl in one part of a path.
fn scan(part: &str) -> Result<[Option<f64>; 4], String> {
    let bytes = part.as_bytes();
    let mut angles = [None; 4];
    let mut at = 0;
    while at + 2 < bytes.len() {
        let key = [bytes[at].to_ascii_lowercase(), bytes[at + 1].to_ascii_lowercase()];
        let inside_a_word = at > 0 && bytes[at - 1].is_ascii_alphabetic();
        let index = [*b"tv", *b"pv", *b"tl", *b"pl"]
            .iter()
            .position(|name| *name == key);
        let (Some(index), false) = (index, inside_a_word) else {
            at += 1;
            continue;
        };
        let length = number_length(&bytes[at + 2..]);
        let Ok(angle) = part[at + 2..at + 2 + length].parse::<f64>() else {
            at += 1;
            continue;
        };
        if angles[index].is_some_and(|other| other != angle) {
            return Err(format!("its name says {} twice", &part[at..at + 2]));
        }
        angles[index] = Some(angle);
        at += 2 + length;
    }
    Ok(angles)
}

/// Bytes of `-12.5` at the beginning.
fn number_length(bytes: &[u8]) -> usize {
    let digits = |from: usize| {
        bytes[from..]
            .iter()
            .take_while(|byte| byte.is_ascii_digit())
            .count()
    };
    let sign = usize::from(bytes.first() == Some(&b'-'));
    let whole = sign + digits(sign);
    if whole == sign {
        return 0;
    }
    match bytes.get(whole) {
        Some(b'.') if digits(whole + 1) > 0 => whole + 1 + digits(whole + 1),
        _ => whole,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_databases_and_others_are_read() {
        let both = |view, light| {
            Ok(Directions {
                view: Some(view),
                light: Some(light),
            })
        };
        let cases = [
            (
                "wool/tv030_pv060/00008 tl015 pl090 tv030 pv060.jpg",
                both([30.0, 60.0], [15.0, 90.0]),
            ),
            (
                "tv000_pv000/tl075_pl345_tv000_pv000.png",
                both([0.0, 0.0], [75.0, 345.0]),
            ),
            (
                "tv23.5_pv15.25_tl11_pl-45.5.exr",
                both([23.5, 15.25], [11.0, -45.5]),
            ),
            ("PL10TL20-PV30TV40.PNG", both([40.0, 30.0], [20.0, 10.0])),
            ("tv10_pv20/tl30_pl40.hdr", both([10.0, 20.0], [30.0, 40.0])),
            ("tv10_pv20_tl30_pl40.5", both([10.0, 20.0], [30.0, 40.5])),
        ];
        for (name, expected) in cases {
            assert_eq!(parse(name), expected, "{name}");
        }
        assert_eq!(parse("tl30_pl40.png").unwrap().view, None);
        assert_eq!(parse("html20/thumb.jpg"), Ok(Directions::default()));
        for (name, expected) in [
            ("tl30_tv10_pv20.png", "only one"),
            ("tl30_pl0_tl40.png", "twice"),
            ("tl95_pl0.png", "theta 95"),
            ("tl-5_pl0.png", "theta -5"),
        ] {
            let error = parse(name).unwrap_err();
            assert!(error.contains(expected), "{name}: {error}");
        }
    }

    #[test]
    fn schemes_are_told_apart() {
        assert_eq!(Scheme::of("a/00008 tl000 pl000 tv030 pv030.jpg"), Scheme::Bonn);
        assert_eq!(
            Scheme::of("tv030_pv030/tl000_pl000_tv030_pv030.exr"),
            Scheme::Utia
        );
        assert_eq!(Scheme::of("tv030_pv030_tl000_pl000.exr"), Scheme::Angles);
        assert_eq!(Scheme::of("tl0_pl0.exr"), Scheme::Angles);
    }
}
