//! `heedway watch`: what a robot does and why, live.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use service::Inbox;

use crate::board::Board;
use crate::connection::{PATIENCE, Reach};
use crate::hearing::{Heard, listen_to_all};
use crate::terminal::Terminal;

/// How often the status line is rewritten.
const REFRESH: Duration = Duration::from_millis(200);

/// Arguments of `heedway watch`.
#[derive(Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    reach: Reach,
}

/// Shows one line a change of state, and on a terminal a live status line, until Ctrl-C.
///
/// # Errors
/// When nobody is reached, or nothing is heard of the robot for [`PATIENCE`] after the start.
pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let bus = arguments.reach.open().await?;
    let inbox: Inbox<Heard> = Inbox::new();
    listen_to_all(&bus, &inbox).await?;
    let mut terminal = Terminal::stdout();
    let mut board = Board::default();

    let Ok(first) = tokio::time::timeout(PATIENCE, inbox.next()).await else {
        anyhow::bail!(
            "nothing heard of robot {:?} at {} within {} s",
            arguments.reach.robot,
            arguments.reach.connect,
            PATIENCE.as_secs()
        );
    };
    board.hear(&first).iter().for_each(|line| terminal.line(line));
    let mut refresh = tokio::time::interval(REFRESH);
    loop {
        tokio::select! {
            heard = inbox.next() => board.hear(&heard).iter().for_each(|line| terminal.line(line)),
            _ = refresh.tick() => terminal.status(&board.line()),
            end = tokio::signal::ctrl_c() => {
                end?;
                return Ok(ExitCode::SUCCESS);
            }
        }
    }
}
