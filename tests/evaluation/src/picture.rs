//! A picture of an environment: every path over the map, with what each side took for the rules' regions.
//!
//! As the paper's Figs. 3 and 7: our region is blue, that of Safe-Lang purple; what stands in the scene is drawn from
//! the scene itself, paths are what was really driven.

use std::path::Path;

use anyhow::Context;
use heedway_cli::drawing::{self, Map, Outline, bounds, cell_box, use_fonts};
use heedway_simulator::scene::Scene;
use plotters::coord::Shift;
use plotters::prelude::*;
use proto::CellSet;

use crate::condition::Method;
use crate::trace::Trace;

/// Width of the picture, pixels.
const WIDTH_PX: u32 = 1200;
/// Highest map, pixels.
const MAP_HEIGHT_PX_MAX: f64 = 1200.0;
/// Height of the legend, pixels.
const LEGEND_HEIGHT_PX: u32 = 76;
/// Room for caption and axes around the map, pixels: along x, along y.
const FRAME_PX: (u32, u32) = (86, 108);
/// How much is shown around the floor, metres.
const BORDER_M: f64 = 0.2;

const OURS: RGBColor = RGBColor(31, 99, 210);
const BOXES: RGBColor = RGBColor(148, 80, 190);

/// The runs of one method in one environment.
pub struct Runs {
    /// Who kept the rules.
    pub method: Method,
    /// Each run, with whether it was a success.
    pub runs: Vec<(Trace, bool)>,
}

/// The colour of a method, in every picture and chart.
#[must_use]
pub fn colour(method: Method) -> RGBColor {
    match method {
        Method::SmoothBlending => RGBColor(34, 139, 34),
        Method::LeastRestrictive => RGBColor(0, 160, 170),
        Method::SafeGeom => RGBColor(214, 39, 40),
        Method::SafeLang => BOXES,
        Method::PaperLiteral => RGBColor(235, 140, 20),
    }
}

/// Draws an environment and writes it as PNG.
///
/// # Errors
/// When the file cannot be written.
pub fn write(file: &Path, scene: &Scene, caption: &str, all: &[Runs]) -> anyhow::Result<()> {
    use_fonts()?;
    let (low, high) = bounds(scene);
    let (width_m, height_m) = (high.x - low.x + 2.0 * BORDER_M, high.y - low.y + 2.0 * BORDER_M);
    // One metre is as long along y as along x.
    let px_per_m = (f64::from(WIDTH_PX - FRAME_PX.0) / width_m).min(MAP_HEIGHT_PX_MAX / height_m);
    let width = (px_per_m * width_m).round() as u32 + FRAME_PX.0;
    let map_height = (px_per_m * height_m).round() as u32 + FRAME_PX.1;
    let height = map_height + LEGEND_HEIGHT_PX;
    let mut pixels = vec![255_u8; width as usize * height as usize * 3];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let (map, legend) = root.split_vertically(map_height);
        let (x, y) = (low.x - BORDER_M..high.x + BORDER_M, low.y - BORDER_M..high.y + BORDER_M);
        let mut chart = drawing::map(&map, (caption, 24), (x, y))?;
        draw_walls(&mut chart, scene)?;
        drawing::draw_scene(&mut chart, scene)?;
        for (method, colour) in [(Method::SafeLang, BOXES), (Method::SmoothBlending, OURS)] {
            let first = all.iter().find(|runs| runs.method == method).and_then(|runs| runs.runs.first());
            for region in first.map_or(&[][..], |(trace, _)| trace.regions.as_slice()) {
                draw_region(&mut chart, region, colour)?;
            }
        }
        for runs in all {
            draw_paths(&mut chart, runs)?;
        }
        draw_ends(&mut chart, scene)?;
        draw_legend(&legend, all)?;
        root.present()?;
    }
    let image = image::RgbImage::from_raw(width, height, pixels).context("picture of odd size")?;
    image.save_with_format(file, image::ImageFormat::Png).with_context(|| format!("write {}", file.display()))
}

fn draw_walls(chart: &mut Map<'_>, scene: &Scene) -> anyhow::Result<()> {
    let walls = scene.walls.iter().flat_map(drawing::solid_outlines);
    chart.draw_series(walls.map(|wall: Outline| Polygon::new(wall, RGBColor(70, 70, 70).filled())))?;
    Ok(())
}

fn draw_region(chart: &mut Map<'_>, region: &CellSet, colour: RGBColor) -> anyhow::Result<()> {
    let (x, y) = (chart.x_range(), chart.y_range());
    let style = colour.mix(0.35).filled();
    let is_shown = |[low, high]: &[(f64, f64); 2]| {
        low.0 >= x.start && high.0 <= x.end && low.1 >= y.start && high.1 <= y.end
    };
    let marked = region.unpack().into_iter().enumerate().filter(|(_, on)| *on);
    let boxes = marked.map(|(idx, _)| cell_box(&region.layout, idx)).filter(is_shown);
    chart.draw_series(boxes.map(|corners| Rectangle::new(corners, style)))?;
    Ok(())
}

fn draw_paths(chart: &mut Map<'_>, runs: &Runs) -> anyhow::Result<()> {
    let style = colour(runs.method).stroke_width(2);
    for (trace, is_success) in &runs.runs {
        let path: Vec<(f64, f64)> = trace.path_map.iter().map(|[x, y]| (*x, *y)).collect();
        let end = path.last().copied();
        if runs.method == Method::SafeGeom {
            chart.draw_series(DashedLineSeries::new(path, 10, 6, style))?;
        } else {
            chart.draw_series(LineSeries::new(path, style))?;
        }
        if !is_success {
            chart.draw_series(end.map(|end| Cross::new(end, 7, style)))?;
        }
    }
    Ok(())
}

fn draw_ends(chart: &mut Map<'_>, scene: &Scene) -> anyhow::Result<()> {
    let (start, goal) = (scene.map_from_start.position(), scene.goal_map);
    for (point, name) in [(start, "start"), (goal, "goal")] {
        chart.draw_series([EmptyElement::at((point.x, point.y))
            + Circle::new((0, 0), 6, BLACK.filled())
            + Text::new(name, (8, 10), ("sans-serif", 18))])?;
    }
    Ok(())
}

fn draw_legend(area: &DrawingArea<BitMapBackend<'_>, Shift>, all: &[Runs]) -> anyhow::Result<()> {
    let column = i32::try_from(area.dim_in_pixel().0).unwrap_or(i32::MAX) / 5;
    let font = || ("sans-serif", 17).into_font();
    for (idx, runs) in (0_i32..).zip(all) {
        let (left, y) = (column * idx + 24, 20);
        let style = colour(runs.method).filled();
        area.draw(&Rectangle::new([(left, y - 2), (left + 30, y + 2)], style))?;
        let n_good = runs.runs.iter().filter(|(_, is_success)| *is_success).count();
        let words = format!("{} {n_good}/{}", runs.method.word(), runs.runs.len());
        area.draw(&Text::new(words, (left + 38, y - 9), font()))?;
    }
    for (idx, (words, colour)) in (0_i32..).zip([("our region", OURS), ("Safe-Lang's region", BOXES)]) {
        let (left, y) = (column * idx + 24, 52);
        area.draw(&Rectangle::new([(left, y - 8), (left + 30, y + 8)], colour.mix(0.35).filled()))?;
        area.draw(&Text::new(words, (left + 38, y - 9), font()))?;
    }
    let words = "n/m: successes of trials; a cross: where a run that was none ended";
    area.draw(&Text::new(words, (column * 2 + 24, 43), font()))?;
    Ok(())
}
