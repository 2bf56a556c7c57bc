//! How many component groups matter in each tile, for an error that a pixel may have.
//!
//! The weights of pages are mean squared reflectances that each adds to its parent, and orthogonal from mip to mip and
//! from component to component. So the energy of a group over a tile is the sum of the weights of the tile and its
//! ancestors, and what trailing groups make together is the mean squared error of leaving them out. It is a mean over
//! the tile, and over its ancestors for their part: exact for the material as a whole.

use tileset::archive::Index;

/// By tile and then group: the mean square of what the group shows of the tile with all pages there, in reflectance. What a
/// directory does not have counts as without bound.
pub fn energies(index: &Index) -> Vec<f64> {
    let (pyramid, groups) = (&index.pyramid, usize::from(index.manifest.groups() as u16));
    let tiles = pyramid.tile_count() as usize;
    // Of parents before their children.
    let mut energy = vec![0f64; tiles * groups];
    for (at, tile) in pyramid.tiles().enumerate() {
        let parent = pyramid.parent(tile).and_then(|parent| pyramid.tile_index(parent));
        for group in 0..groups {
            let inherited = parent.map_or(0.0, |parent| energy[parent as usize * groups + group]);
            let own = index
                .pages()
                .get(group * tiles + at)
                .map(|record| f64::from(record.weight));
            let own = own.filter(|own| *own >= 0.0).unwrap_or(f64::INFINITY);
            energy[at * groups + group] = inherited + own;
        }
    }
    energy
}

/// By tile index: the least number of leading groups, at least one, so that all others together make a root mean square
/// reflectance of at most `error` over the tile. With an error of 0 those remain that have any energy at all.
pub fn groups_that_matter(index: &Index, error: f64) -> Vec<u16> {
    let groups = usize::from(index.manifest.groups() as u16);
    let matter = |energy: &[f64]| {
        let mut left_out = 0.0;
        let trailing = energy.iter().rev().take_while(|&&energy| {
            left_out += energy;
            left_out <= error * error
        });
        (groups - trailing.count()).max(1) as u16
    };
    energies(index).chunks_exact(groups.max(1)).map(matter).collect()
}
