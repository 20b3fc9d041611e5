//! Which of the sampled sequences can be the best: bounds for all of them at once, for the search.
//!
//! A bound is what a sequence would keep if only the merged layers, the limits everywhere and those hits of the
//! scan counted that were met so far: never less than what it is sure to keep. Whoever's bound is too low is not looked at; the others are followed exactly.
//! Deliberately not here: what a sequence is worth (`score`), what may be sent (`certificate`).

use crate::dynamics::Control;
use crate::fast::Isa;
use crate::fast::isa::fused;
use crate::fast::packed::unpacked_fine;
use crate::fast::sweep::{From, Ground, Model, Sampled, Step, Sweep, least, most, padded};
use crate::noise::Noise;
use crate::scene::{Assumptions, Scene, Shape};
use crate::score::{Runner, Search};

/// What f32 may take from a margin along a rollout, metres: measured below 2e-6, taken tenfold.
const ROUNDING_M: f64 = 2e-5;
/// What f32 may take from a speed or a turn, m/s or rad.
const LIMIT_ROUNDING: f64 = 1e-4;
/// Most scan hits that a sweep looks at: those near to where braking leads are found first.
const N_POINTS_MAX: usize = 24;
/// Words end this far above what must be told apart, metres: more than any segment and tube lose.
const HEADROOM_M: f64 = 1.0;

/// Room for sweeps, kept from one to the next.
#[derive(Debug)]
pub(crate) struct Sweeper {
    isa: Isa,
    held: Vec<[f32; 2]>,
    kept_m: Vec<f32>,
    points: Vec<[f32; 2]>,
}

/// What a sweep found.
pub(crate) struct Swept<'a> {
    kept_m: &'a [f32],
    error_m: f64,
}

impl Swept<'_> {
    /// The most that a sample can keep, metres.
    #[inline]
    pub(crate) fn may_keep_m(&self, sample: usize) -> f64 {
        self.kept_m.get(sample).map_or(f64::INFINITY, |m| f64::from(*m) + self.error_m)
    }

    /// The sample whose bound is highest.
    pub(crate) fn first(&self) -> Option<usize> {
        let mut first: Option<(usize, f32)> = None;
        for (sample, kept_m) in self.kept_m.iter().enumerate() {
            if first.is_none_or(|(_, most_m)| *kept_m > most_m) {
                first = Some((sample, *kept_m));
            }
        }
        first.map(|(sample, _)| sample)
    }
}

impl Sweeper {
    /// No room yet.
    pub(crate) fn on(isa: Isa) -> Sweeper {
        Sweeper { isa, held: Vec::new(), kept_m: Vec::new(), points: Vec::new() }
    }

    /// Sweeps the samples of a round around an incumbent, of which only those count that keep more than
    /// `floor_m`; `None` when there is no ground to sweep over.
    pub(crate) fn sweep(
        &mut self,
        scene: &Scene<'_>,
        search: &Search,
        (noise, round): (&Noise, usize),
        runner: Runner,
        incumbent: &[Control],
        floor_m: f64,
    ) -> Option<Swept<'_>> {
        let window = scene.window().filter(|window| floor_m + HEADROOM_M < window.top_m())?;
        let Assumptions { limits, step_s, .. } = scene.assumptions;
        let cells_per_m = 1.0 / window.resolution_m();
        let gain_max = limits.accel_m_s2_max * step_s;
        let n_steps = incumbent.len();
        let n_tail = if scene.assumptions.braking_tail {
            (limits.speed_m_s_max.max(runner.speed_m_s) / gain_max).ceil() as usize + 1
        } else {
            0
        };
        let reach_m = farthest_m(runner.speed_m_s, scene, n_steps);
        let n_reach = (reach_m * cells_per_m).ceil() as i32 + 2;
        self.held.clear();
        self.held.extend(
            incumbent.iter().map(|c| [(c.yaw_rate_rad_s * step_s) as f32, (c.accel_m_s2 * step_s) as f32]),
        );
        self.kept_m.resize(padded(search.n_samples), 0.0);
        let Sweeper { isa, held, kept_m, points } = self;
        let sampled = Sampled {
            held,
            draws: noise.round(round),
            n_lanes: noise.n_lanes(),
            scale: [(search.sigma.yaw_rate_rad_s * step_s) as f32, (search.sigma.accel_m_s2 * step_s) as f32],
            limit: [(limits.yaw_rate_rad_s_max * step_s) as f32, gain_max as f32],
            n_tail,
        };
        let start = geometry::Point2::new(runner.x_m, runner.y_m);
        let model = Arcs::of(scene, cells_per_m);
        let error_m = window.over(start, n_reach, |ground, [x, y], error_m| {
            let from = From {
                x,
                y,
                sin: runner.sin as f32,
                cos: runner.cos as f32,
                speed_m_s: runner.speed_m_s as f32,
                kept_m: runner.kept_m as f32,
                here_m: runner.here_m as f32,
                tube_m: scene.tube_m(runner.start_m_s, runner.moving_s, runner.path_m) as f32,
            };
            points.clear();
            for layer in &scene.spatial {
                let Shape::Points(index, _) = &layer.shape else { continue };
                index.for_each_listed(N_POINTS_MAX, |point| {
                    let from_start = (point - start) * cells_per_m;
                    points.push([from_start.x as f32 + x, from_start.y as f32 + y]);
                });
            }
            let ground = Ground { points, points_keep_m: scene.assumptions.radius_m as f32, ..ground };
            let floor_m = (floor_m - f64::from(error_m) - ROUNDING_M) as f32;
            let n = search.n_samples;
            isa.run(Sweep::<_, false> { model, ground, from, sampled, n, floor_m, kept_m });
            f64::from(error_m) + ROUNDING_M
        })?;
        Some(Swept { kept_m: &kept_m[..search.n_samples], error_m })
    }
}

/// Farthest that a sequence leads in `n_steps` and then braking, metres.
fn farthest_m(speed_m_s: f64, scene: &Scene<'_>, n_steps: usize) -> f64 {
    let Assumptions { limits, step_s, .. } = scene.assumptions;
    let gain_max = limits.accel_m_s2_max * step_s;
    let (mut speed_m_s, mut path_m) = (speed_m_s, 0.0);
    for _ in 0..n_steps {
        let next_m_s = limits.speed_after(speed_m_s, limits.accel_m_s2_max, step_s);
        path_m += (speed_m_s + next_m_s) / 2.0 * step_s;
        speed_m_s = next_m_s;
    }
    path_m + speed_m_s * (speed_m_s / gain_max + 1.0) * step_s / 2.0
}

/// Exact arcs with ramped speed, the loss between samples and the tube: `score`'s step in f32.
#[derive(Clone, Copy, Debug)]
struct Arcs {
    step_s: f32,
    cells_per_m: f32,
    speed_max: f32,
    gain_max: f32,
    /// The limits everywhere: speed (m/s), turn of a step (rad).
    speed_cap: f32,
    turn_cap: f32,
    radius_m: f32,
    square_m2: f32,
    /// What the tube grows by in a step of motion, and in a metre.
    per_step_m: f32,
    per_metre: f32,
}

impl Arcs {
    fn of(scene: &Scene<'_>, cells_per_m: f64) -> Arcs {
        let Assumptions { limits, step_s, radius_m, disturbance: d, .. } = scene.assumptions;
        let everywhere = || scene.limits.iter().filter(|layer| layer.zone.is_none());
        // Who is too fast already may brake down to it: then the limit is left to the exact rollout.
        let speed_cap = everywhere()
            .map(|layer| layer.braking_from_m_s.map_or(layer.speed_m_s, |_| f64::INFINITY))
            .fold(f64::INFINITY, f64::min);
        let rate_cap = everywhere().map(|layer| layer.yaw_rate_rad_s).fold(f64::INFINITY, f64::min);
        Arcs {
            step_s: step_s as f32,
            cells_per_m: cells_per_m as f32,
            speed_max: limits.speed_m_s_max as f32,
            gain_max: (limits.accel_m_s2_max * step_s) as f32,
            speed_cap: (speed_cap + LIMIT_ROUNDING) as f32,
            turn_cap: (rate_cap * step_s + LIMIT_ROUNDING) as f32,
            radius_m: radius_m as f32,
            square_m2: (radius_m * radius_m) as f32,
            per_step_m: (d.speed_m_s * step_s) as f32,
            per_metre: (d.yaw_rad + limits.yaw_rate_rad_s_max * d.delay_s) as f32,
        }
    }
}

impl Model for Arcs {
    const LOSES: bool = true;
    const WRAPS: bool = true;

    #[inline(always)]
    fn step<const FUSED: bool>(&self, speed_m_s: f32, turn_rad: f32, gain_m_s: f32) -> Step {
        let braked = most(speed_m_s - self.gain_max, 0.0);
        let ceiling = most(self.speed_max, braked);
        let end_m_s = most(least(speed_m_s + gain_m_s, ceiling), 0.0);
        let gained = end_m_s - speed_m_s;
        let square = turn_rad * turn_rad;
        // Taylor, as in `dynamics`; a step turns by half a radian at most: error below 1e-6.
        let c0 = fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 120.0, -1.0 / 6.0), 1.0);
        let s0 = turn_rad * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 720.0, -1.0 / 24.0), 0.5);
        let c1 = fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 144.0, -1.0 / 8.0), 0.5);
        let s1 =
            turn_rad * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 840.0, -1.0 / 30.0), 1.0 / 3.0);
        let cells = self.step_s * self.cells_per_m;
        let length_m = (speed_m_s + end_m_s) * (0.5 * self.step_s);
        let half_m = 0.5 * length_m;
        let chord_m = self.radius_m - fused::<FUSED>(-half_m, half_m, self.square_m2).sqrt();
        let moving_m = if length_m > 0.0 { self.per_step_m } else { 0.0 };
        let heeds = (end_m_s <= self.speed_cap) & (turn_rad.abs() <= self.turn_cap);
        Step {
            along: cells * fused::<FUSED>(speed_m_s, c0, gained * c1),
            aside: cells * fused::<FUSED>(speed_m_s, s0, gained * s1),
            length: length_m * self.cells_per_m,
            turn_cos: fused::<FUSED>(
                square,
                fused::<FUSED>(square, fused::<FUSED>(square, -1.0 / 720.0, 1.0 / 24.0), -0.5),
                1.0,
            ),
            turn_sin: turn_rad
                * fused::<FUSED>(
                    square,
                    fused::<FUSED>(square, fused::<FUSED>(square, -1.0 / 5040.0, 1.0 / 120.0), -1.0 / 6.0),
                    1.0,
                ),
            speed_m_s: end_m_s,
            bound_m: if heeds { f32::INFINITY } else { f32::NEG_INFINITY },
            loss_m: fused::<FUSED>(0.25 * length_m, turn_rad.abs(), chord_m),
            growth_m: fused::<FUSED>(self.per_metre, length_m, moving_m),
        }
    }

    #[inline(always)]
    fn margins_m<const FUSED: bool>(
        &self,
        (low, high): (u32, u32),
        (x, y): (f32, f32),
        quantum_m: [f32; 2],
    ) -> (f32, f32) {
        (quantum_m[0] * unpacked_fine::<FUSED>(low, high, x, y), f32::INFINITY)
    }

    #[inline(always)]
    fn worth_m(&self, clear_m: f32, _slow_m: f32, _speed_m_s: f32) -> f32 {
        clear_m
    }
}
