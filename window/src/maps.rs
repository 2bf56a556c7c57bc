//! Maps of the page cache, slot by slot, and of a material's page tree, tile by tile.

use egui::{Color32, Rect, Response, Sense, Ui, Vec2};
use engine::{
    Overlay,
    frame::{CacheMap, PageTree},
};
use viewer::Viewer;

use crate::charts::COLORS;

/// Largest height of a map, points.
const MOST_HEIGHT: f32 = 160.0;
/// Cells smaller than this are not told apart, points.
const LEAST_CELL: f32 = 1.5;

/// Which colour a slot has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CacheColor {
    Material,
    Mip,
    Age,
}

/// The page cache: a cell a slot, in the order of the slots.
pub(crate) fn cache(ui: &mut Ui, viewer: &Viewer, color: CacheColor) {
    let map: CacheMap = viewer.engine().cache_map();
    let names: Vec<_> = viewer
        .report()
        .materials
        .iter()
        .map(|known| known.name.as_str())
        .collect();
    let free = ui.visuals().extreme_bg_color;
    let taken = map.pages.iter().flatten().count();
    ui.label(format!("{taken} of {} page slots", map.pages.len()));
    let (response, cells) = cells(ui, map.pages.len());
    for (slot, page) in map.pages.iter().enumerate() {
        let fill = match (page, color) {
            (None, _) => free,
            (Some(page), CacheColor::Material) => material_color(page.material),
            (Some(page), CacheColor::Mip) => rgb(Overlay::Mip.colour(f64::from(page.page.tile.mip))),
            (Some(page), CacheColor::Age) => rgb(Overlay::Age.colour(page.age as f64)),
        };
        ui.painter().rect_filled(cells.rect(slot), 0.0, fill);
    }
    if let Some(Some(page)) = cells.hovered(&response).and_then(|slot| map.pages.get(slot)) {
        let name = names.get(page.material).copied().unwrap_or("?");
        let pinned = if page.pinned { ", pinned" } else { "" };
        response.on_hover_text_at_pointer(format!("{name}: {}, {} frames old{pinned}", page.page, page.age));
    }
    if color == CacheColor::Material {
        ui.horizontal_wrapped(|ui| {
            for (material, name) in names.iter().enumerate().take(24) {
                ui.colored_label(material_color(material), *name);
            }
        });
    }
}

/// A page tree: the tiles of each mip, the brighter the more groups are resident.
pub(crate) fn tree(ui: &mut Ui, tree: &PageTree) {
    let columns = tree.columns.iter().filter(|resident| **resident).count();
    ui.label(format!("{columns} of {} columns", tree.groups));
    let groups = f64::from(tree.groups.max(1));
    ui.horizontal_wrapped(|ui| {
        for (mip, tiles) in tree.mips.iter().enumerate() {
            let most = tiles.columns.max(tiles.rows).max(1) as f32;
            let side = (96.0 / most).clamp(LEAST_CELL, 16.0);
            let size = Vec2::new(tiles.columns as f32, tiles.rows as f32) * side;
            ui.vertical(|ui| {
                ui.small(format!("mip {mip}"));
                let (response, painter) = ui.allocate_painter(size, Sense::hover());
                let origin = response.rect.min;
                for (at, resident) in tiles.resident.iter().enumerate() {
                    let (x, y) = (at as u32 % tiles.columns, at as u32 / tiles.columns);
                    let min = origin + Vec2::new(x as f32, y as f32) * side;
                    let rect = Rect::from_min_size(min, Vec2::splat(side)).shrink(side.min(4.0) * 0.06);
                    painter.rect_filled(rect, 0.0, shade(f64::from(*resident) / groups));
                }
                let pointed = response.hover_pos().map(|at| (at - origin) / side);
                if let Some(at) = pointed.map(|at| at.y as usize * tiles.columns as usize + at.x as usize)
                    && let Some(resident) = tiles.resident.get(at)
                {
                    response.on_hover_text_at_pointer(format!("{resident} of {} groups", tree.groups));
                }
            });
        }
    });
}

/// Cells in rows.
struct Cells {
    area: Rect,
    columns: usize,
    side: f32,
    count: usize,
}

/// Room for so many cells, as large as fit.
fn cells(ui: &mut Ui, count: usize) -> (Response, Cells) {
    let width = ui.available_width();
    let side = side(count, width);
    let columns = ((width / side) as usize).max(1);
    let height = count.div_ceil(columns) as f32 * side;
    let (response, _) = ui.allocate_painter(Vec2::new(width, height.min(MOST_HEIGHT)), Sense::hover());
    let area = response.rect;
    let cells = Cells {
        area,
        columns,
        side,
        count,
    };
    (response, cells)
}

/// Side of cells so that all have room.
fn side(count: usize, width: f32) -> f32 {
    let all = (width.max(1.0) * MOST_HEIGHT / count.max(1) as f32).sqrt();
    // Rows and columns are whole.
    let mut side = all.clamp(LEAST_CELL, 14.0);
    while side > LEAST_CELL {
        let columns = ((width / side) as usize).max(1);
        if count.div_ceil(columns) as f32 * side <= MOST_HEIGHT {
            break;
        }
        side = (side * 0.95).max(LEAST_CELL);
    }
    side
}

impl Cells {
    fn rect(&self, cell: usize) -> Rect {
        let (x, y) = ((cell % self.columns) as f32, (cell / self.columns) as f32);
        let min = self.area.min + Vec2::new(x, y) * self.side;
        // Lines between cells where there is room for them.
        let gap = if self.side > 4.0 { 1.0 } else { 0.0 };
        Rect::from_min_size(min, Vec2::splat(self.side - gap)).intersect(self.area)
    }

    fn hovered(&self, response: &Response) -> Option<usize> {
        let at = (response.hover_pos()? - self.area.min) / self.side;
        let (x, y) = (at.x as usize, at.y as usize);
        let cell = y * self.columns + x;
        (x < self.columns && cell < self.count).then_some(cell)
    }
}

/// Colours of materials come again where there are many.
fn material_color(material: usize) -> Color32 {
    let color = COLORS[material % COLORS.len()];
    // Darker with every round.
    let round = 1.0 / (1.0 + 0.35 * (material / COLORS.len()) as f32);
    color.gamma_multiply(round).to_opaque()
}

/// From nothing (dark) to everything.
fn shade(share: f64) -> Color32 {
    if share <= 0.0 {
        return Color32::from_gray(40);
    }
    // The scale of components ends at 63 groups.
    rgb(Overlay::Components.colour(share * 63.0))
}

fn rgb([r, g, b]: [u8; 3]) -> Color32 {
    Color32::from_rgb(r, g, b)
}

#[cfg(test)]
mod tests {
    use egui::pos2;

    use super::*;

    fn cells_of(count: usize, width: f32) -> Cells {
        let side = side(count, width);
        let columns = ((width / side) as usize).max(1);
        Cells {
            area: Rect::from_min_size(pos2(0.0, 0.0), Vec2::new(width, MOST_HEIGHT)),
            columns,
            side,
            count,
        }
    }

    #[test]
    fn all_cells_have_room_as_long_as_they_can_be_told_apart() {
        for count in [1, 7, 100, 1000, 9000] {
            let cells = cells_of(count, 290.0);
            let last = cells.rect(count - 1);
            assert!(cells.area.contains_rect(last), "{count}: {last:?}");
            assert!(last.width() > 1.0);
        }
        // More are cut off, and none is outside.
        let many = cells_of(1_000_000, 290.0);
        assert!(many.rect(999_999).is_negative() || many.area.contains_rect(many.rect(999_999)));
    }
}
