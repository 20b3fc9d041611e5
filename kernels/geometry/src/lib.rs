//! Poses, twists, angles, cameras, time, and the profile of a robot.
//!
//! Everything else is built on these words. Frames are `map`, `odom`, `base` and `camera`: x forward,
//! y left, z up, except `camera`, which is optical (x right, y down, z forward). A pose is named
//! `<to>_from_<from>`, so that equal names touch in a product: `map_from_camera = map_from_base *
//! base_from_camera`. Lengths are metres, angles radians, counter-clockwise from +x, all in `f64`.
//!
//! Deliberately not here: dynamics (`control`), grids (`mapping`), and anything that reads a clock.

pub mod angle;
pub mod camera;
pub mod polygon;
pub mod pose;
pub mod profile;
pub mod time;
pub mod twist;

pub use camera::{CameraIntrinsics, IntrinsicsError};
pub use polygon::{Polygon, PolygonError};
pub use pose::{Point2, Point3, Pose2, Pose3};
pub use profile::{Profile, ProfileError};
pub use time::Time;
pub use twist::Twist;
