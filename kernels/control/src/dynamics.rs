//! How the base moves: the state, the control, and the exact step between them.
//!
//! Over one step the control (turn rate ω, acceleration a) is held: the heading turns at ω and the speed
//! ramps linearly. The pose is the closed-form integral of that motion, not Euler's approximation, so a
//! rollout of any step length describes the same path. Speed never goes below exactly 0: reverse is never
//! planned. No disturbance is modelled here; that is the tube's business (`certificate`).

use geometry::{Point2, Pose2, Profile, Twist};

/// Where the base is in `map` and how fast it moves forward.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct State {
    /// Position along x, metres.
    pub x_m: f64,
    /// Position along y, metres.
    pub y_m: f64,
    /// Heading, radians, counter-clockwise from +x; need not be wrapped.
    pub yaw_rad: f64,
    /// Forward speed, m/s.
    pub speed_m_s: f64,
}

/// What the base can be made to do over one step.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Control {
    /// Turn rate ω, rad/s, positive to the left.
    pub yaw_rate_rad_s: f64,
    /// Forward acceleration a, m/s².
    pub accel_m_s2: f64,
}

/// The bounds of the control and of the speed, from the profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest forward speed, m/s.
    pub speed_m_s_max: f64,
    /// Largest turn rate either way, rad/s.
    pub yaw_rate_rad_s_max: f64,
    /// Largest acceleration and deceleration, m/s².
    pub accel_m_s2_max: f64,
}

impl State {
    /// A state from a pose and a speed.
    #[must_use]
    pub fn new(map_from_base: Pose2, speed_m_s: f64) -> Self {
        let Pose2 { x_m, y_m, yaw_rad } = map_from_base;
        State { x_m, y_m, yaw_rad, speed_m_s }
    }

    /// The position in `map`.
    #[must_use]
    pub fn position(&self) -> Point2 {
        Point2::new(self.x_m, self.y_m)
    }

    /// The pose in `map`, heading wrapped.
    #[must_use]
    pub fn pose(&self) -> Pose2 {
        Pose2::new(self.x_m, self.y_m, self.yaw_rad)
    }

    /// True when no part is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite() && self.speed_m_s.is_finite()
    }

    /// The state after `seconds` of a held control; the speed ramps to where [`Limits::speed_after`] says.
    #[must_use]
    pub fn after(&self, control: Control, seconds: f64, limits: &Limits) -> State {
        let end_m_s = limits.speed_after(self.speed_m_s, control.accel_m_s2, seconds);
        self.ramped(control.yaw_rate_rad_s, end_m_s, seconds)
    }

    /// The state after `seconds` in which the speed ramps linearly to `end_m_s` at a constant turn rate.
    #[must_use]
    pub fn ramped(&self, yaw_rate_rad_s: f64, end_m_s: f64, seconds: f64) -> State {
        self.ramped_along(&mut Heading::of(self.yaw_rad), yaw_rate_rad_s, end_m_s, seconds)
    }

    /// The same; `heading` is that of the step before and becomes this one's.
    #[inline]
    pub(crate) fn ramped_along(
        &self,
        heading: &mut Heading,
        yaw_rate_rad_s: f64,
        end_m_s: f64,
        seconds: f64,
    ) -> State {
        if heading.yaw_rad != self.yaw_rad {
            *heading = Heading { bend: heading.bend, ..Heading::of(self.yaw_rad) };
        }
        let Heading { sin, cos, bend, .. } = heading;
        let (sin, cos) = (*sin, *cos);
        let moved = bend.becomes(yaw_rate_rad_s * seconds).over(self.speed_m_s, end_m_s, seconds);
        State {
            x_m: self.x_m + cos * moved.along_m - sin * moved.aside_m,
            y_m: self.y_m + sin * moved.along_m + cos * moved.aside_m,
            yaw_rad: self.yaw_rad + yaw_rate_rad_s * seconds,
            speed_m_s: end_m_s,
        }
    }
}

impl Limits {
    /// The limits of a profile.
    #[must_use]
    pub fn of(profile: &Profile) -> Self {
        Limits {
            speed_m_s_max: profile.speed_m_s_max,
            yaw_rate_rad_s_max: profile.yaw_rate_rad_s_max,
            accel_m_s2_max: profile.accel_m_s2_max,
        }
    }

    /// The speed after `seconds` at `accel_m_s2`, kept within 0 and the maximum.
    ///
    /// A speed measured above the maximum comes down no faster than the base can brake.
    #[must_use]
    pub fn speed_after(&self, speed_m_s: f64, accel_m_s2: f64, seconds: f64) -> f64 {
        let floor_m_s = (speed_m_s - self.accel_m_s2_max * seconds).max(0.0);
        let ceiling_m_s = self.speed_m_s_max.max(floor_m_s);
        (speed_m_s + accel_m_s2 * seconds).clamp(0.0, ceiling_m_s)
    }

    /// The control within its bounds.
    #[must_use]
    pub fn clamped(&self, control: Control) -> Control {
        Control {
            yaw_rate_rad_s: control.yaw_rate_rad_s.clamp(-self.yaw_rate_rad_s_max, self.yaw_rate_rad_s_max),
            accel_m_s2: control.accel_m_s2.clamp(-self.accel_m_s2_max, self.accel_m_s2_max),
        }
    }

    /// The control that leads from a speed towards a set-point within one step, as far as the limits let it.
    #[must_use]
    pub fn control_towards(&self, speed_m_s: f64, set_point: Twist, step_s: f64) -> Control {
        let wanted_m_s = set_point.speed_m_s.clamp(0.0, self.speed_m_s_max);
        self.clamped(Control {
            yaw_rate_rad_s: set_point.yaw_rate_rad_s,
            accel_m_s2: (wanted_m_s - speed_m_s) / step_s,
        })
    }

    /// Time to come to rest from a speed, seconds.
    #[must_use]
    pub fn braking_s(&self, speed_m_s: f64) -> f64 {
        speed_m_s / self.accel_m_s2_max
    }
}

/// A heading with its sine and cosine, and how the last step bent: the next is often straight, or bends alike.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Heading {
    yaw_rad: f64,
    sin: f64,
    cos: f64,
    bend: Bend,
}

impl Heading {
    pub(crate) fn of(yaw_rad: f64) -> Heading {
        let (sin, cos) = yaw_rad.sin_cos();
        Heading { yaw_rad, sin, cos, bend: Bend::NONE }
    }

    /// Its sine and cosine.
    pub(crate) fn sin_cos(&self) -> (f64, f64) {
        (self.sin, self.cos)
    }
}

/// A displacement in the frame of the start: `along_m` ahead, `aside_m` to the left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    pub along_m: f64,
    pub aside_m: f64,
    /// Cosine and sine of the turn.
    pub turn_cos: f64,
    pub turn_sin: f64,
}

/// How a step bends by its turn alone: worked out once for steps that turn alike, as most do that follow each other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bend {
    turn_rad: f64,
    cos: f64,
    sin: f64,
    /// Integrals of the heading's cosine and sine over the step, and of both weighted with the time.
    along: [f64; 2],
    aside: [f64; 2],
}

impl Bend {
    /// No turn.
    pub(crate) const NONE: Bend =
        Bend { turn_rad: 0.0, cos: 1.0, sin: 0.0, along: [1.0, 0.5], aside: [0.0, 0.0] };

    #[inline]
    pub(crate) fn of(turn_rad: f64) -> Bend {
        let phi = turn_rad;
        let square = phi * phi;
        // Taylor series below half a radian (a step turns 0.05 rad), error below 1e-9; closed form above,
        // where its quotients by φ² no longer cancel.
        let (along, aside, cos, sin) = if square < 0.25 {
            (
                [
                    1.0 + square * (-1.0 / 6.0 + square * (1.0 / 120.0 - square * (1.0 / 5040.0))),
                    0.5 + square * (-1.0 / 8.0 + square * (1.0 / 144.0 - square * (1.0 / 5760.0))),
                ],
                [
                    phi * (0.5 + square * (-1.0 / 24.0 + square * (1.0 / 720.0 - square * (1.0 / 40_320.0)))),
                    phi * (1.0 / 3.0
                        + square * (-1.0 / 30.0 + square * (1.0 / 840.0 - square * (1.0 / 45_360.0)))),
                ],
                1.0 + square
                    * (-0.5 + square * (1.0 / 24.0 + square * (-1.0 / 720.0 + square * (1.0 / 40_320.0)))),
                phi * (1.0
                    + square
                        * (-1.0 / 6.0
                            + square
                                * (1.0 / 120.0 + square * (-1.0 / 5040.0 + square * (1.0 / 362_880.0))))),
            )
        } else {
            let (sin, cos) = phi.sin_cos();
            (
                [sin / phi, sin / phi + (cos - 1.0) / square],
                [(1.0 - cos) / phi, sin / square - cos / phi],
                cos,
                sin,
            )
        };
        Bend { turn_rad, cos, sin, along, aside }
    }

    /// The bend of this turn, by `self` where it is the same.
    #[inline]
    pub(crate) fn becomes(&mut self, turn_rad: f64) -> &Bend {
        if self.turn_rad != turn_rad {
            *self = Bend::of(turn_rad);
        }
        self
    }

    /// The integral of (v₀ + (v₁ − v₀) s) · (cos φs, sin φs) over s in 0 to 1, times `seconds`, φ the turn.
    #[inline]
    pub(crate) fn over(&self, start_m_s: f64, end_m_s: f64, seconds: f64) -> Moved {
        let Bend { cos, sin, along, aside, .. } = *self;
        let gain_m_s = end_m_s - start_m_s;
        Moved {
            along_m: seconds * (start_m_s * along[0] + gain_m_s * along[1]),
            aside_m: seconds * (start_m_s * aside[0] + gain_m_s * aside[1]),
            turn_cos: cos,
            turn_sin: sin,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn limits() -> Limits {
        Limits::of(&Profile::sim())
    }

    proptest! {
        #[test]
        fn one_step_agrees_with_ten_thousand_small_euler_steps(
            v0 in 0.0..1.5_f64, v1 in 0.0..1.5_f64, rate in -10.0..10.0_f64, yaw in -3.0..3.0_f64,
        ) {
            let start = State { x_m: 1.0, y_m: -2.0, yaw_rad: yaw, speed_m_s: v0 };
            let end = start.ramped(rate, v1, 0.1);
            let (n, mut x, mut y) = (10_000, 1.0, -2.0);
            for i in 0..n {
                let share = (f64::from(i) + 0.5) / f64::from(n);
                let v = v0 + (v1 - v0) * share;
                let heading = yaw + rate * 0.1 * share;
                x += v * heading.cos() * 0.1 / f64::from(n);
                y += v * heading.sin() * 0.1 / f64::from(n);
            }
            prop_assert!((end.x_m - x).abs() < 1e-8 && (end.y_m - y).abs() < 1e-8, "{end:?} {x} {y}");
        }

        #[test]
        fn two_half_steps_are_one_step(v in 0.3..1.0_f64, a in -3.0..3.0_f64, rate in -1.0..1.0_f64) {
            let start = State { speed_m_s: v, ..State::default() };
            let control = Control { yaw_rate_rad_s: rate, accel_m_s2: a };
            let once = start.after(control, 0.05, &limits());
            let twice = start.after(control, 0.02, &limits()).after(control, 0.03, &limits());
            prop_assert!((once.x_m - twice.x_m).abs() < 1e-9 && (once.y_m - twice.y_m).abs() < 1e-9);
            prop_assert!((once.speed_m_s - twice.speed_m_s).abs() < 1e-12);
        }

        #[test]
        fn the_turn_of_a_step_has_its_cosine_and_sine(phi in -0.6..0.6_f64) {
            let moved = Bend::of(phi).over(0.4, 0.6, 0.05);
            prop_assert!((moved.turn_cos - phi.cos()).abs() < 1e-9);
            prop_assert!((moved.turn_sin - phi.sin()).abs() < 1e-9);
        }
    }

    #[test]
    fn speed_stays_within_exactly_zero_and_the_maximum() {
        assert_eq!(limits().speed_after(0.1, -3.0, 0.05), 0.0);
        assert_eq!(limits().speed_after(1.45, 3.0, 0.05), 1.5);
        assert!((limits().speed_after(1.8, 0.0, 0.05) - 1.65).abs() < 1e-12);
    }
}
