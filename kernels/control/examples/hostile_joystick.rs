//! A joystick held at full speed towards a wall: the filter lets the robot come near, and no nearer.

#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::{sync::Arc, time::Duration};

use control::{BaseLayer, Filter, FilterConfig, State, World};
use geometry::{Point2, Profile, Twist};
use mapping::{DistanceField, Layout, Shape};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let profile = Profile::sim();
    let mut filter = Filter::new(FilterConfig::for_profile(&profile), &profile)?;

    // A wall at x = 3 m, as a signed distance at the centres of 5 cm cells.
    let layout = Layout::new(Point2::new(-1.0, -2.0), 0.05, Shape { n_cols: 80, n_rows: 80 })?;
    let distance_m = layout.cells().map(|cell| (3.0 - layout.centre(cell).x) as f32).collect();
    let field = Arc::new(DistanceField::from_values(layout, distance_m)?);
    let world = World { base: vec![BaseLayer { name: "the wall".into(), field }], ..World::default() };

    let (tick, joystick) = (Duration::from_millis(50), Twist::new(1.5, 0.0));
    let mut state = State::default();
    for _ in 0..100 {
        let decision = filter.step(tick, state, joystick, &world);
        let Twist { speed_m_s, yaw_rate_rad_s } = decision.command;
        println!("x = {:.3} m, sent {speed_m_s:.2} m/s: {}", state.x_m, decision.words);
        state = state.ramped(yaw_rate_rad_s, speed_m_s, tick.as_secs_f64());
    }
    assert!(state.x_m + profile.radius_m < 3.0);
    Ok(())
}
