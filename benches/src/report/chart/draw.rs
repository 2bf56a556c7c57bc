//! Panels, their titles and their legend through `plotters`.

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::Axis;
use super::labels::Labels;
use super::{GRID, INK, Panel, Series};
use crate::report::html::escape;

/// Places are whole numbers to `plotters`: the canvas has ten of them to a pixel.
const SCALE: i32 = 10;
/// Of a panel with titles, axes and room around it, pixels.
const PANEL: (f64, f64) = (480.0, 268.0);
/// From its left edge to its axis, pixels.
const LEFT: f64 = 62.0;
/// Beside titles and legend, pixels.
const MARGIN: f64 = 8.0;
/// A line of a title, and of the legend, pixels.
const LINE: f64 = 22.0;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Panels in rows of `columns`, below a title and the names of all series.
pub(crate) fn chart(title: &str, columns: usize, panels: &[Panel]) -> String {
    let columns = columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns);
    let legend = Legend::new(panels, PANEL.0 * columns as f64);
    let height = LINE + legend.height() + PANEL.1 * rows as f64;
    let (width, height) = (px(PANEL.0) * columns as i32, px(height));
    let mut svg = String::new();
    let canvas = SVGBackend::with_string(&mut svg, (width as u32, height as u32)).into_drawing_area();
    draw(&canvas, title, &legend, (rows, columns), panels).expect("strings take everything");
    drop(canvas);
    // The first line is the canvas: shown at its size in pixels, and with a title to those who do not see it.
    let drawn = svg.split_once('\n').map_or("", |(_, drawn)| drawn);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {width} {height}\" role=\"img\"><title>{}</title>\n{drawn}",
        width / SCALE,
        height / SCALE,
        escape(title),
    )
}

fn draw(
    canvas: &Area<'_>,
    title: &str,
    legend: &Legend<'_>,
    grid: (usize, usize),
    panels: &[Panel],
) -> Drawn {
    canvas.fill(&WHITE)?;
    heading(canvas, MARGIN, title)?;
    let (head, body) = canvas.split_vertically(px(LINE + legend.height()));
    legend.draw(&head)?;
    for (area, of) in body.split_evenly(grid).iter().zip(panels) {
        panel(area, of)?;
    }
    canvas.present()
}

fn panel(area: &Area<'_>, panel: &Panel) -> Drawn {
    heading(area, LEFT, &panel.title)?;
    let can_be_drawn = |&&(x, y): &&(f64, f64)| panel.x.place(x).and(panel.y.place(y)).is_some();
    let all = || {
        let points = panel.series.iter().flat_map(|series| &series.points);
        points.filter(can_be_drawn)
    };
    let axes =
        Axis::new(panel.x, all().map(|point| point.0)).zip(Axis::new(panel.y, all().map(|point| point.1)));
    let Some((x, y)) = axes else {
        return area.draw_text("nothing to draw", &text(11.0), (px(LEFT), px(60.0)));
    };
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(if panel.title.is_empty() { 8.0 } else { LINE + 4.0 }))
        .margin_right(px(18.0))
        .margin_bottom(px(8.0))
        .x_label_area_size(px(36.0))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .bold_line_style(GRID.stroke_width(px(1.0) as u32))
        .axis_style(GRID.stroke_width(px(1.0) as u32))
        .set_all_tick_mark_size(px(3.0))
        .label_style(text(11.0))
        .x_desc(&panel.x_name)
        .draw()?;
    let (left, top) = area.get_base_pixel();
    let place = |point: &(f64, f64)| {
        let (x, y) = chart.backend_coord(point);
        (x - left, y - top)
    };
    let places: Vec<Vec<_>> = panel
        .series
        .iter()
        .map(|series| series.points.iter().filter(can_be_drawn).map(place).collect())
        .collect();
    for (series, places) in panel.series.iter().zip(&places) {
        line(area, series, places)?;
    }
    for (series, places) in panel.series.iter().zip(&places) {
        circles(area, series, places)?;
    }
    if let Some(mark) = panel.mark.as_ref().filter(can_be_drawn) {
        area.draw(&Circle::new(
            place(mark),
            px(7.0),
            INK.stroke_width(px(1.5) as u32),
        ))?;
    }
    let (across, down) = chart.plotting_area().get_pixel_range();
    // Names may stand out a little, to where there are no ticks.
    let mut labels = Labels::new([
        pixels(across.start - left),
        pixels(across.end - left) + 16.0,
        pixels(down.start - top) - 12.0,
        pixels(down.end - top) + 5.0,
    ]);
    let both = |(x, y): (i32, i32)| (pixels(x), pixels(y));
    for (series, places) in panel.series.iter().zip(&places) {
        labels.points.extend(places.iter().copied().map(both));
        if series.width > 0.0 {
            labels
                .lines
                .extend(places.windows(2).map(|two| [both(two[0]), both(two[1])]));
        }
    }
    for (point, label) in panel
        .series
        .iter()
        .flat_map(|series| series.points.iter().zip(&series.labels))
    {
        if can_be_drawn(&point)
            && let Some((x, y, side)) = labels.place(both(place(point)), label)
        {
            let style = text(11.0).pos(Pos::new(side, VPos::Center));
            area.draw_text(label, &style, (px(x), px(y)))?;
        }
    }
    Ok(())
}

/// Samples and names of series, in columns.
struct Legend<'a> {
    series: Vec<&'a Series>,
    rows: usize,
    /// Of a column, pixels.
    wide: f64,
}

impl<'a> Legend<'a> {
    fn new(panels: &'a [Panel], width: f64) -> Self {
        let mut series: Vec<&Series> = Vec::new();
        for one in panels.iter().flat_map(|panel| &panel.series) {
            if !one.name.is_empty() && series.iter().all(|other| other.name != one.name) {
                series.push(one);
            }
        }
        let letters = series.iter().map(|series| series.name.chars().count()).max();
        let wide = 50.0 + 6.6 * letters.unwrap_or(0) as f64;
        let columns = ((width - MARGIN) / wide).max(1.0) as usize;
        Self {
            rows: series.len().div_ceil(columns),
            series,
            wide,
        }
    }

    fn height(&self) -> f64 {
        LINE * self.rows as f64
    }

    /// Below the title.
    fn draw(&self, area: &Area<'_>) -> Drawn {
        for (at, series) in self.series.iter().enumerate() {
            let x = MARGIN + self.wide * (at / self.rows) as f64;
            let y = px(LINE * (1.4 + (at % self.rows) as f64));
            line(area, series, &[(px(x), y), (px(x + 24.0), y)])?;
            circles(area, series, &[(px(x + 12.0), y)])?;
            let style = text(11.0).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw_text(&series.name, &style, (px(x + 30.0), y))?;
        }
        Ok(())
    }
}

fn line(area: &Area<'_>, series: &Series, places: &[(i32, i32)]) -> Drawn {
    let (style, points) = (
        series.colour.stroke_width(px(series.width) as u32),
        places.iter().copied(),
    );
    match (series.width > 0.0 && places.len() > 1, series.dashed) {
        (false, _) => Ok(()),
        (_, false) => area.draw(&PathElement::new(places, style)),
        (_, true) => area.draw(&DashedPathElement::new(points, px(5.0), px(4.0), style)),
    }
}

fn circles(area: &Area<'_>, series: &Series, places: &[(i32, i32)]) -> Drawn {
    if series.radius > 0.0 {
        for &place in places {
            let inside = if series.hollow { WHITE } else { series.colour };
            area.draw(&Circle::new(place, px(series.radius), inside.filled()))?;
            if series.hollow {
                area.draw(&Circle::new(
                    place,
                    px(series.radius),
                    series.colour.stroke_width(px(1.0) as u32),
                ))?;
            }
        }
    }
    Ok(())
}

/// At the top, smaller where it is long: bold letters are about six tenths as wide as high.
fn heading(area: &Area<'_>, left: f64, title: &str) -> Drawn {
    let room = pixels(area.dim_in_pixel().0 as i32) - left - MARGIN;
    let size = (room / (0.62 * title.chars().count().max(1) as f64)).min(13.0);
    let mut style = text(size);
    style.font = style.font.style(FontStyle::Bold);
    area.draw_text(title, &style, (px(left), px(6.0)))
}

fn text(size: f64) -> TextStyle<'static> {
    // `plotters` writes sizes divided by 1.24.
    FontDesc::new(
        FontFamily::SansSerif,
        size * 1.24 * f64::from(SCALE),
        FontStyle::Normal,
    )
    .color(&INK)
}

/// Pixels as places of the canvas.
fn px(pixels: f64) -> i32 {
    (pixels * f64::from(SCALE)).round() as i32
}

/// Places of the canvas as pixels.
fn pixels(places: i32) -> f64 {
    f64::from(places) / f64::from(SCALE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::chart::{BLUE, Scale};

    fn panel(points: Vec<(f64, f64)>) -> Panel {
        Panel {
            title: "a < b".into(),
            x_name: "MiB & more".into(),
            x: Scale::Log { least: None },
            y: Scale::Log { least: Some(1e-6) },
            series: vec![Series {
                labels: vec!["one < \"two\"".into()],
                dashed: true,
                radius: 2.5,
                ..Series::new("s > t", BLUE, points)
            }],
            mark: Some((1.0, f64::NAN)),
        }
    }

    #[test]
    fn odd_curves_do_not_break_a_chart() {
        for points in [
            vec![],
            vec![(1.0, 1.0)],
            vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, f64::INFINITY)],
            vec![(1.0, 0.0), (1e12, 1.0)],
            vec![(1e-300, 1e300), (1e300, 1.0)],
        ] {
            let drawn = points.iter().filter(|(x, y)| *x > 0.0 && y.is_finite()).count();
            for scale in [
                Scale::Log { least: None },
                Scale::Linear,
                Scale::FromZero,
                Scale::Count,
            ] {
                let x = Panel {
                    x: scale,
                    ..panel(points.clone())
                };
                let svg = chart("c & d", 1, &[x, panel(points.clone())]);
                assert!(
                    svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"),
                    "{svg}"
                );
                assert!(
                    svg.contains("<title>c &amp; d</title>")
                        && svg.contains("a &lt; b")
                        && svg.contains("s &gt; t")
                );
                let nothing = svg.matches("nothing to draw").count();
                assert!(nothing == 0 || drawn == 0, "{svg}");
                assert!(nothing > 0 || drawn > 0, "{svg}");
            }
        }
        assert!(chart("", 0, &[]).ends_with("</svg>\n"));
    }

    #[test]
    fn places_are_finer_than_pixels_and_titles_fit() {
        let long = "long ".repeat(60);
        let svg = chart(&long, 2, &[panel(vec![(1.0, 1.0), (2.0, 0.5)]), panel(vec![])]);
        assert!(
            svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"960\" height=\"312\" viewBox=\"0 0 9600 3120\" role=\"img\"><title>long "),
            "{svg}"
        );
        let size = svg
            .split("font-size=\"")
            .nth(1)
            .and_then(|rest| rest.split('"').next());
        let size: f64 = size.unwrap().parse().unwrap();
        assert!(size * 0.6 * long.len() as f64 <= 9600.0, "{size}");
    }
}
