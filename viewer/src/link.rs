//! What a viewer shows, in a short string: for the address of a page, or an argument of a program.
//!
//! `cam=0.35,0.15,1.5,0,0,0,40&light=d-0.54,0.64,0.54,3.2,3,2.7&ev=0.33&shape=cloth&overlay=mip`: parts in any order, each at
//! most once, joined by `&`; a leading `#` or `?` is ignored. Numbers have six digits. What is not said stays as it is.

use engine::Overlay;
use glam::Vec3;
use scenes::{Camera, Light, Shape};

use crate::{controls::Mode, lights::MOST_LIGHTS};

/// Longest string that is read, bytes.
pub const LONGEST_LINK: usize = 4096;
/// Exposures that are read, stops.
pub const MOST_STOPS: f32 = 20.0;

/// What a link restores.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Link {
    /// Camera; `up` and `near` are those of the viewer.
    pub camera: Option<Camera>,
    /// What dragging does.
    pub mode: Option<Mode>,
    /// All lights.
    pub lights: Option<Vec<Light>>,
    /// Stops.
    pub exposure_stops: Option<f32>,
    /// Shape of a lone archive.
    pub shape: Option<Shape>,
    /// What lies over the picture.
    pub overlay: Option<Overlay>,
}

/// Why a string is no link.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("link: {part:?}: {problem}")]
pub struct LinkError {
    /// The part that is wrong, cut to a readable length.
    pub part: String,
    /// What is wrong with it, and what was expected.
    pub problem: String,
}

impl Link {
    /// Reads a link.
    ///
    /// # Errors
    /// [`LinkError`], which names the part: what is unknown, said twice, not a number, or a camera that cannot be used.
    pub fn parse(text: &str) -> Result<Self, LinkError> {
        let text = text.trim().trim_start_matches(['#', '?']);
        if text.len() > LONGEST_LINK {
            return Err(wrong(text, format!("longer than {LONGEST_LINK} bytes")));
        }
        let mut link = Self::default();
        for part in text.split('&').filter(|part| !part.is_empty()) {
            let (name, value) = part
                .split_once('=')
                .ok_or_else(|| wrong(part, "expected NAME=VALUE"))?;
            link.read(name, value).map_err(|problem| wrong(part, problem))?;
        }
        Ok(link)
    }

    fn read(&mut self, name: &str, value: &str) -> Result<(), String> {
        match name {
            "cam" => once(&mut self.camera, camera(value)?),
            "mode" => once(
                &mut self.mode,
                match value {
                    "orbit" => Mode::Orbit,
                    "fly" => Mode::Fly,
                    _ => return Err("expected orbit or fly".into()),
                },
            ),
            "light" => once(&mut self.lights, lights(value)?),
            "ev" => {
                let stops = number(value)?;
                if stops.abs() > MOST_STOPS {
                    return Err(format!("expected -{MOST_STOPS} to {MOST_STOPS} stops"));
                }
                once(&mut self.exposure_stops, stops)
            }
            "shape" => {
                let names = Shape::ALL.map(Shape::name).join(", ");
                let shape = Shape::named(value).ok_or_else(|| format!("expected one of {names}"))?;
                once(&mut self.shape, shape)
            }
            "overlay" => {
                let names = Overlay::ALL.map(Overlay::name).join(", ");
                let overlay = Overlay::from_name(value).ok_or_else(|| format!("expected one of {names}"))?;
                once(&mut self.overlay, overlay)
            }
            _ => Err("expected cam, mode, light, ev, shape or overlay".into()),
        }
    }
}

/// As [`Link::parse`] reads it, without `#`.
impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut parts = Vec::new();
        if let Some(camera) = &self.camera {
            let [eye, target] = [camera.eye, camera.target].map(vector);
            let fov = short(camera.fov_y.to_degrees());
            parts.push(format!("cam={eye},{target},{fov}"));
        }
        match self.mode {
            Some(Mode::Fly) => parts.push("mode=fly".into()),
            Some(Mode::Orbit) => parts.push("mode=orbit".into()),
            None => {}
        }
        if let Some(lights) = &self.lights {
            let light = |light: &Light| match light {
                Light::Directional { to_light, irradiance } => {
                    format!("d{},{}", vector(*to_light), vector(*irradiance))
                }
                Light::Point { position, intensity } => {
                    format!("p{},{}", vector(*position), vector(*intensity))
                }
            };
            let lights: Vec<_> = lights.iter().take(MOST_LIGHTS).map(light).collect();
            parts.push(format!("light={}", lights.join(";")));
        }
        if let Some(stops) = self.exposure_stops {
            parts.push(format!("ev={}", short(stops)));
        }
        if let Some(shape) = self.shape {
            parts.push(format!("shape={}", shape.name()));
        }
        if let Some(overlay) = self.overlay {
            parts.push(format!("overlay={}", overlay.name()));
        }
        f.write_str(&parts.join("&"))
    }
}

fn wrong(part: &str, problem: impl Into<String>) -> LinkError {
    LinkError {
        part: part.chars().take(60).collect(),
        problem: problem.into(),
    }
}

fn once<T>(place: &mut Option<T>, value: T) -> Result<(), String> {
    match place.replace(value) {
        None => Ok(()),
        Some(_) => Err("said twice".into()),
    }
}

fn camera(value: &str) -> Result<Camera, String> {
    let [ex, ey, ez, tx, ty, tz, fov] = numbers(value)?;
    let camera = Camera {
        eye: Vec3::new(ex, ey, ez),
        target: Vec3::new(tx, ty, tz),
        up: Vec3::Y,
        fov_y: fov.to_radians(),
        near: 0.01,
    };
    match camera.problem() {
        None => Ok(camera),
        Some(problem) => Err(format!("this camera {problem}")),
    }
}

fn lights(value: &str) -> Result<Vec<Light>, String> {
    let mut lights = Vec::new();
    for text in value.split(';').filter(|text| !text.is_empty()) {
        if lights.len() == MOST_LIGHTS {
            return Err(format!("more than {MOST_LIGHTS} lights"));
        }
        let kind = text.as_bytes().first();
        let rest = text.get(1..).filter(|_| matches!(kind, Some(b'd' | b'p')));
        let rest = rest.ok_or("expected d (directional) or p (point) and six numbers")?;
        let [x, y, z, r, g, b] = numbers(rest)?;
        let (vector, color) = (Vec3::new(x, y, z), Vec3::new(r, g, b));
        if color.min_element() < 0.0 {
            return Err("a light's colour has a negative part".into());
        }
        lights.push(if kind == Some(&b'd') {
            Light::Directional {
                to_light: vector
                    .try_normalize()
                    .ok_or("a light's direction has no length")?,
                irradiance: color,
            }
        } else {
            Light::Point {
                position: vector,
                intensity: color,
            }
        });
    }
    Ok(lights)
}

fn numbers<const N: usize>(value: &str) -> Result<[f32; N], String> {
    let mut all = [0.0; N];
    let mut parts = value.split(',');
    for place in &mut all {
        let part = parts
            .next()
            .ok_or_else(|| format!("expected {N} numbers with commas between them"))?;
        *place = number(part)?;
    }
    match parts.next() {
        None => Ok(all),
        Some(_) => Err(format!("more than {N} numbers")),
    }
}

fn number(text: &str) -> Result<f32, String> {
    let number = text.parse::<f32>().ok().filter(|number| number.is_finite());
    number.ok_or_else(|| format!("{:?} is no number", text.chars().take(20).collect::<String>()))
}

fn vector(vector: Vec3) -> String {
    vector.to_array().map(short).join(",")
}

/// Six digits, as short as they can be written.
fn short(number: f32) -> String {
    let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(0.0);
    let size = rounded.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) {
        format!("{rounded:e}")
    } else {
        // Zero has no sign here.
        format!("{}", rounded + 0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vectors(size: f32) -> impl Strategy<Value = Vec3> {
        [-size..size, -size..size, -size..size].prop_map(Vec3::from_array)
    }

    fn light() -> impl Strategy<Value = Light> {
        (any::<bool>(), vectors(1e3), [0f32..1e5, 0f32..1e5, 0f32..1e5]).prop_filter_map(
            "a direction without length",
            |(point, vector, color)| {
                let color = Vec3::from_array(color);
                Some(if point {
                    Light::Point {
                        position: vector,
                        intensity: color,
                    }
                } else {
                    Light::Directional {
                        to_light: vector.try_normalize()?,
                        irradiance: color,
                    }
                })
            },
        )
    }

    fn camera() -> impl Strategy<Value = Camera> {
        (vectors(1e4), vectors(10.0), 5f32..150.0).prop_filter_map("odd", |(eye, target, fov)| {
            let camera = Camera {
                eye,
                target,
                up: Vec3::Y,
                fov_y: fov.to_radians(),
                near: 0.01,
            };
            // By a margin, so that rounding leaves it usable.
            let forward = (target - eye).try_normalize()?;
            (camera.problem().is_none() && forward.y.abs() < 0.999 && eye.distance(target) > 0.1)
                .then_some(camera)
        })
    }

    fn link() -> impl Strategy<Value = Link> {
        let mode = prop_oneof![Just(Mode::Orbit), Just(Mode::Fly)];
        (
            prop::option::of(camera()),
            prop::option::of(mode),
            prop::option::of(prop::collection::vec(light(), 0..=MOST_LIGHTS)),
            prop::option::of(-MOST_STOPS..MOST_STOPS),
            prop::option::of((0..4usize).prop_map(|shape| Shape::ALL[shape])),
            prop::option::of((0..Overlay::ALL.len()).prop_map(|overlay| Overlay::ALL[overlay])),
        )
            .prop_map(|(camera, mode, lights, exposure_stops, shape, overlay)| Link {
                camera,
                mode,
                lights,
                exposure_stops,
                shape,
                overlay,
            })
    }

    fn near(a: Vec3, b: Vec3) -> bool {
        (a - b).abs().max_element() <= 1e-5 * a.abs().max_element().max(1e-3) * 2.0
    }

    proptest! {
        #[test]
        fn a_link_comes_back(link in link()) {
            let text = link.to_string();
            prop_assert!(text.len() < LONGEST_LINK, "{}", text.len());
            prop_assert!(text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"=&,;.-".contains(&byte)));
            let read = Link::parse(&format!("#{text}")).unwrap();
            prop_assert_eq!(read.mode, link.mode);
            prop_assert_eq!(read.shape, link.shape);
            prop_assert_eq!(read.overlay, link.overlay);
            if let (Some(a), Some(b)) = (&read.camera, &link.camera) {
                prop_assert!(near(a.eye, b.eye) && near(a.target, b.target) && (a.fov_y - b.fov_y).abs() < 1e-4);
            }
            let (lights, before) = (read.lights.as_deref().unwrap_or(&[]), link.lights.as_deref().unwrap_or(&[]));
            prop_assert_eq!(lights.len(), before.len());
            for (a, b) in lights.iter().zip(before) {
                let same = match (a, b) {
                    (Light::Point { position: a, intensity: i }, Light::Point { position: b, intensity: j })
                    | (
                        Light::Directional { to_light: a, irradiance: i },
                        Light::Directional { to_light: b, irradiance: j },
                    ) => near(*a, *b) && near(*i, *j),
                    _ => false,
                };
                prop_assert!(same, "{:?} {:?}", a, b);
            }
            // And from then on exactly, but for the directions, which are made unit vectors again.
            if link.lights.is_none() {
                prop_assert_eq!(read.to_string(), text);
            }
        }

        #[test]
        fn no_text_panics(text in "\\PC{0,80}", cut in 0usize..400, link in link()) {
            let _ = Link::parse(&text);
            let _ = Link::parse(&format!("cam={text}&light={text}&ev={text}"));
            let _ = Link::parse(&format!("light=d{text};p{text}"));
            let whole = link.to_string();
            let _ = Link::parse(&whole[..cut.min(whole.len())]);
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, says) in [
            ("cam=1,2,3", "expected 7 numbers"),
            ("cam=0,0,0,0,0,0,40", "one place"),
            ("cam=0,0,1,0,0,0,nan", "no number"),
            ("cam=0,0,1,0,0,0,40,7", "more than 7"),
            ("ev=1&ev=2", "said twice"),
            ("ev=100", "stops"),
            ("light=x1,2,3,4,5,6", "directional"),
            ("light=d0,0,0,1,1,1", "no length"),
            ("light=p0,0,0,1,-1,1", "negative"),
            ("shape=cube", "plane, sphere, cylinder, cloth"),
            ("mode=swim", "orbit or fly"),
            ("overlay=../x", "none, mip, components"),
            ("hello", "NAME=VALUE"),
            ("x=1", "expected cam"),
        ] {
            let error = Link::parse(text).unwrap_err().to_string();
            assert!(error.contains(says), "{text}: {error}");
        }
        let long = "a".repeat(LONGEST_LINK + 1);
        assert!(Link::parse(&long).unwrap_err().part.len() <= 60);
        assert_eq!(Link::parse("#"), Ok(Link::default()));
    }
}
