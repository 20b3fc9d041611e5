//! `heedway bench edt|raycast|astar`: what is done with a floor plan, timed on made-up ones.

use std::f64::consts::TAU;
use std::process::ExitCode;

use clap::Args;
use control::astar::shortest_path;
use control::costmap::Costmap;
use geometry::{Point2, Pose2, Profile};
use mapping::base_map::{BaseMapConfig, BaseMapper, Scan};
use mapping::{Cell, ChangingField, Occupancy, signed_distance, squared_distance_cells};
use serde::Serialize;
use service::Clock;

use super::timing::Times;
use super::worlds;

/// Times that a row is the median of.
const N_TIMES: usize = 15;
/// Sides of the floors that are transformed, cells.
const EDT_SIDES: [usize; 3] = [200, 400, 2000];
/// Side of an object of a metre, cells.
const OBJECT_CELLS: usize = 20;
/// Beams of a scan.
const N_BEAMS: usize = 360;
/// The maze: cells a side, width of its corridors, and how many different ones.
const MAZE_SIDE: usize = 400;
const CORRIDOR_CELLS: usize = 19;
const N_MAZES: u64 = 9;

/// Arguments of these benches.
#[derive(Args, Debug)]
pub struct Arguments {
    /// One JSON object a line instead of a table.
    #[arg(long)]
    json: bool,
    /// Seed of the floors.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// What one row says.
#[derive(Serialize)]
struct Row {
    bench: &'static str,
    n: usize,
    occupied_share: f64,
    median_ms: f64,
    mean_ms: f64,
    times: usize,
}

/// The distance transform: squared distances, the signed field that the filter asks, and how that is kept up when an
/// object of a metre comes or goes.
///
/// # Errors
/// Never at present: the floors are right.
pub fn edt(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let clock = Clock::start();
    for n in EDT_SIDES {
        let floor = worlds::cluttered(n, arguments.seed)?;
        let share = floor.values().iter().filter(|o| **o).count() as f64 / floor.values().len() as f64;
        let (mut squared, mut signed) = (Times::default(), Times::default());
        for _ in 0..N_TIMES {
            squared.time(&clock, || std::hint::black_box(squared_distance_cells(&floor)));
            signed.time(&clock, || std::hint::black_box(signed_distance(&floor)));
        }
        let (mut changing, mut updates) = (ChangingField::new(floor), Times::default());
        let mut places = worlds::Draws::new(arguments.seed);
        for _ in 0..10 * N_TIMES {
            let (col, row) = (places.below(n - OBJECT_CELLS), places.below(n - OBJECT_CELLS));
            let cells = (0..OBJECT_CELLS * OBJECT_CELLS)
                .map(|nth| Cell { col: col + nth % OBJECT_CELLS, row: row + nth / OBJECT_CELLS });
            let before: Vec<_> = cells.clone().map(|cell| (cell, *changing.occupied().get(cell))).collect();
            updates.time(&clock, || changing.change(cells.map(|cell| (cell, true))));
            updates.time(&clock, || changing.change(before));
        }
        tell(arguments.json, "edt", n, share, &squared)?;
        tell(arguments.json, "edt_signed", n, share, &signed)?;
        tell(arguments.json, "edt_update", n, share, &updates)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Beams of a scan followed through the base map and drawn into it.
///
/// # Errors
/// When the map refuses a scan.
pub fn raycast(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let clock = Clock::start();
    for range_m in [3.0_f32, 8.0, 20.0] {
        let mut draws = worlds::Draws::new(arguments.seed);
        let ranges_m: Vec<f32> =
            (0..N_BEAMS).map(|_| range_m * (0.5 + draws.below(1000) as f32 / 1000.0)).collect();
        let scan = Scan {
            ranges_m: &ranges_m,
            angle_min_rad: 0.0,
            angle_increment_rad: TAU / N_BEAMS as f64,
            range_min_m: 0.05,
            range_max_m: 100.0,
            no_return_is_free: false,
        };
        let config = BaseMapConfig { range_used_m: 100.0, ..BaseMapConfig::default() };
        let mut mapper = BaseMapper::new(config, Point2::origin())?;
        // The map has grown before it is timed.
        mapper.integrate(&scan, Pose2::IDENTITY)?;
        let mut times = Times::default();
        for _ in 0..10 * N_TIMES {
            times.time(&clock, || mapper.integrate(&scan, Pose2::IDENTITY))?;
        }
        let name = match range_m as u32 {
            3 => "raycast_3m",
            8 => "raycast_8m",
            _ => "raycast_20m",
        };
        tell(arguments.json, name, N_BEAMS, f64::NAN, &times)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The shortest path through mazes, corner to corner.
///
/// # Errors
/// When a maze has no way through, which would be a fault of the maze.
pub fn astar(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let clock = Clock::start();
    let mut times = Times::default();
    let mut share = 0.0;
    let profile = Profile::sim();
    for seed in 0..N_MAZES {
        let walls = worlds::maze(MAZE_SIDE, CORRIDOR_CELLS, arguments.seed.wrapping_add(seed))?;
        share = walls.values().iter().filter(|o| **o).count() as f64 / walls.values().len() as f64;
        let floor = walls.map(|wall| if *wall { Occupancy::Occupied } else { Occupancy::Free });
        let map = Costmap::new(&floor, &[], 0.05, &profile);
        let pitch = CORRIDOR_CELLS + 1;
        let last = ((MAZE_SIDE - 1) / pitch - 1) * pitch;
        let middle = |cell: usize| (cell as f64 + 1.0 + CORRIDOR_CELLS as f64 / 2.0) * worlds::CELL_M;
        let (start, goal) = (Point2::new(middle(0), middle(0)), Point2::new(middle(last), middle(last)));
        for _ in 0..5 {
            times.time(&clock, || shortest_path(&map, start, goal))?;
        }
    }
    tell(arguments.json, "astar_maze", MAZE_SIDE, share, &times)?;
    Ok(ExitCode::SUCCESS)
}

#[allow(clippy::print_stdout, reason = "the table is what was asked for")]
fn tell(json: bool, bench: &'static str, n: usize, occupied_share: f64, times: &Times) -> anyhow::Result<()> {
    let (median_ms, mean_ms, times) = (times.median_ms(), times.mean_ms(), times.n());
    if json {
        let row = Row { bench, n, occupied_share, median_ms, mean_ms, times };
        println!("{}", serde_json::to_string(&row)?);
    } else {
        println!("{bench:12} {n:5}  median {median_ms:8.3} ms  mean {mean_ms:8.3} ms  {times} times");
    }
    Ok(())
}
