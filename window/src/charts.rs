//! Courses of figures over the last frames, as lines.

use egui::{Align2, Color32, FontId, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, Vec2, pos2};

/// Height of a chart, points.
const HEIGHT: f32 = 56.0;

/// A line of a chart.
pub(crate) struct Line<'a> {
    pub(crate) name: &'a str,
    pub(crate) color: Color32,
    pub(crate) values: Vec<f64>,
}

/// Colours that can be told apart with any colour vision, from the palette of Okabe and Ito: Color Universal Design, 2008.
pub(crate) const COLORS: [Color32; 7] = [
    Color32::from_rgb(86, 180, 233),
    Color32::from_rgb(230, 159, 0),
    Color32::from_rgb(0, 158, 115),
    Color32::from_rgb(240, 228, 66),
    Color32::from_rgb(204, 121, 167),
    Color32::from_rgb(213, 94, 0),
    Color32::from_rgb(0, 114, 178),
];

/// Draws lines over each other from 0 to the largest value; `format` writes values.
pub(crate) fn chart(ui: &mut Ui, title: &str, lines: &[Line<'_>], format: impl Fn(f64) -> String) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 6.0;
        ui.strong(title);
        for line in lines {
            let last = line.values.last().copied().unwrap_or(0.0);
            let name = if line.name.is_empty() {
                String::new()
            } else {
                // Not to be parted from its number.
                format!("{}\u{a0}", line.name)
            };
            ui.colored_label(line.color, format!("{name}{}", format(last)));
        }
    });
    let size = Vec2::new(ui.available_width(), HEIGHT);
    let (response, painter) = ui.allocate_painter(size, Sense::hover());
    let rect = response.rect;
    let visuals = ui.visuals();
    painter.rect_filled(rect, 2.0, visuals.extreme_bg_color);
    painter.rect_stroke(
        rect,
        2.0,
        visuals.widgets.noninteractive.bg_stroke,
        StrokeKind::Inside,
    );
    let values = || lines.iter().flat_map(|line| &line.values).copied();
    let most = values().filter(|value| value.is_finite()).fold(0.0, f64::max);
    for line in lines {
        let points = points(&line.values, most, rect.shrink(3.0));
        if points.len() > 1 {
            painter.line(points, Stroke::new(1.2, line.color));
        }
    }
    let font = FontId::proportional(10.0);
    painter.text(
        rect.left_top() + Vec2::new(4.0, 2.0),
        Align2::LEFT_TOP,
        format(most),
        font,
        visuals.weak_text_color(),
    );
}

/// From the left edge to the right, and from 0 at the bottom to `most` at the top.
fn points(values: &[f64], most: f64, rect: Rect) -> Vec<Pos2> {
    let steps = values.len().saturating_sub(1).max(1) as f32;
    let height = |value: f64| {
        let share = if most > 0.0 && value.is_finite() {
            value / most
        } else {
            0.0
        };
        rect.bottom() - rect.height() * share.clamp(0.0, 1.0) as f32
    };
    let point =
        |(at, value): (usize, &f64)| pos2(rect.left() + rect.width() * at as f32 / steps, height(*value));
    values.iter().enumerate().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_in_their_chart() {
        let rect = Rect::from_min_size(Pos2::ZERO, Vec2::new(100.0, 50.0));
        let drawn = points(&[0.0, 1.0, 2.0, f64::NAN, -3.0], 2.0, rect);
        assert_eq!((drawn[0], drawn[2]), (pos2(0.0, 50.0), pos2(50.0, 0.0)));
        assert!(drawn.iter().all(|point| rect.contains(*point)));
        assert!(points(&[], 0.0, rect).is_empty());
        assert_eq!(points(&[5.0], 0.0, rect), [pos2(0.0, 50.0)]);
    }
}
