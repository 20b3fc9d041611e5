//! The standard problem as the service meets it: a world of layers and rules, a live scan, a set-point.

use std::sync::Arc;

use geometry::{Point2, Profile, Twist};
use mapping::{DistanceField, GridError, Layout, Shape};

use super::{
    BUFFER_M, CELL_M, RADIUS_M, SLOW_BUFFER_M, SLOW_LAYER, SLOW_SPEED_M_S, SPEED_M_S_LIMIT, STEP_S, Scene,
    YAW_RATE_RAD_S_LIMIT,
};
use crate::dynamics::{Control, Limits, State};
use crate::margin::{BaseLayer, Demand, RuleLayer, World};

/// Beams of the simulated scan.
const N_BEAMS: usize = 360;
/// Range of the simulated scan, metres.
const RANGE_M: f64 = 10.0;
/// As near as this is a hit, metres.
const HIT_M: f64 = 0.01;

/// One start of the service's step.
#[derive(Clone, Debug)]
pub struct Start {
    /// Where the robot is.
    pub state: State,
    /// What is asked of it.
    pub nominal: Twist,
    /// What there is, the scan seen from here included.
    pub world: World,
}

/// The starts of a scene, for [`crate::Filter::step`] with the profile `sim`.
///
/// # Errors
/// [`GridError`] when a layer is no distance field.
pub fn starts(scene: &Scene) -> Result<Vec<Start>, GridError> {
    let world = world(scene)?;
    let limits = Limits::of(&Profile::sim());
    let starts = scene.states.iter().map(|&[x_m, y_m, yaw_rad, speed_m_s, rate, accel]| {
        let state = State { x_m, y_m, yaw_rad, speed_m_s };
        let wanted = limits.clamped(Control { yaw_rate_rad_s: rate, accel_m_s2: accel });
        let wanted_m_s = limits.speed_after(speed_m_s, wanted.accel_m_s2, STEP_S);
        let mut world = world.clone();
        world.points = world.base.first().map_or_else(Vec::new, |layer| scan(&layer.field, state));
        Start { state, nominal: Twist::new(wanted_m_s, wanted.yaw_rate_rad_s), world }
    });
    Ok(starts.collect())
}

/// The layers as base map and rules. The buffers hold the radius in the standard problem, ours do not.
fn world(scene: &Scene) -> Result<World, GridError> {
    let shape = Shape { n_cols: scene.n_side, n_rows: scene.n_side };
    // Values lie at cells' centres there, at (0.05 i, 0.05 j) here.
    let layout = Layout::new(Point2::new(-CELL_M / 2.0, -CELL_M / 2.0), CELL_M, shape)?;
    let mut world = World::default();
    let mut rules = vec![Demand::Limit {
        zone: None,
        buffer_m: 0.0,
        speed_m_s_max: Some(SPEED_M_S_LIMIT),
        yaw_rate_rad_s_max: Some(YAW_RATE_RAD_S_LIMIT),
    }];
    for (idx, values_m) in scene.layers_m.iter().enumerate() {
        let field = Arc::new(DistanceField::from_values(layout, values_m.clone())?);
        match idx {
            0 => world.base.push(BaseLayer { name: "the map".into(), field }),
            SLOW_LAYER => rules.push(Demand::Limit {
                zone: Some(field),
                buffer_m: SLOW_BUFFER_M - RADIUS_M,
                speed_m_s_max: Some(SLOW_SPEED_M_S),
                yaw_rate_rad_s_max: None,
            }),
            _ => rules.push(Demand::Exclusion { zone: field, buffer_m: BUFFER_M - RADIUS_M }),
        }
    }
    let named = rules.into_iter().enumerate();
    world.rules =
        named.map(|(idx, demand)| RuleLayer { id: format!("s{idx}"), label: "it".into(), demand }).collect();
    Ok(world)
}

/// What a LiDAR would hit of a field, by sphere tracing.
fn scan(field: &DistanceField, from: State) -> Vec<Point2> {
    let beams = (0..N_BEAMS).map(|beam| std::f64::consts::TAU * beam as f64 / N_BEAMS as f64);
    let hits = beams.filter_map(|angle_rad| {
        let (sin, cos) = (from.yaw_rad + angle_rad).sin_cos();
        let mut gone_m = 0.0;
        while gone_m < RANGE_M {
            let place = Point2::new(from.x_m + cos * gone_m, from.y_m + sin * gone_m);
            let free_m = field.sample(place);
            if free_m <= HIT_M {
                return Some(place);
            }
            // A bilinear field may rise a little faster than distance does.
            gone_m += (0.7 * free_m).max(0.005);
        }
        None
    });
    hits.collect()
}
