//! Images in order: a rectangle of views and lights, and what is wrong with it.

use std::collections::BTreeMap;

use tileset::Direction;

use super::names::Angles;

/// Angles are equal when they agree to this part of a degree: names have few digits, radians in tables many.
const PER_DEGREE: f64 = 1e4;

/// A direction as whole numbers, so that equal ones are found and the order is by theta, then phi.
type Key = (i64, i64);

/// An image and its directions in degrees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    /// Index of its file.
    pub(super) file: usize,
    pub(super) view: Angles,
    pub(super) light: Angles,
}

/// All images in order.
#[derive(Debug)]
pub(super) struct Grid {
    pub(super) views: Vec<Direction>,
    pub(super) lights: Vec<Direction>,
    /// `[view][light]`: index of the file. Empty if there are too many directions for an archive.
    pub(super) files: Vec<Option<usize>>,
    /// Files of the same view and light.
    pub(super) duplicates: Vec<(usize, usize)>,
}

/// Puts images in the order of their directions: by theta, then phi. Azimuths are taken modulo 360 degrees; at theta 0
/// they mean nothing.
pub(super) fn arrange(images: &[Placed]) -> Grid {
    let (views, view_index) = axis(images.iter().map(|image| image.view));
    let (lights, light_index) = axis(images.iter().map(|image| image.light));
    let mut grid = Grid {
        files: Vec::new(),
        duplicates: Vec::new(),
        views,
        lights,
    };
    let most = tileset::MAX_DIRECTIONS as usize;
    if grid.views.len() > most || grid.lights.len() > most {
        return grid;
    }
    grid.files = vec![None; grid.views.len() * grid.lights.len()];
    for image in images {
        let (view, light) = (view_index[&key(image.view)], light_index[&key(image.light)]);
        let place = &mut grid.files[view * grid.lights.len() + light];
        match *place {
            Some(other) => grid.duplicates.push((other, image.file)),
            None => *place = Some(image.file),
        }
    }
    grid
}

impl Grid {
    /// The (view, light) pairs without an image.
    pub(super) fn holes(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let lights = self.lights.len();
        let places = self.files.iter().enumerate();
        places
            .filter(|(_, file)| file.is_none())
            .map(move |(place, _)| (place / lights, place % lights))
    }

    /// A place as names of images say it.
    pub(super) fn name(&self, (view, light): (usize, usize)) -> String {
        let part = |letter: char, direction: Direction| {
            format!(
                "t{letter}{} p{letter}{}",
                degrees(direction.theta),
                degrees(direction.phi)
            )
        };
        format!(
            "{} {}",
            part('v', self.views[view]),
            part('l', self.lights[light])
        )
    }
}

/// Radians as degrees, without the digits that conversion adds.
pub(in crate::source) fn degrees(radians: f64) -> f64 {
    (radians.to_degrees() * PER_DEGREE).round() / PER_DEGREE
}

fn key([theta, phi]: Angles) -> Key {
    let theta = (theta * PER_DEGREE).round() as i64;
    let phi = (phi * PER_DEGREE).round() as i64;
    if theta == 0 {
        return (0, 0);
    }
    (theta, phi.rem_euclid((360.0 * PER_DEGREE) as i64))
}

/// The distinct directions in order, and the index of each.
fn axis(all: impl Iterator<Item = Angles>) -> (Vec<Direction>, BTreeMap<Key, usize>) {
    let mut distinct: BTreeMap<Key, Direction> = BTreeMap::new();
    for angles in all {
        let key = key(angles);
        distinct.entry(key).or_insert_with(|| Direction {
            theta: if key.0 == 0 { 0.0 } else { angles[0].to_radians() },
            phi: if key.1 == 0 {
                0.0
            } else {
                angles[1].rem_euclid(360.0).to_radians()
            },
        });
    }
    let directions = distinct.values().copied().collect();
    let indices = distinct
        .keys()
        .enumerate()
        .map(|(index, key)| (*key, index))
        .collect();
    (directions, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(file: usize, view: Angles, light: Angles) -> Placed {
        Placed { file, view, light }
    }

    #[test]
    fn directions_are_sorted_and_azimuths_wrap() {
        let grid = arrange(&[
            image(0, [30.0, 350.0], [0.0, 77.0]),
            image(1, [30.0, -20.0], [0.0, 0.0]),
            image(2, [30.0, 360.0], [0.0, 0.0]),
            image(3, [0.0, 90.0], [0.0, 0.0]),
        ]);
        assert_eq!(grid.lights, [Direction { theta: 0.0, phi: 0.0 }]);
        let views: Vec<_> = grid
            .views
            .iter()
            .map(|view| (degrees(view.theta), degrees(view.phi)))
            .collect();
        assert_eq!(views, [(0.0, 0.0), (30.0, 0.0), (30.0, 340.0), (30.0, 350.0)]);
        assert_eq!(grid.files, [Some(3), Some(2), Some(1), Some(0)]);
        assert!(grid.duplicates.is_empty());
        assert_eq!(grid.name((3, 0)), "tv30 pv350 tl0 pl0");
    }

    #[test]
    fn holes_and_duplicates_are_found() {
        let grid = arrange(&[
            image(0, [10.0, 0.0], [0.0, 0.0]),
            image(1, [10.0, 360.0], [0.0, 90.0]),
            image(2, [20.0, 0.0], [20.0, 0.0]),
        ]);
        assert_eq!(grid.duplicates, [(0, 1)]);
        assert_eq!(grid.holes().collect::<Vec<_>>(), [(0, 1), (1, 0)]);
    }
}
