//! `heedway bench instruction`: from words to the filter that holds them, measured on this host.
//!
//! It starts every service as its own process over the office scene, as the demonstration does. It prints
//! figures and judges none.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use proto::{Instruction, InstructionReply, RulesHeld, topics};
use service::{Bus, Clock, Inbox, Publisher};

use crate::carry::ServiceName;
use crate::fleet::{Fleet, FleetOptions};
use crate::terminal::Terminal;

/// How long the services are given to come alive, and an instruction to be held.
const PATIENCE: Duration = Duration::from_secs(60);

/// Arguments of `heedway bench instruction`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// How many instructions.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    n: u32,
    /// Seed of everything random in the simulation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object instead of words.
    #[arg(long)]
    json: bool,
}

/// What is heard of an instruction.
enum Heard {
    Reply(InstructionReply),
    Held(RulesHeld),
}

/// Measures.
///
/// # Errors
/// When a service does not come alive, or an instruction is not held in time.
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let program = std::env::current_exe().context("where this program lies")?;
    let options = FleetOptions { seed: arguments.seed, ..FleetOptions::office(program) };
    let mut fleet = Fleet::launch(options).await?;
    fleet.wait_until_alive(PATIENCE).await?;
    let measured = measure(fleet.bus(), arguments.n).await;
    let measured = measured.with_context(|| fleet.log_tail(ServiceName::Language))?;
    fleet.stop().await?;
    let [replied, held] = [Figures::of(measured.replied), Figures::of(measured.held)];
    let mut terminal = Terminal::stdout();
    if arguments.json {
        let value =
            serde_json::json!({"n": arguments.n, "replied_ms": replied.as_json(), "held_ms": held.as_json()});
        terminal.line(&value.to_string());
    } else {
        terminal.line(&format!("{} instructions, all services running, milliseconds:", arguments.n));
        terminal.line(&format!("  to the reply                     {}", replied.as_words()));
        terminal.line(&format!("  to the filter's acknowledgement  {}", held.as_words()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Times from each instruction.
#[derive(Default)]
struct Measured {
    replied: Vec<Duration>,
    held: Vec<Duration>,
}

async fn measure(bus: &Bus, n: u32) -> anyhow::Result<Measured> {
    let inbox: Inbox<Heard> = Inbox::new();
    bus.subscribe(&topics::REPLY, &inbox, 64, |received| Heard::Reply(received.message)).await?;
    bus.subscribe(&topics::RULES_HELD, &inbox, 64, |received| Heard::Held(received.message)).await?;
    let words = bus.publisher(&topics::INSTRUCTION).await?;
    // Until the first answer the connections are being made.
    one(&inbox, &words, "warm-up", "stay off the rug").await?;
    let mut measured = Measured::default();
    for round in 0..n {
        let text = if round % 2 == 0 { "keep 0.4 m away from the lamp" } else { "forget the lamp" };
        let (replied, held) = one(&inbox, &words, &format!("bench-{round}"), text).await?;
        measured.replied.push(replied);
        measured.held.push(held);
    }
    Ok(measured)
}

/// Says one instruction; how long until its reply, and until the filter holds what came of it.
async fn one(
    inbox: &Inbox<Heard>,
    words: &Publisher<Instruction>,
    id: &str,
    text: &str,
) -> anyhow::Result<(Duration, Duration)> {
    let clock = Clock::start();
    let said = clock.now();
    words.put(&Instruction { id: id.to_owned(), ..Instruction::plain(text) })?;
    let mut replied: Option<(Duration, u64)> = None;
    let mut version_held = 0;
    let mut held_at = Duration::ZERO;
    let both = async {
        loop {
            match inbox.next().await {
                Heard::Reply(reply) if reply.id == id => {
                    replied = Some((clock.now().since(said), reply.rules_version))
                }
                // The first word of a version counts; it is repeated.
                Heard::Held(held)
                    if held.service == ServiceName::Filter.as_str() && held.version > version_held =>
                {
                    (version_held, held_at) = (held.version, clock.now().since(said));
                }
                _ => {}
            }
            if let Some((replied_at, version)) = replied
                && version_held >= version
            {
                return (replied_at, held_at.max(replied_at));
            }
        }
    };
    match tokio::time::timeout(PATIENCE, both).await {
        Ok(times) => Ok(times),
        Err(_) => bail!("{text:?} was not held by the filter within {} s", PATIENCE.as_secs()),
    }
}

/// Percentiles, milliseconds.
struct Figures {
    sorted_ms: Vec<f64>,
}

impl Figures {
    fn of(times: Vec<Duration>) -> Figures {
        let mut sorted_ms: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
        sorted_ms.sort_by(f64::total_cmp);
        Figures { sorted_ms }
    }

    /// The smallest value that this share does not exceed; 0 without values.
    fn at(&self, share: f64) -> f64 {
        let rank = (share * self.sorted_ms.len() as f64).ceil() as usize;
        self.sorted_ms.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
    }

    fn as_words(&self) -> String {
        let [p50, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| self.at(share));
        format!("median {p50:.1}, p95 {p95:.1}, p99 {p99:.1}, most {max:.1}")
    }

    fn as_json(&self) -> serde_json::Value {
        let [p50, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| self.at(share));
        serde_json::json!({"p50": p50, "p95": p95, "p99": p99, "max": max})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_is_a_value_that_was_measured() {
        let figures = Figures::of((1..=200).rev().map(Duration::from_millis).collect());
        assert_eq!([figures.at(0.5), figures.at(0.99), figures.at(1.0)], [100.0, 198.0, 200.0]);
        assert_eq!(Figures::of(vec![]).at(0.99), 0.0);
    }
}
