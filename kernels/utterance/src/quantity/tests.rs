//! What people say for distances, speeds, shares and times.

use super::*;
use proptest::prelude::*;

#[track_caller]
fn check(text: &str, kind: Kind, value: f64) {
    let found = extract(text);
    assert_eq!(found.len(), 1, "{text}: {found:?}");
    assert_eq!(found[0].kind, kind, "{text}");
    assert!((found[0].value - value).abs() < 1e-9, "{text}: {}", found[0].value);
}

#[test]
fn distances() {
    for (text, metres) in [
        ("half a metre", 0.5),
        ("a metre and a half", 1.5),
        ("one and a half meters", 1.5),
        ("60cm", 0.6),
        ("two feet", 0.6096),
        ("a foot", 0.3048),
        ("6\"", 0.1524),
        ("3'", 0.9144),
        ("a yard", 0.9144),
        ("three quarters of a metre", 0.75),
        ("point six metres", 0.6),
        ("a couple of feet", 0.6096),
        ("2 feet 6 inches", 0.762),
        ("an arm's length", 0.7),
        ("two steps", 1.5),
        ("250 mm", 0.25),
        ("a quarter of a metre", 0.25),
        ("1,5 m", 1.5),
        ("a few inches", 0.0762),
        ("half metre", 0.5),
    ] {
        check(text, Kind::Distance, metres);
    }
}

#[test]
fn speeds_and_turn_rates() {
    check("half a metre per second", Kind::Speed, 0.5);
    check("0.8 m/s", Kind::Speed, 0.8);
    check("2 km/h", Kind::Speed, 0.5555);
    check("1 mph", Kind::Speed, 0.447);
    check("20 cm per second", Kind::Speed, 0.2);
    check("a foot a second", Kind::Speed, 0.3048);
    check("50 degrees a second", Kind::TurnRate, 0.8726);
    check("0.5 rad/s", Kind::TurnRate, 0.5);
    check("20°/s", Kind::TurnRate, 0.349);
}

#[test]
fn shares_and_durations() {
    check("half speed", Kind::Fraction, 0.5);
    check("a quarter of your top speed", Kind::Fraction, 0.25);
    check("30 percent", Kind::Fraction, 0.3);
    check("half an hour", Kind::Duration, 1800.0);
    check("an hour and a half", Kind::Duration, 5400.0);
    check("quarter of an hour", Kind::Duration, 900.0);
    check("1 h 30 min", Kind::Duration, 5400.0);
    check("two and a half hours", Kind::Duration, 9000.0);
}

#[test]
fn two_measures_joined_by_and_stay_two() {
    assert_eq!(extract("one metre from the tv and 50 cm from the table").len(), 2);
    assert_eq!(extract("1 m and 50 cm").len(), 2);
}

proptest! {
    #[test]
    fn rounding_never_loosens(value in 0.0..10.0f64) {
        prop_assert!(round_safe(Kind::Distance, value) >= value - 1e-9);
        prop_assert!(round_safe(Kind::Speed, value) <= value + 1e-9);
    }

    #[test]
    fn a_number_with_a_unit_is_that_number(thousandths in 1u32..5000) {
        let metres = f64::from(thousandths) / 1000.0;
        let found = extract(&format!("keep {metres} m from it"));
        prop_assert_eq!(found.len(), 1);
        prop_assert!((found[0].value - metres).abs() < 1e-9);
    }
}
