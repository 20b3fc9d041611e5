//! Every branch, its border and one past it: no line of the envelope may change unnoticed.

use super::*;
use proptest::prelude::*;

const LIMITS: EnvelopeLimits = EnvelopeLimits {
    speed_m_s_max: 0.5,
    reverse_m_s_max: 0.1,
    yaw_rate_rad_s_max: 1.0,
    accel_m_s2_max: 4.0,
    yaw_accel_rad_s2_max: 8.0,
    command_age_max: Duration::from_millis(150),
};

fn at_ms(ms: u64) -> Time {
    Time::from_nanos(ms * 1_000_000)
}

/// An envelope that passed nothing yet, and saw the clock at 1 s.
fn envelope() -> Envelope {
    let mut envelope = Envelope::new(LIMITS).unwrap();
    assert_eq!(envelope.check(at_ms(1000), None), (Twist::ZERO, Verdict::Stop(Stop::NoCommand)));
    envelope
}

/// An envelope at 2 s that has just passed (0.5, 1).
fn at_full_speed() -> Envelope {
    let mut envelope = envelope();
    let full = Twist::new(0.5, 1.0);
    assert_eq!(envelope.check(at_ms(2000), Some((full, at_ms(2000)))), (full, Verdict::Passed));
    envelope
}

#[track_caller]
fn check(command: Twist, age_ms: u64, wanted: Verdict) {
    let (sent, verdict) = at_full_speed().check(at_ms(3000), Some((command, at_ms(3000 - age_ms))));
    assert_eq!(verdict, wanted);
    assert_eq!(sent, if wanted == Verdict::Passed { command } else { Twist::ZERO });
}

#[test]
fn a_command_within_every_limit_passes_as_it_came() {
    check(Twist::new(0.3, -0.2), 10, Verdict::Passed);
    check(Twist::ZERO, 0, Verdict::Passed);
}

#[test]
fn a_command_exactly_at_the_age_limit_passes_and_one_past_it_stops() {
    check(Twist::new(0.3, 0.0), 150, Verdict::Passed);
    let (sent, verdict) = at_full_speed()
        .check(at_ms(3000), Some((Twist::new(0.3, 0.0), Time::from_nanos(3_000_000_000 - 150_000_001))));
    assert_eq!((sent, verdict), (Twist::ZERO, Verdict::Stop(Stop::Stale)));
}

#[test]
fn speeds_at_the_limit_pass_and_one_past_it_stop() {
    check(Twist::new(0.5, 0.0), 0, Verdict::Passed);
    check(Twist::new(0.5_f64.next_up(), 0.0), 0, Verdict::Stop(Stop::TooFast));
    check(Twist::new(-0.1, 0.0), 0, Verdict::Passed);
    check(Twist::new((-0.1_f64).next_down(), 0.0), 0, Verdict::Stop(Stop::TooFast));
    check(Twist::new(0.0, 1.0), 0, Verdict::Passed);
    check(Twist::new(0.0, 1.0_f64.next_up()), 0, Verdict::Stop(Stop::TurningTooFast));
    check(Twist::new(0.0, -1.0), 0, Verdict::Passed);
    check(Twist::new(0.0, (-1.0_f64).next_down()), 0, Verdict::Stop(Stop::TurningTooFast));
}

#[test]
fn what_is_not_finite_stops() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        check(Twist::new(bad, 0.0), 0, Verdict::Stop(Stop::NotFinite));
        check(Twist::new(0.0, bad), 0, Verdict::Stop(Stop::NotFinite));
    }
}

#[test]
fn without_a_command_the_motors_get_zero_at_once() {
    let got = at_full_speed().check(at_ms(2001), None);
    assert_eq!(got, (Twist::ZERO, Verdict::Stop(Stop::NoCommand)));
}

#[test]
fn a_command_from_the_future_stops() {
    let command = Some((Twist::new(0.1, 0.0), Time::from_nanos(3_000_000_001)));
    assert_eq!(at_full_speed().check(at_ms(3000), command).1, Verdict::Stop(Stop::Clock));
}

#[test]
fn time_running_backwards_stops_until_it_has_caught_up() {
    let mut envelope = at_full_speed();
    let command = |ms| Some((Twist::new(0.1, 0.0), at_ms(ms)));
    let (sent, verdict) = envelope.check(at_ms(1999), command(1999));
    assert_eq!((sent, verdict), (Twist::ZERO, Verdict::Stop(Stop::Clock)));
    assert_eq!(envelope.check(at_ms(1999), command(1999)).1, Verdict::Stop(Stop::Clock));
    // The same moment twice is no step back, but leaves no time to speed up in.
    assert_eq!(envelope.check(at_ms(2000), command(2000)), (Twist::ZERO, Verdict::Eased));
    assert_eq!(envelope.check(at_ms(2050), command(2050)).1, Verdict::Passed);
}

#[test]
fn speeding_up_is_held_to_the_acceleration() {
    let mut envelope = envelope();
    // 100 ms at 4 m/s² and 8 rad/s².
    let (sent, verdict) = envelope.check(at_ms(1100), Some((Twist::new(0.5, 1.0), at_ms(1100))));
    assert_eq!(verdict, Verdict::Eased);
    assert!((sent.speed_m_s - 0.4).abs() < 1e-12 && (sent.yaw_rate_rad_s - 0.8).abs() < 1e-12);
    let (sent, _) = envelope.check(at_ms(1110), Some((Twist::new(0.5, -0.05), at_ms(1110))));
    assert!((sent.speed_m_s - 0.44).abs() < 1e-12);
    assert!((sent.yaw_rate_rad_s + 0.05).abs() < 1e-12, "a change of sign starts from zero");
}

#[test]
fn the_first_command_of_all_starts_from_zero() {
    let mut envelope = Envelope::new(LIMITS).unwrap();
    let got = envelope.check(at_ms(5), Some((Twist::new(0.4, 0.0), at_ms(5))));
    assert_eq!(got, (Twist::ZERO, Verdict::Eased));
}

#[test]
fn braking_is_never_limited() {
    let got = at_full_speed().check(at_ms(2001), Some((Twist::new(0.01, 0.01), at_ms(2001))));
    assert_eq!(got, (Twist::new(0.01, 0.01), Verdict::Passed));
}

#[test]
fn after_a_stop_speeding_up_starts_from_zero() {
    let mut envelope = at_full_speed();
    envelope.check(at_ms(2010), None);
    let (sent, verdict) = envelope.check(at_ms(2060), Some((Twist::new(0.5, 0.0), at_ms(2060))));
    assert_eq!(verdict, Verdict::Eased);
    assert!((sent.speed_m_s - 0.2).abs() < 1e-12);
}

#[test]
fn a_pause_earns_no_more_speed_than_the_life_of_one_command() {
    let limits = EnvelopeLimits { command_age_max: Duration::from_millis(100), ..LIMITS };
    let mut envelope = Envelope::new(limits).unwrap();
    envelope.check(at_ms(0), None);
    let (sent, verdict) = envelope.check(at_ms(60_000), Some((Twist::new(0.5, 0.0), at_ms(60_000))));
    assert_eq!(verdict, Verdict::Eased);
    assert!((sent.speed_m_s - 0.4).abs() < 1e-12);
}

#[test]
fn to_turn_round_the_motors_begin_at_zero() {
    let mut envelope = at_full_speed();
    let back = Twist::new(-0.1, 0.0);
    let (sent, verdict) = envelope.check(at_ms(2010), Some((back, at_ms(2010))));
    assert_eq!(verdict, Verdict::Eased);
    assert!((sent.speed_m_s + 4.0 * 0.01).abs() < 1e-12, "{sent:?}");
}

#[test]
fn a_base_that_eases_its_own_turns_is_not_limited_even_within_one_moment() {
    let limits = EnvelopeLimits { yaw_accel_rad_s2_max: f64::INFINITY, ..LIMITS };
    let mut envelope = Envelope::new(limits).unwrap();
    let turn = Twist::new(0.0, 1.0);
    assert_eq!(envelope.check(at_ms(7), Some((turn, at_ms(7)))), (turn, Verdict::Passed));
    assert_eq!(envelope.check(at_ms(8), Some((turn, at_ms(8)))), (turn, Verdict::Passed));
}

#[test]
fn limits_that_no_base_has_are_named_with_their_range() {
    type Change = fn(&mut EnvelopeLimits, f64);
    let cases: [(&str, Change, f64, f64); 5] = [
        ("speed_m_s_max", |l, v| l.speed_m_s_max = v, 0.01, 5.0),
        ("reverse_m_s_max", |l, v| l.reverse_m_s_max = v, 0.0, 1.0),
        ("yaw_rate_rad_s_max", |l, v| l.yaw_rate_rad_s_max = v, 0.01, 10.0),
        ("accel_m_s2_max", |l, v| l.accel_m_s2_max = v, 0.01, 20.0),
        ("yaw_accel_rad_s2_max", |l, v| l.yaw_accel_rad_s2_max = v, 0.01, f64::INFINITY),
    ];
    for (key, change, low, high) in cases {
        let with = |value| {
            let mut limits = LIMITS;
            change(&mut limits, value);
            Envelope::new(limits).map(|_| ())
        };
        assert_eq!((with(low), with(high)), (Ok(()), Ok(())), "{key}");
        for value in [low.next_down(), high.next_up(), f64::NAN] {
            if value == high {
                continue; // Nothing lies above infinity.
            }
            let error = with(value).unwrap_err();
            assert_eq!((error.key, error.low, error.high), (key, low, high));
        }
    }
    let age = |ms| Envelope::new(EnvelopeLimits { command_age_max: Duration::from_millis(ms), ..LIMITS });
    assert!(age(10).is_ok() && age(1000).is_ok());
    assert_eq!(age(9).unwrap_err().key, "command_age_max");
    let error = age(1001).unwrap_err();
    assert_eq!(error.to_string(), "command_age_max = 1.001, must be within 0.01 to 1");
}

proptest! {
    #[test]
    fn whatever_comes_the_motors_are_told_something_within_the_limits(
        commands in prop::collection::vec((any::<f64>(), any::<f64>(), 0..400_u64, 0..300_u64), 1..40),
    ) {
        let mut envelope = Envelope::new(LIMITS).unwrap();
        let (mut now, mut last) = (1000, Twist::ZERO);
        for (speed, rate, step_ms, age_ms) in commands {
            now += step_ms;
            let command = Twist::new(speed % 1.0, rate % 2.0);
            let (sent, _) = envelope.check(at_ms(now), Some((command, at_ms(now - age_ms))));
            prop_assert!(sent.speed_m_s <= 0.5 && sent.speed_m_s >= -0.1 && sent.yaw_rate_rad_s.abs() <= 1.0);
            let growth = sent.speed_m_s.abs() - last.speed_m_s.abs();
            prop_assert!(growth <= 4.0 * step_ms as f64 * 1e-3 + 1e-9);
            last = sent;
        }
    }
}
