//! `heedway say`: words to the robot, its answer back, and its question answered.

use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use proto::{Instruction, InstructionReply, topics};
use rules::Outcome;
use service::{Bus, Inbox, Received};
use tokio::io::{AsyncBufReadExt, BufReader};

use crate::connection::{PATIENCE, Reach, put_when_heard};
use crate::terminal::Terminal;

/// Exit code when the robot refuses.
const EXIT_REFUSED: u8 = 3;
/// Exit code when the robot asks back and nobody answers.
const EXIT_ASKED: u8 = 4;

/// Arguments of `heedway say`.
///
/// Exit codes: 0 accepted or lifted, 1 no answer, 3 refused, 4 a question that was left open.
#[derive(Args, Debug)]
pub struct Arguments {
    /// The words.
    #[arg(required = true)]
    text: Vec<String>,
    /// Who says them.
    #[arg(long, default_value = "")]
    speaker: String,
    #[command(flatten)]
    reach: Reach,
}

/// Says the words, and goes on until the robot has no question any more or the person gives no answer.
///
/// # Errors
/// When nobody is reached, or there is no reply within [`PATIENCE`].
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let bus = arguments.reach.open().await?;
    let inbox: Inbox<Received<InstructionReply>> = Inbox::new();
    bus.subscribe(&topics::REPLY, &inbox, 16, |reply| reply).await?;
    let clock = service::Clock::start();
    let mut lines = BufReader::new(tokio::io::stdin()).lines();
    let mut terminal = Terminal::stdout();
    let mut instruction = Instruction {
        speaker: arguments.speaker.clone(),
        id: format!("say-{}-{}", std::process::id(), clock.stamp_ns()),
        ..Instruction::plain(&arguments.text.join(" "))
    };
    loop {
        let reply = exchange(&bus, &inbox, &instruction).await?;
        told(&reply).iter().for_each(|line| terminal.line(line));
        match reply.reply.outcome {
            Outcome::Accept | Outcome::Revoke => return Ok(ExitCode::SUCCESS),
            Outcome::Refuse => return Ok(ExitCode::from(EXIT_REFUSED)),
            Outcome::Clarify if !std::io::stdin().is_terminal() => return Ok(ExitCode::from(EXIT_ASKED)),
            Outcome::Clarify => {}
        }
        terminal.line("Your answer (a number or words; empty to leave it):");
        let answer = lines.next_line().await.context("read the answer")?.unwrap_or_default();
        let Some(text) = picked(&reply, &answer) else { return Ok(ExitCode::from(EXIT_ASKED)) };
        instruction = Instruction {
            text,
            speaker: arguments.speaker.clone(),
            id: format!("say-{}-{}", std::process::id(), clock.stamp_ns()),
            answers: reply.id,
        };
    }
}

/// Puts an instruction and waits for the reply with its id.
///
/// # Errors
/// When nobody listens, or no reply comes within [`PATIENCE`].
pub async fn exchange(
    bus: &Bus,
    inbox: &Inbox<Received<InstructionReply>>,
    instruction: &Instruction,
) -> anyhow::Result<InstructionReply> {
    let payload = proto::encode(instruction).context("these words cannot be sent")?;
    put_when_heard(bus, &topics::INSTRUCTION, payload, PATIENCE)
        .await
        .with_context(|| format!("robot {} does not listen to words", bus.robot()))?;
    let answered = async {
        loop {
            let reply = inbox.next().await.message;
            if reply.id == instruction.id {
                return reply;
            }
        }
    };
    wait(answered, PATIENCE).await
}

async fn wait<T>(answered: impl Future<Output = T>, patience: Duration) -> anyhow::Result<T> {
    match tokio::time::timeout(patience, answered).await {
        Ok(answer) => Ok(answer),
        Err(_) => bail!("the robot heard it, but gave no reply within {} s", patience.as_secs()),
    }
}

/// What the person reads of a reply.
fn told(reply: &InstructionReply) -> Vec<String> {
    let mut lines = Vec::new();
    let question = reply.reply.question.clone().unwrap_or_default();
    if !reply.reply.say.is_empty() {
        lines.push(reply.reply.say.clone());
    }
    if !question.is_empty() && !reply.reply.say.contains(&question) {
        lines.push(question);
    }
    let options = reply.reply.options.iter().enumerate();
    lines.extend(options.map(|(idx, option)| format!("  {}) {}", idx + 1, option.label)));
    if lines.is_empty() {
        lines.push(format!("{:?}", reply.reply.outcome).to_lowercase());
    }
    lines
}

/// The words that an answer stands for: the label of a numbered option, else the answer itself.
fn picked(reply: &InstructionReply, answer: &str) -> Option<String> {
    let answer = answer.trim();
    if answer.is_empty() {
        return None;
    }
    let option = answer.parse::<usize>().ok().and_then(|n| reply.reply.options.get(n.checked_sub(1)?));
    Some(option.map_or_else(|| answer.to_owned(), |option| option.label.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::{Reply, ReplyOption};

    fn question() -> InstructionReply {
        let plain = Reply {
            question: Some("How far?".into()),
            say: "How far?".into(),
            ..Reply::of(Outcome::Clarify)
        };
        let option = |label: &str| ReplyOption { label: label.into(), reply: plain.clone() };
        let reply = Reply { options: vec![option("0.3 m"), option("1 m")], ..plain.clone() };
        InstructionReply {
            id: "q".into(),
            speaker: String::new(),
            text: "keep away from the rug".into(),
            reply,
            rules_version: 0,
        }
    }

    #[test]
    fn a_question_is_shown_once_with_numbered_options() {
        assert_eq!(told(&question()), ["How far?", "  1) 0.3 m", "  2) 1 m"]);
    }

    #[test]
    fn a_number_picks_an_option_and_other_words_are_sent_as_they_are() {
        let check = |answer: &str, wanted: Option<&str>| {
            assert_eq!(picked(&question(), answer).as_deref(), wanted, "answer {answer:?}");
        };
        check("1", Some("0.3 m"));
        check(" 2\n", Some("1 m"));
        check("0", Some("0"));
        check("3", Some("3"));
        check("half a metre", Some("half a metre"));
        check("  ", None);
    }
}
