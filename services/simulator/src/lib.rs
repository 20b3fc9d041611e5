//! A robot over a scene: the plant, ray-cast RGB-D and LiDAR, noise, ground truth, and a host for the two
//! model roles.
//!
//! It is one of two things behind [`robot::Robot`]; the other is hardware. No service asks which of them
//! it talks to. Ground truth leaves on a key of its own, which only the evaluation reads. Deliberately
//! not here: any decision about where to go.

pub mod answers;
pub mod base;
pub mod beat;
pub mod config;
pub mod footprint;
pub mod kept_frames;
pub mod mesh;
pub mod nouns;
pub mod oracle_models;
pub mod raycast;
pub mod scene;
pub mod sensor_noise;
pub mod sensors;
pub mod simulated_robot;
pub mod solid;
pub mod triangulate;
pub mod truth;
pub mod worker;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use geometry::Time;
use proto::{HeatMaps, HeatMapsRequest, ObjectDistance, Segments, SegmentsRequest, Truth, topics};
use service::{Inbox, Life, Question};

pub use config::SimulatorSettings;
use kept_frames::KeptFrames;
use oracle_models::Oracle;
use scene::{Hull, Scene};
use simulated_robot::{SimulatedRobot, State, World};
use truth::GroundTruth;

/// Runs the simulator until the process is asked to stop.
///
/// # Errors
/// When the scene cannot be read, or the network refuses.
pub async fn serve(life: Life, settings: SimulatorSettings) -> anyhow::Result<()> {
    let hull = Hull { radius_m: life.profile.radius_m, height_m: life.profile.height_m };
    let scene = Scene::load(&life.folder.join(&settings.scene), hull)?;
    let world = World::new(scene, &life.profile, &settings)?;
    tracing::info!(
        scene = world.scene.name,
        n_objects = world.scene.objects.len(),
        n_triangles = world.rays.n_triangles(),
        seed = settings.seed,
        "scene is ready"
    );
    let kept = Arc::new(KeptFrames::default());
    let robot = SimulatedRobot::new(&world, &life.profile, &settings, life.clock, Arc::clone(&kept))?;
    let oracle = Oracle::new(&world.scene, settings.models.errors(), settings.seed);

    let host = answer_questions(&life, oracle, kept, settings.models.delay_s).await?;
    let teller = tell_the_truth(&life, robot.state(), Arc::clone(&world.truth)).await?;
    life.ready().await?;
    let end = robot::drive(&life, robot, settings.drive).await;
    host.abort();
    teller.abort();
    end
}

/// Publishes ground truth at the topic's rate.
async fn tell_the_truth(
    life: &Life,
    state: Arc<Mutex<State>>,
    truth: Arc<GroundTruth>,
) -> anyhow::Result<tokio::task::JoinHandle<()>> {
    let publisher = life.bus.publisher::<Truth>(&topics::TRUTH).await?;
    let start = life.clock.now();
    let mut turns = tokio::time::interval(Duration::from_secs_f64(1.0 / topics::TRUTH.rate_hz));
    turns.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    Ok(tokio::spawn(async move {
        loop {
            turns.tick().await;
            let state = *state.lock().unwrap_or_else(PoisonError::into_inner);
            if let Err(e) = publisher.put(&truth_message(&truth, &state, start)) {
                tracing::warn!(error = format!("{e:#}"), "ground truth not published");
            }
        }
    }))
}

fn truth_message(truth: &GroundTruth, state: &State, start: Time) -> Truth {
    let centre_map = state.map_from_base.position();
    let objects = truth.objects(centre_map).into_iter().map(|gap| ObjectDistance {
        id: gap.id,
        any_height_m: gap.any_height_m,
        overhead_m: gap.overhead_m,
    });
    Truth {
        time_s: state.at.since(start).as_secs_f64(),
        map_from_base: state.map_from_base,
        twist: state.twist,
        clearance_m: truth.clearance_m(centre_map),
        n_collisions: state.n_collisions,
        objects: objects.collect(),
    }
}

/// A question to one of the two model roles.
enum Asked {
    HeatMaps(Question<HeatMapsRequest, HeatMaps>),
    Segments(Question<SegmentsRequest, Segments>),
}

/// Answers questions to the models, one after the other, each after `delay_s`.
async fn answer_questions(
    life: &Life,
    oracle: Oracle,
    kept: Arc<KeptFrames>,
    delay_s: f64,
) -> anyhow::Result<tokio::task::JoinHandle<()>> {
    let inbox: Inbox<Asked> = Inbox::new();
    life.bus.answer(&topics::HEAT_MAPS, &inbox, 4, Asked::HeatMaps).await?;
    life.bus.answer(&topics::SEGMENTS, &inbox, 4, Asked::Segments).await?;
    let host = Arc::new((oracle, kept));
    Ok(tokio::spawn(async move {
        loop {
            let asked = inbox.next().await;
            tokio::time::sleep(Duration::from_secs_f64(delay_s.max(0.0))).await;
            let host = Arc::clone(&host);
            // Some 10 ms of counting pixels: not on the threads that drive the base.
            let answered = tokio::task::spawn_blocking(move || answer(asked, &host.0, &host.1)).await;
            match answered.context("answer") {
                Ok(Ok(())) => {}
                Ok(Err(e)) | Err(e) => tracing::warn!(error = format!("{e:#}"), "question not answered"),
            }
        }
    }))
}

fn answer(asked: Asked, oracle: &Oracle, kept: &KeptFrames) -> anyhow::Result<()> {
    match asked {
        Asked::HeatMaps(question) => {
            let HeatMapsRequest { image, phrases } = &question.request;
            match answers::heat_maps(oracle, kept, image, phrases) {
                Ok(answer) => question.answer(&answer),
                Err(e) => {
                    question.refuse(&e.to_string());
                    Ok(())
                }
            }
        }
        Asked::Segments(question) => match answers::segments(oracle, kept, &question.request.image) {
            Ok(answer) => question.answer(&answer),
            Err(e) => {
                question.refuse(&e.to_string());
                Ok(())
            }
        },
    }
}
