//! The picture that the demonstration leaves: both paths over the map, and how fast they were driven.
//!
//! Red and dashed without the words, green with them; the region that the robot found for the rule is
//! blue. What stands in the room is drawn from the scene, everything else from what the robot published.

use std::path::Path;

use anyhow::Context;
use geometry::Point2;
use heedway_simulator::scene::Scene;
use plotters::prelude::*;
use proto::{BaseMap, CellSet};

use super::record::Record;
use crate::drawing::{self, Map, cell_box};

/// Width of the picture, pixels.
const WIDTH_PX: u32 = 1200;
/// Highest map, pixels; a narrow, long room is drawn smaller.
const MAP_HEIGHT_PX_MAX: f64 = 1400.0;
/// Height of the speed panel, pixels.
const SPEED_HEIGHT_PX: u32 = 300;
/// Height of the legend between map and speed panel, pixels.
const LEGEND_HEIGHT_PX: u32 = 44;
/// Room for caption and axes around the map, pixels: along x, along y.
const FRAME_PX: (u32, u32) = (86, 108);
/// How much is shown around the floor, metres.
const BORDER_M: f64 = 0.3;
/// Most characters of the words that are shown.
const N_WORDS_CHARS: usize = 80;

const WITHOUT: RGBColor = RGBColor(214, 39, 40);
const WITH: RGBColor = RGBColor(34, 139, 34);
const REGION: RGBColor = RGBColor(31, 99, 210);
const OCCUPIED: RGBColor = RGBColor(70, 70, 70);
const UNKNOWN: RGBColor = RGBColor(214, 214, 214);

/// Draws the picture and writes it as PNG.
///
/// # Errors
/// When the file cannot be written.
pub fn write(file: &Path, scene: &Scene, words: &str, without: &Record, with: &Record) -> anyhow::Result<()> {
    drawing::use_fonts()?;
    let (low, high) = drawing::bounds(scene);
    let (width_m, height_m) = (high.x - low.x + 2.0 * BORDER_M, high.y - low.y + 2.0 * BORDER_M);
    // One metre is as long along y as along x.
    let px_per_m = (f64::from(WIDTH_PX - FRAME_PX.0) / width_m).min(MAP_HEIGHT_PX_MAX / height_m);
    let map_width = (px_per_m * width_m).round() as u32 + FRAME_PX.0;
    let map_height = (px_per_m * height_m).round() as u32 + FRAME_PX.1;
    let (width, height) = (map_width, map_height + LEGEND_HEIGHT_PX + SPEED_HEIGHT_PX);

    let mut pixels = vec![255_u8; width as usize * height as usize * 3];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let (map_area, rest) = root.split_vertically(map_height);
        let (legend_area, speed_area) = rest.split_vertically(LEGEND_HEIGHT_PX);
        draw_map(&map_area, scene, words, without, with)?;
        draw_legend(&legend_area)?;
        draw_speeds(&speed_area, without, with)?;
        root.present()?;
    }
    let image = image::RgbImage::from_raw(width, height, pixels).context("picture of odd size")?;
    image.save_with_format(file, image::ImageFormat::Png)?;
    Ok(())
}

fn draw_map(
    area: &DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>,
    scene: &Scene,
    words: &str,
    without: &Record,
    with: &Record,
) -> anyhow::Result<()> {
    let (low, high) = drawing::bounds(scene);
    let (x, y) = (low.x - BORDER_M..high.x + BORDER_M, low.y - BORDER_M..high.y + BORDER_M);
    let shown: String = words.chars().take(N_WORDS_CHARS).collect();
    let mut chart = drawing::map(area, (&format!("“{shown}”"), 26), (x, y))?;
    draw_base_map(&mut chart, [without, with], (low, high))?;
    drawing::draw_scene(&mut chart, scene)?;
    draw_regions(&mut chart, with)?;
    draw_paths(&mut chart, scene, without, with)?;
    Ok(())
}

/// What the robot knows of the floor: unknown grey, free white, occupied dark; of both runs together.
fn draw_base_map(chart: &mut Map<'_>, records: [&Record; 2], bounds: (Point2, Point2)) -> anyhow::Result<()> {
    let (low, high) = bounds;
    let border = [(low.x - BORDER_M, low.y - BORDER_M), (high.x + BORDER_M, high.y + BORDER_M)];
    chart.draw_series([Rectangle::new(border, UNKNOWN.filled())])?;
    let maps: Vec<&BaseMap> = records.iter().filter_map(|record| record.base_map.as_ref()).collect();
    // What one run found occupied is drawn over what the other one found free.
    for (state, colour) in [(1_u8, WHITE), (2, OCCUPIED)] {
        for map in &maps {
            let cells = map.cells.iter().enumerate().filter(|(_, cell)| **cell == state);
            chart.draw_series(
                cells.map(|(idx, _)| Rectangle::new(cell_box(&map.layout, idx), colour.filled())),
            )?;
        }
    }
    Ok(())
}

/// The regions that the robot found for its rules.
fn draw_regions(chart: &mut Map<'_>, with: &Record) -> anyhow::Result<()> {
    let style = REGION.mix(0.45).filled();
    let found: Vec<&CellSet> = with.regions.values().filter_map(|map| map.region.as_ref()).collect();
    let boxes = found.iter().flat_map(|region| {
        let occupied = region.unpack().into_iter().enumerate().filter(|(_, on)| *on);
        occupied.map(|(idx, _)| Rectangle::new(cell_box(&region.layout, idx), style)).collect::<Vec<_>>()
    });
    chart.draw_series(boxes)?;
    Ok(())
}

fn draw_paths(chart: &mut Map<'_>, scene: &Scene, without: &Record, with: &Record) -> anyhow::Result<()> {
    let path = |record: &Record| -> Vec<(f64, f64)> {
        record.moments.iter().map(|m| (m.map_from_base.x_m, m.map_from_base.y_m)).collect()
    };
    let (red, green) = (WITHOUT.stroke_width(4), WITH.stroke_width(4));
    chart.draw_series(DashedLineSeries::new(spaced(path(without)), 12, 8, red))?;
    chart.draw_series(LineSeries::new(path(with), green))?;
    let start = scene.map_from_start.position();
    let goal = scene.goal_map;
    for (point, name, colour) in [(start, "start", BLACK), (goal, "goal", RGBColor(200, 120, 0))] {
        let style = colour.filled();
        chart.draw_series([EmptyElement::at((point.x, point.y))
            + Circle::new((0, 0), 7, style)
            + Text::new(name, (10, 10), ("sans-serif", 19).into_font().color(&colour))])?;
    }
    Ok(())
}

/// What the colours mean, in a row.
fn draw_legend(area: &DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>) -> anyhow::Result<()> {
    let width = i32::try_from(area.dim_in_pixel().0).unwrap_or(i32::MAX);
    let (column, middle) = (width / 4, LEGEND_HEIGHT_PX as i32 / 2);
    let swatch = |idx: i32| (column * idx + 30, column * idx + 66);
    for (idx, words) in ["without the words", "with the words", "the rule's region, as found", "not seen yet"]
        .into_iter()
        .enumerate()
    {
        let (_, right) = swatch(idx as i32);
        area.draw(&Text::new(words, (right + 10, middle - 9), ("sans-serif", 18)))?;
    }
    let (left, right) = swatch(0);
    for dash in (left..right).step_by(14) {
        area.draw(&Rectangle::new([(dash, middle - 2), (dash + 8, middle + 2)], WITHOUT.filled()))?;
    }
    let (left, right) = swatch(1);
    area.draw(&Rectangle::new([(left, middle - 2), (right, middle + 2)], WITH.filled()))?;
    let (left, right) = swatch(2);
    area.draw(&Rectangle::new([(left, middle - 8), (right, middle + 8)], REGION.mix(0.45).filled()))?;
    let (left, right) = swatch(3);
    area.draw(&Rectangle::new([(left, middle - 8), (right, middle + 8)], UNKNOWN.filled()))?;
    Ok(())
}

/// Points far enough apart for dashes: those of a robot at rest would all be drawn into one.
fn spaced(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for (x, y) in points {
        if kept.last().is_none_or(|(a, b)| (x - a).hypot(y - b) > 0.02) {
            kept.push((x, y));
        }
    }
    kept
}

fn draw_speeds(
    area: &DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>,
    without: &Record,
    with: &Record,
) -> anyhow::Result<()> {
    let end_s = without.time_s().max(with.time_s()).max(1.0);
    let speeds = |record: &Record| -> Vec<(f64, f64)> {
        record.moments.iter().map(|moment| (moment.time_s, moment.twist.speed_m_s)).collect()
    };
    let fastest = speeds(without).into_iter().chain(speeds(with)).map(|(_, speed)| speed).fold(0.1, f64::max);
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .margin_right(18)
        .x_label_area_size(46)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..end_s, 0.0..1.1 * fastest)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("time since the goal was given (s)")
        .y_desc("speed (m/s)")
        .label_style(("sans-serif", 16))
        .axis_desc_style(("sans-serif", 17))
        .draw()?;
    let dashed = DashedLineSeries::new(speeds(without), 12, 8, WITHOUT.stroke_width(3));
    chart.draw_series(dashed)?;
    chart.draw_series(LineSeries::new(speeds(with), WITH.stroke_width(3)))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::judge::Judge;
    use super::super::record::Moment;
    use super::*;
    use geometry::{Pose2, Twist};
    use heedway_simulator::scene::Hull;
    use proto::{GridLayout, Grounding, Header, ObjectMap};

    fn office() -> Scene {
        let hull = Hull { radius_m: 0.25, height_m: 0.45 };
        Scene::parse("office.json", crate::fleet::OFFICE_SCENE, &|_| Err("no mesh".into()), hull).unwrap()
    }

    /// A drive from the start to the goal, past a point aside by `aside_m`.
    fn record(name: &'static str, aside_m: f64) -> Record {
        let mut record = Record::new(name, Judge::default());
        let scene = office();
        let (start, goal) = (scene.map_from_start.position(), scene.goal_map);
        record.moments = (0..=100)
            .map(|n| {
                let share = f64::from(n) / 100.0;
                let straight = start + (goal - start) * share;
                let bump = (share * std::f64::consts::PI).sin();
                Moment {
                    time_s: 10.0 * share,
                    map_from_base: Pose2::new(straight.x, straight.y + aside_m * bump, 0.0),
                    twist: Twist::new(bump, 0.0),
                }
            })
            .collect();
        let layout =
            GridLayout { origin_map: Point2::new(0.0, 0.0), resolution_m: 0.05, n_cols: 160, n_rows: 120 };
        let centre = |idx: usize| {
            let [(x, y), _] = cell_box(&layout, idx);
            Pose2::new(x + 0.025, y + 0.025, 0.0).position()
        };
        let cells = (0..layout.n_cells()).map(|idx| u8::from(scene.floor.contains(centre(idx))));
        let header = Header::default();
        record.base_map = Some(BaseMap { header, map_epoch: 1, layout, cells: cells.collect() });
        let desk: Vec<bool> = (0..layout.n_cells())
            .map(|idx| (centre(idx).x - 4.0).abs() < 0.4 && (centre(idx).y - 3.4).abs() < 0.8)
            .collect();
        let region = ObjectMap {
            header,
            map_epoch: 1,
            rule_id: "s1".into(),
            grounding: Grounding::Grounded,
            region: Some(CellSet::pack(layout, &desk)),
            remark: String::new(),
        };
        record.regions.insert("s1".into(), region);
        record
    }

    #[test]
    fn the_picture_shows_both_paths_and_the_region() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("picture.png");
        let (without, with) = (record("without", 0.0), record("with", -2.0));
        write(&file, &office(), "Don't go under the standing desk", &without, &with).unwrap();
        let picture = image::open(&file).unwrap().to_rgb8();
        let n_of =
            |wanted: RGBColor| picture.pixels().filter(|p| p.0 == [wanted.0, wanted.1, wanted.2]).count();
        assert!(n_of(WITH) > 1000, "{} green pixels", n_of(WITH));
        assert!(n_of(WITHOUT) > 1000, "{} red pixels", n_of(WITHOUT));
        let is_blue = |[r, g, b]: [u8; 3]| b > r.saturating_add(60) && b > g.saturating_add(30);
        let blueish = picture.pixels().filter(|p| is_blue(p.0)).count();
        assert!(blueish > 5000, "{blueish} blue pixels");
    }

    #[test]
    fn a_run_in_which_nothing_happened_can_be_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("picture.png");
        let empty = || Record::new("without", Judge::default());
        write(&file, &office(), "", &empty(), &empty()).unwrap();
        assert!(file.exists());
    }
}
