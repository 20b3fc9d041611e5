//! A step of the fast path allocates nothing once it has run: time spent in the allocator has no bound.
//!
//! Not here: the first ticks of a kind, which make the room that later ones use.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]
#![allow(unsafe_code, reason = "an allocator that counts is an allocator")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use std::time::Duration;

use control::standard::service::{Start, starts};
use control::standard::{Sampling, Scene, StandardFilter};
use control::{Action, Filter, FilterConfig, Isa, Method};
use geometry::{Profile, Twist};

struct Counting;

thread_local! {
    static N_ALLOCATED: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is the system allocator's, with the arguments as they came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        N_ALLOCATED.with(|n| n.set(n.get() + 1));
        // SAFETY: the caller keeps the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn n_allocated(work: impl FnOnce()) -> u64 {
    let before = N_ALLOCATED.with(Cell::get);
    work();
    N_ALLOCATED.with(Cell::get) - before
}

/// A box in a square room, an exclusion and a slow zone.
fn scene() -> Scene {
    let to_box = |x: f64, y: f64, [bx, by, half]: [f64; 3]| {
        (((x - bx).abs() - half).max((y - by).abs() - half)) as f32
    };
    let place = |idx: usize| ((idx % 100) as f64 * 0.05, (idx / 100) as f64 * 0.05);
    let layer = |of: [f64; 3]| (0..10_000).map(|idx| to_box(place(idx).0, place(idx).1, of)).collect();
    let layers_m =
        vec![layer([2.5, 2.5, 0.4]), layer([1.0, 1.0, 0.2]), layer([4.0, 1.0, 0.2]), layer([1.0, 4.0, 0.3])];
    let states = (0..16).map(|k| {
        let turn = f64::from(k) * 0.4;
        [2.5 + 1.2 * turn.cos(), 2.5 + 1.2 * turn.sin(), turn + 3.0, 0.6, 0.2, 1.0]
    });
    let primitives = (0..25).map(|k| [f64::from(k % 5 - 2) / 2.0, f64::from(k / 5 - 2) * 1.5]);
    Scene { n_side: 100, layers_m, states: states.collect(), primitives: primitives.collect() }
}

#[test]
fn the_counter_counts() {
    assert_eq!(n_allocated(|| drop(std::hint::black_box(vec![1_u8; 10]))), 1);
}

#[test]
fn full_and_shipped_steps_allocate_nothing() {
    let scene = scene();
    let sampling = Sampling { n_samples: 50, n_rounds: 2, n_steps: 20, seed: 5 };
    for isa in Isa::available() {
        let mut filter = StandardFilter::new(isa, &scene, sampling);
        let mut v_m = 0.0;
        let found = n_allocated(|| {
            for (tick, state) in scene.states.iter().enumerate() {
                filter.begin(tick as u64);
                v_m += filter.shipped(*state).v_m + filter.full(*state).v_m;
            }
        });
        assert_eq!(found, 0, "{isa:?}");
        assert!(v_m.is_finite());
    }
}

#[test]
fn a_tick_among_certified_plans_whose_decision_is_taken_back_allocates_nothing() {
    let mut scene = scene();
    // Straight at the box, too, and past it, where the nominal control does not pass.
    let towards = (0..8).flat_map(|k| [2.5, 2.1].map(|y| [1.2 + 0.07 * f64::from(k), y, 0.0, 0.6, 0.1, 2.0]));
    scene.states.extend(towards);
    let starts = starts(&scene).unwrap();
    let profile = Profile::sim();
    let mut actions = std::collections::BTreeMap::new();
    for method in [Method::SmoothBlending, Method::LeastRestrictive] {
        let config =
            FilterConfig { method, n_samples: 1000, latency_s: 0.0, ..FilterConfig::for_profile(&profile) };
        for Start { state, nominal, world } in &starts {
            let mut filter = Filter::new(config.clone(), &profile).unwrap();
            let mut action = Action::Passed;
            let mut n = 0;
            for _ in 0..20 {
                n = n_allocated(|| {
                    let mut decision = filter.step(Duration::from_millis(50), *state, *nominal, world);
                    std::mem::swap(&mut action, &mut decision.action);
                    filter.take_back(decision);
                });
            }
            *actions.entry(format!("{action:?}")).or_insert(0) += 1;
            assert_eq!(n, 0, "{method:?} {action:?}");
        }
    }
    for action in ["Passed", "Blended", "Backup"] {
        assert!(actions.contains_key(action), "{actions:?}");
    }
}

#[test]
fn a_tick_that_looks_for_a_way_out_or_for_the_least_harm_allocates_nothing() {
    let mut scene = scene();
    let inside = [[1.0, 1.0, 0.3, 0.0], [1.1, 0.9, 2.0, 0.5], [4.1, 1.1, 4.0, 0.3], [4.0, 0.8, 1.0, 0.0]];
    let too_fast = [[1.62, 2.5, 0.0, 1.2], [1.55, 2.4, 0.1, 1.2], [2.5, 3.4, -1.6, 1.2]];
    let too_near = [[1.847, 2.5, 0.0, 0.0], [2.5, 3.152, -1.6, 0.0]];
    let stuck = [[1.835, 2.5, 0.0, 0.0], [1.84, 2.5, 0.0, 0.0], [2.5, 3.162, -1.57, 0.0]];
    let all = inside.iter().chain(&too_fast).chain(&too_near).chain(&stuck);
    scene.states = all.map(|[x, y, yaw, v]| [*x, *y, *yaw, *v, 0.0, 2.0]).collect();
    let starts = starts(&scene).unwrap();
    let profile = Profile::sim();
    let config = FilterConfig { latency_s: 0.0, ..FilterConfig::for_profile(&profile) };
    let mut kinds = std::collections::BTreeSet::new();
    for Start { state, nominal, world } in &starts {
        let mut filter = Filter::new(config.clone(), &profile).unwrap();
        // Twice the time for which ways out are kept, and for which a robot must be stuck, and more.
        for tick in 0..120 {
            let mut action = Action::Passed;
            // Once in a while an input that cannot be used.
            let nominal = if tick % 40 == 39 { Twist::new(f64::NAN, 0.0) } else { *nominal };
            let n = n_allocated(|| {
                let decision = filter.step(Duration::from_millis(50), *state, nominal, world);
                action.clone_from(&decision.action);
                filter.take_back(decision);
            });
            let kind: String = format!("{action:?}").chars().take_while(char::is_ascii_alphabetic).collect();
            // The copy of an action that names its rule is the test's own.
            let n_own = u64::from(matches!(action, Action::Recovering { rule: Some(_) }));
            assert!(tick < 80 || n == n_own, "{state:?} tick {tick} {action:?}: {n}");
            kinds.insert(kind);
        }
    }
    for kind in ["Recovering", "LeastHarm", "Unfreezing", "Braking"] {
        assert!(kinds.contains(kind), "{kinds:?}");
    }
}
