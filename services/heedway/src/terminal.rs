//! What the operator sees: lines, and on a terminal one status line below them that is rewritten.

use std::io::{IsTerminal, Write};

/// Most characters of a status line; what does not fit into the terminal is cut off by it.
const N_CHARS_MAX: usize = 300;

/// Standard output.
#[derive(Debug)]
pub struct Terminal {
    live: bool,
    status: String,
}

impl Terminal {
    /// Standard output; the status line is shown when it is a terminal.
    #[must_use]
    pub fn stdout() -> Self {
        Terminal { live: std::io::stdout().is_terminal(), status: String::new() }
    }

    /// The same without a status line.
    #[must_use]
    pub fn without_status(mut self) -> Self {
        self.clear_status();
        self.live = false;
        self
    }

    /// Whether a status line is shown.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Writes a line; the status line stays below it.
    pub fn line(&mut self, text: &str) {
        let status = std::mem::take(&mut self.status);
        if self.live && !status.is_empty() {
            write_out("\r\x1b[2K");
        }
        write_out(&format!("{text}\n"));
        self.status(&status);
    }

    /// Rewrites the status line; nothing when there is none, as in a pipe.
    pub fn status(&mut self, text: &str) {
        if !self.live || self.status == text {
            return;
        }
        text.clone_into(&mut self.status);
        let shown: String = text.chars().take(N_CHARS_MAX).collect();
        // Without wrapping: of a line that goes on below, only the last part could be rewritten.
        write_out(&format!("\r\x1b[2K\x1b[?7l{shown}\x1b[?7h"));
    }

    /// Takes the status line away.
    pub fn clear_status(&mut self) {
        if self.live && !self.status.is_empty() {
            write_out("\r\x1b[2K");
        }
        self.status.clear();
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.clear_status();
    }
}

/// A reader that has gone away, as in `heedway watch | head`, is no reason to stop a demonstration.
fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}
