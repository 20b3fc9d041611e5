//! One process of a fleet: started, watched, killed; its log kept.

use std::io::{Read, Seek, SeekFrom};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use anyhow::{Context, bail};
use tokio::process::{Child, Command};

use crate::carry::ServiceName;

/// How much of the end of a log is read, bytes.
const N_TAIL_BYTES: u64 = 16 * 1024;
/// How many of its lines are shown.
const N_TAIL_LINES: usize = 12;

/// One process.
pub(super) struct Member {
    name: ServiceName,
    program: PathBuf,
    config: PathBuf,
    log: PathBuf,
    child: Option<Child>,
}

/// A service that has died without having been told to.
#[derive(Debug)]
pub struct Death {
    /// Which service.
    pub service: ServiceName,
    /// How it ended.
    pub status: ExitStatus,
    /// Its log.
    pub log: PathBuf,
    /// The log's last lines.
    pub tail: String,
}

impl std::fmt::Display for Death {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Death { service, status, log, tail } = self;
        write!(f, "{service} has died: {status}\n{tail}\nits log: {}", log.display())
    }
}

impl std::error::Error for Death {}

impl Member {
    pub(super) fn new(name: ServiceName, program: PathBuf, config: PathBuf, log: PathBuf) -> Self {
        Member { name, program, config, log, child: None }
    }

    /// Starts the process; its log is appended to.
    pub(super) fn start(&mut self) -> anyhow::Result<()> {
        if self.child.is_some() {
            bail!("{} runs already", self.name);
        }
        let open_log = || {
            std::fs::OpenOptions::new()
                .create(true)
                .append(true)
                .open(&self.log)
                .with_context(|| format!("open {}", self.log.display()))
        };
        let mut command = Command::new(&self.program);
        command
            .args(["service", self.name.as_str(), "--config"])
            .arg(&self.config)
            .stdin(Stdio::null())
            .stdout(open_log()?)
            .stderr(open_log()?)
            // Ctrl-C goes to the whole foreground group; it is this process that stops the others.
            .process_group(0)
            .kill_on_drop(true);
        die_with_this_thread(&mut command);
        let child =
            command.spawn().with_context(|| format!("start {} {}", self.program.display(), self.name))?;
        self.child = Some(child);
        Ok(())
    }

    pub(super) fn pid(&self) -> Option<u32> {
        self.child.as_ref().and_then(Child::id)
    }

    /// How it ended, if it has; then it may be started again.
    pub(super) fn death(&mut self) -> anyhow::Result<Option<Death>> {
        let Some(child) = self.child.as_mut() else { return Ok(None) };
        let Some(status) = child.try_wait().with_context(|| format!("look after {}", self.name))? else {
            return Ok(None);
        };
        self.child = None;
        let tail = tail(&self.log);
        Ok(Some(Death { service: self.name, status, log: self.log.clone(), tail }))
    }

    /// Kills it with SIGKILL and waits until it is gone.
    pub(super) async fn kill(&mut self) -> anyhow::Result<()> {
        let Some(mut child) = self.child.take() else { bail!("{} does not run", self.name) };
        child.kill().await.with_context(|| format!("kill {}", self.name))
    }

    pub(super) fn signal(&mut self, signal: i32) -> anyhow::Result<()> {
        let Some(pid) = self.pid().and_then(|pid| i32::try_from(pid).ok()) else {
            bail!("{} does not run", self.name)
        };
        send_signal(pid, signal).with_context(|| format!("signal {signal} to {}", self.name))
    }

    /// Sends SIGTERM; one that is gone already needs none.
    pub(super) fn ask_to_stop(&mut self) {
        // A paused process takes the signal only once it goes on.
        let _ = self.signal(libc::SIGCONT);
        let _ = self.signal(libc::SIGTERM);
    }

    /// Waits for its end; kills it when `patience` is over.
    pub(super) async fn wait_or_kill(&mut self, patience: Duration) -> anyhow::Result<()> {
        let Some(mut child) = self.child.take() else { return Ok(()) };
        match tokio::time::timeout(patience, child.wait()).await {
            Ok(status) => {
                let status = status.with_context(|| format!("wait for {}", self.name))?;
                // Told to stop before it listened for signals: it had nothing to end in order yet.
                let before_listening = status.signal() == Some(libc::SIGTERM);
                if status.success() || before_listening {
                    Ok(())
                } else {
                    bail!("{} ended with {status}", self.name)
                }
            }
            Err(_) => {
                child.kill().await.with_context(|| format!("kill {}", self.name))?;
                bail!("{} did not stop within {} s and was killed", self.name, patience.as_secs())
            }
        }
    }
}

/// The last lines of a log, or why they cannot be read.
pub(super) fn tail(log: &Path) -> String {
    let read = || -> std::io::Result<String> {
        let mut file = std::fs::File::open(log)?;
        let n_bytes = file.metadata()?.len();
        file.seek(SeekFrom::Start(n_bytes.saturating_sub(N_TAIL_BYTES)))?;
        let mut bytes = Vec::new();
        file.take(N_TAIL_BYTES).read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    match read() {
        Ok(text) => {
            let lines: Vec<&str> = text.lines().collect();
            lines.get(lines.len().saturating_sub(N_TAIL_LINES)..).unwrap_or_default().join("\n")
        }
        Err(e) => format!("{}: {e}", log.display()),
    }
}

/// Has the kernel kill the child when the thread that starts it dies, however it dies.
#[allow(unsafe_code, reason = "there is no safe way to run prctl between fork and exec")]
fn die_with_this_thread(command: &mut Command) {
    let parent = std::process::id();
    // SAFETY: between fork and exec only async-signal-safe calls are made: prctl, getppid and building
    // an error from a number, which does not allocate.
    unsafe {
        command.pre_exec(move || {
            if libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) != 0 {
                return Err(std::io::Error::last_os_error());
            }
            // The parent may have died before the line above.
            if u32::try_from(libc::getppid()).ok() != Some(parent) {
                return Err(std::io::Error::from_raw_os_error(libc::ESRCH));
            }
            Ok(())
        });
    }
}

#[allow(unsafe_code, reason = "the standard library cannot send signals")]
fn send_signal(pid: i32, signal: i32) -> std::io::Result<()> {
    // SAFETY: kill takes two numbers and touches no memory of this process. The pid is of a child that
    // has not been waited for, so that it cannot have been given to another process.
    if unsafe { libc::kill(pid, signal) } == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}
