//! Bounds for all samples of a round at once: which of them can be the best.
//!
//! Looks at the layers nearest to the start only. Deliberately not here: what a sample is worth (`score`), the
//! loops (`fast::rollouts`).

use geometry::Point2;
use mapping::DistanceField;

use super::{FIELD_SLOPE, Runner, Search};
use crate::dynamics::Control;
use crate::fast::rollouts::{Drawn, From, Ground, Hits, Motion, N_STEPS_MAX, ROUNDING_M, Rollouts};
use crate::noise::Noise;
use crate::scene::{Assumptions, Scene, Shape};

/// Most layers that are looked at, the nearest: those that are left out make exact rollouts of what they rule out.
const N_LAYERS: usize = 4;
/// Most fields among them.
const N_FIELDS: usize = 3;
/// Most points that are looked at around each of two places.
const N_POINTS: usize = 12;
/// Below a limit by this is within it for sure, m/s and rad: what f32 may take.
const LIMIT_ROUNDING: f64 = 1e-4;
/// Farthest that motions may lead, cells: f32 counts so far well enough.
const N_CELLS_MAX: f64 = 1024.0;

/// Room for bounds, kept from one round to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bounds {
    held: Vec<[f32; 2]>,
    points: Vec<[f32; 2]>,
    kept_m: Vec<f32>,
}

impl Bounds {
    /// Bounds the samples of a round around an incumbent, of which only those count that keep more than `floor_m`.
    pub(crate) fn find(
        &mut self,
        scene: &Scene<'_>,
        search: &Search,
        (noise, round): (&mut Noise, usize),
        runner: &Runner,
        incumbent: &[Control],
        floor_m: f64,
    ) {
        let Bounds { held, points, kept_m } = self;
        let Assumptions { step_s, radius_m, .. } = scene.assumptions;
        let turn_and_gain =
            |c: &Control| [(c.yaw_rate_rad_s * step_s) as f32, (c.accel_m_s2 * step_s) as f32];
        held.clear();
        held.extend(incumbent.iter().take(N_STEPS_MAX).map(turn_and_gain));
        kept_m.clear();
        kept_m.resize(search.n_samples, f32::INFINITY);
        let around = Around::look(scene, runner, held.len(), points);
        noise.isa().run(Rollouts {
            motion: motion(scene),
            from: From {
                sin: runner.sin as f32,
                cos: runner.cos as f32,
                speed_m_s: runner.speed_m_s as f32,
                kept_m: runner.kept_m as f32,
                here_m: runner.here_m as f32,
                tube_m: scene.tube_m(runner.start_m_s, runner.moving_s, runner.path_m) as f32,
            },
            grounds: &around.grounds[..around.n_fields],
            hits: Hits { points, keep_m: radius_m as f32, n_far: around.n_far_hits },
            drawn: Drawn { held, draws: noise.steps_of(round), scale: turn_and_gain(&search.sigma) },
            n: search.n_samples,
            floor_m: (floor_m - ROUNDING_M) as f32,
            kept_m,
        });
    }

    /// The most that a sample can keep, metres.
    #[inline]
    pub(crate) fn most_m(&self, sample: usize) -> f64 {
        self.kept_m.get(sample).map_or(f64::INFINITY, |kept_m| f64::from(*kept_m) + ROUNDING_M)
    }

    /// The sample whose bound is highest.
    pub(super) fn highest(&self) -> Option<usize> {
        let bounds = self.kept_m.iter().copied().enumerate();
        bounds.reduce(|a, b| if b.1 > a.1 { b } else { a }).map(|(sample, _)| sample)
    }
}

/// The nearest layers as seen from a start.
struct Around<'a> {
    grounds: [Ground<'a>; N_FIELDS],
    n_fields: usize,
    /// Steps in which the scan is too far to matter.
    n_far_hits: usize,
}

impl<'a> Around<'a> {
    /// Looks around for motions of `n_steps`; hits of the scan go to `points`, from the start.
    fn look(scene: &'a Scene<'_>, runner: &Runner, n_steps: usize, points: &mut Vec<[f32; 2]>) -> Around<'a> {
        let Assumptions { limits, step_s, .. } = scene.assumptions;
        let start = Point2::new(runner.x_m, runner.y_m);
        let length_m_max = limits.speed_m_s_max.max(runner.speed_m_s) * step_s;
        let reach_m = length_m_max * n_steps as f64;
        let mut around = Around { grounds: [Ground::NONE; N_FIELDS], n_fields: 0, n_far_hits: usize::MAX };
        points.clear();
        let layers = scene.spatial.iter().filter(|layer| !layer.soft);
        for layer in layers.take(N_LAYERS) {
            // Who is farther than the nearest may matter only once that lead has been driven.
            let lead_m = (layer.start_m - runner.path_m - runner.here_m).max(0.0);
            let n_far = (lead_m / (FIELD_SLOPE * length_m_max)) as usize;
            match &layer.shape {
                Shape::Field(field) => {
                    if let Some(to) = around.grounds.get_mut(around.n_fields)
                        && let Some(ground) = ground(field, start, reach_m)
                    {
                        *to = Ground { keep_m: layer.keep_m as f32, n_far, ..ground };
                        around.n_fields += 1;
                    }
                }
                Shape::Points(index, _) => {
                    around.n_far_hits = n_far.min(around.n_far_hits);
                    // Around the start, and where braking would end.
                    let stop_m = runner.speed_m_s * runner.speed_m_s / (2.0 * limits.accel_m_s2_max);
                    let end = Point2::new(start.x + runner.cos * stop_m, start.y + runner.sin * stop_m);
                    for place in [start, end] {
                        index.for_each_near(place, N_POINTS, |point| {
                            points.push([(point.x - start.x) as f32, (point.y - start.y) as f32]);
                        });
                    }
                }
            }
        }
        around
    }
}

fn motion(scene: &Scene<'_>) -> Motion {
    let Assumptions { limits, step_s, radius_m, disturbance: d, .. } = scene.assumptions;
    let everywhere = || scene.limits.iter().filter(|layer| layer.zone.is_none());
    // Who is too fast already may brake down to it: that is left to the exact rollout.
    let speeds = everywhere().filter(|layer| layer.braking_from_m_s.is_none()).map(|layer| layer.speed_m_s);
    let speed_m_s_cap = speeds.fold(f64::INFINITY, f64::min) + LIMIT_ROUNDING;
    let rate_rad_s_cap = everywhere().map(|layer| layer.yaw_rate_rad_s).fold(f64::INFINITY, f64::min);
    Motion {
        step_s: step_s as f32,
        speed_m_s_max: limits.speed_m_s_max as f32,
        limit: [(limits.yaw_rate_rad_s_max * step_s) as f32, (limits.accel_m_s2_max * step_s) as f32],
        speed_m_s_cap: speed_m_s_cap as f32,
        turn_rad_cap: (rate_rad_s_cap * step_s + LIMIT_ROUNDING) as f32,
        radius_m: radius_m as f32,
        tube_per_step_m: (d.speed_m_s * step_s) as f32,
        tube_per_metre: (d.yaw_rad + limits.yaw_rate_rad_s_max * d.delay_s) as f32,
    }
}

/// A field as seen from a start; `None` when it is too small, the start outside, or the reach too many cells.
fn ground(field: &DistanceField, start: Point2, reach_m: f64) -> Option<Ground<'_>> {
    let layout = field.layout();
    let [n_cols, n_rows] = [layout.shape.n_cols, layout.shape.n_rows];
    let (x, y) = (
        (start.x - layout.origin.x) / layout.resolution_m - 0.5,
        (start.y - layout.origin.y) / layout.resolution_m - 0.5,
    );
    let is_on = |at: f64, n: usize| at > -1.0 && at < n as f64;
    let is_within = reach_m / layout.resolution_m + 2.0 < N_CELLS_MAX;
    if n_cols < 2 || n_rows < 2 || !is_on(x, n_cols) || !is_on(y, n_rows) || !is_within {
        return None;
    }
    let cell = |at: f64, n: usize| at.floor().clamp(0.0, (n - 2) as f64);
    let (col, row) = (cell(x, n_cols), cell(y, n_rows));
    // One step above the lowest: half a cell below it would round to the cell before.
    let low = |at: f64| ((-at).max(-N_CELLS_MAX) as f32).next_up();
    let high = |at: f64, n: usize| ((n - 1) as f64 - at - 2e-4).min(N_CELLS_MAX) as f32;
    Some(Ground {
        values_m: field.values_m(),
        n_cols: i32::try_from(n_cols).ok()?,
        cells_per_m: (1.0 / layout.resolution_m) as f32,
        first_idx: i32::try_from(row as usize * n_cols + col as usize).ok()?,
        share: [(x - col) as f32, (y - row) as f32],
        low: [low(col), low(row)],
        high: [high(col, n_cols), high(row, n_rows)],
        ..Ground::NONE
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geometry::Profile;
    use mapping::{Layout, Shape as GridShape};

    use super::*;
    use crate::config::FilterConfig;
    use crate::dynamics::State;
    use crate::margin::{BaseLayer, World};

    /// A layer of one disc.
    fn disc(name: &str, centre: Point2, radius_m: f64) -> BaseLayer {
        let shape = GridShape { n_cols: 200, n_rows: 200 };
        let layout = Layout::new(Point2::new(-5.0, -5.0), 0.05, shape).unwrap();
        let values_m = layout.cells().map(|cell| ((layout.centre(cell) - centre).norm() - radius_m) as f32);
        let field = DistanceField::from_values(layout, values_m.collect()).unwrap();
        BaseLayer { name: name.into(), field: Arc::new(field) }
    }

    #[test]
    fn what_only_the_camera_sees_rules_samples_out_beside_a_wall_that_the_scan_sees() {
        let profile = Profile::sim();
        let config = FilterConfig::for_profile(&profile);
        let pillar = Point2::new(0.0, 1.0);
        // Ahead, a little farther than the pillar beside: no motion at this speed keeps clear of it for long.
        let base = vec![disc("the map", pillar, 0.3), disc("seen in depth", Point2::new(1.6, 0.0), 0.7)];
        let points =
            (0..24).map(|k| f64::from(k) * 0.26).map(|a| pillar + 0.3 * Point2::new(a.cos(), a.sin()).coords);
        let world = World { base, points: points.collect(), rules: Vec::new() };
        let assumptions = Assumptions::of(&config, &profile);
        let start = State { x_m: 0.0, y_m: 0.0, yaw_rad: 0.0, speed_m_s: 1.5 };
        let scene = Scene::of(&world, start, assumptions, &|_| false);
        let sigma = Control { yaw_rate_rad_s: 0.1, accel_m_s2: 0.1 };
        let search = Search { n_samples: 50, n_rounds: 1, n_steps: 20, sigma };
        let mut noise = Noise::default();
        noise.begin(1, 1, (1, search.n_samples), search.n_steps);
        let onwards = vec![Control { yaw_rate_rad_s: 0.0, accel_m_s2: 0.0 }; search.n_steps];
        let mut bounds = Bounds::default();
        bounds.find(&scene, &search, (&mut noise, 0), &Runner::start(&scene), &onwards, 0.0);
        let n_open = (0..search.n_samples).filter(|sample| bounds.most_m(*sample) > 0.0).count();
        assert!(n_open <= 2, "{n_open} of {} must be followed exactly", search.n_samples);
    }
}
