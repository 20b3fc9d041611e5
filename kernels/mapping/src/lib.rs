//! From sensors to maps: grids, distance fields, masks, TSDF, occupancy by relation, the base map.
//!
//! The way of a word through this crate: a heat map and segments become an exact mask
//! ([`segments::fuse`]), masked depth becomes a sparse TSDF of the object ([`tsdf::Tsdf`]) or, for rugs and
//! pools, an area of floor ([`floor_area::FloorArea`]), its surface becomes a footprint
//! ([`occupancy::footprint`]) and the footprint the region its relation names ([`region::region`]),
//! whose signed distance ([`distance::signed_distance`]) is what a filter asks. Beside it lie the base map
//! from laser scans ([`base_map::BaseMapper`]) and what depth sees that a laser does not
//! ([`obstacle_layer::ObstacleLayer`]).
//!
//! All grids lie in `map`. Not here: models, poses' estimation, transport, and what any of it means
//! for motion.

pub mod base_map;
mod bits;
pub mod distance;
pub mod field;
pub mod floor_area;
pub mod floor_plane;
pub mod grid;
pub mod image;
pub mod isa;
pub mod localise;
pub mod map_file;
pub mod morphology;
pub mod obstacle_layer;
pub mod occupancy;
pub mod projection;
pub mod raster;
pub mod region;
pub mod scan_match;
pub mod segments;
pub mod slam;
pub mod tsdf;

pub use distance::{ChangingField, signed_distance, squared_distance_cells};
pub use field::{DistanceField, Spot};
pub use grid::{Cell, Grid, GridError, Layout, Occupancy, Shape};
pub use image::{DepthFrame, DepthImage, ImageError, Mask};
pub use segments::{FusedMask, Fusion, HeatMap, Segments, fuse};
