//! Bar charts of a suite, as the paper's Fig. 4: rates by kind of instruction and method.

use std::path::Path;

use anyhow::Context;
use heedway_cli::drawing::use_fonts;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::condition::Method;
use crate::outcome::{Line, Outcome};
use crate::picture::colour;
use crate::summary::{KINDS, kind_of};

/// Size of the chart, pixels.
const SIZE_PX: (u32, u32) = (1200, 1080);
/// Height of the legend, pixels.
const LEGEND_HEIGHT_PX: u32 = 50;

/// Whether a trial counts in a panel.
type Counts = fn(&Line) -> bool;

/// One panel for each of these.
const PANELS: [(&str, Counts); 4] = [
    ("success (%)", |l| l.outcome == Outcome::Success),
    ("semantic safety (%)", |l| l.violation_s <= 0.0),
    ("time-out: perception (%)", |l| l.outcome == Outcome::TimeoutPerception),
    ("time-out: safety filter (%)", |l| l.outcome == Outcome::TimeoutFilter),
];

/// Draws the chart of trials of one condition, and writes it as PNG.
///
/// # Errors
/// When the file cannot be written.
pub fn write(file: &Path, caption: &str, lines: &[&Line]) -> anyhow::Result<()> {
    use_fonts()?;
    let (width, height) = SIZE_PX;
    let mut methods: Vec<Method> = lines.iter().map(|l| l.method).collect();
    methods.sort_unstable();
    methods.dedup();
    let mut pixels = vec![255_u8; width as usize * height as usize * 3];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, SIZE_PX).into_drawing_area();
        root.fill(&WHITE)?;
        let titled = root.titled(caption, ("sans-serif", 26))?;
        let (_, below) = titled.dim_in_pixel();
        let (panels, legend) = titled.split_vertically(below.saturating_sub(LEGEND_HEIGHT_PX));
        for (area, (name, counts)) in panels.split_evenly((PANELS.len(), 1)).iter().zip(PANELS) {
            draw_panel(area, name, counts, lines, &methods)?;
        }
        draw_legend(&legend, &methods)?;
        root.present()?;
    }
    let image = image::RgbImage::from_raw(width, height, pixels).context("chart of odd size")?;
    image.save_with_format(file, image::ImageFormat::Png).with_context(|| format!("write {}", file.display()))
}

fn draw_panel(
    area: &DrawingArea<BitMapBackend<'_>, Shift>,
    name: &str,
    counts: Counts,
    lines: &[&Line],
    methods: &[Method],
) -> anyhow::Result<()> {
    let n_kinds = KINDS.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .x_label_area_size(28)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..n_kinds, 0.0..108.0)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(0)
        .y_labels(6)
        .y_desc(name)
        .label_style(("sans-serif", 15))
        .axis_desc_style(("sans-serif", 16))
        .draw()?;
    let bar = 0.8 / methods.len().max(1) as f64;
    for (kind_idx, kind) in KINDS.iter().enumerate() {
        let left = kind_idx as f64 + 0.1;
        for (idx, &method) in methods.iter().enumerate() {
            let of: Vec<_> = lines.iter().filter(|l| l.method == method && kind_of(l) == *kind).collect();
            if of.is_empty() {
                continue;
            }
            let n = of.iter().filter(|l| counts(l)).count();
            let share = 100.0 * n as f64 / of.len() as f64;
            let x = left + bar * idx as f64;
            let corners = [(x, 0.0), (x + 0.92 * bar, share.max(0.6))];
            chart.draw_series([Rectangle::new(corners, colour(method).filled())])?;
        }
        let at = (kind_idx as f64 + 0.5, 0.0);
        let label = kind.replace('_', " ");
        let half_px = i32::try_from(label.len() * 4).unwrap_or(0);
        chart.draw_series([EmptyElement::at(at) + Text::new(label, (-half_px, 8), ("sans-serif", 16))])?;
    }
    Ok(())
}

fn draw_legend(area: &DrawingArea<BitMapBackend<'_>, Shift>, methods: &[Method]) -> anyhow::Result<()> {
    let column = i32::try_from(area.dim_in_pixel().0).unwrap_or(i32::MAX) / 5;
    for (idx, &method) in (0_i32..).zip(methods) {
        let left = column * idx + 24;
        area.draw(&Rectangle::new([(left, 14), (left + 24, 30)], colour(method).filled()))?;
        area.draw(&Text::new(method.word(), (left + 34, 13), ("sans-serif", 18)))?;
    }
    Ok(())
}
