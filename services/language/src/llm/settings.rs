//! `[language.llm]`: which model, where, with which key, and how long to wait for it.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use proto::{Invalid, codec};
use serde::{Deserialize, Serialize};

use super::RetryPolicy;

/// How the key is sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Authentication {
    /// `authorization: Bearer KEY`, as nearly everybody does.
    #[default]
    Bearer,
    /// `api-key: KEY`, as Azure does.
    ApiKey,
}

/// The `[language.llm]` section. It holds no secret: the key is in the environment or in a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LlmSettings {
    /// Up to where `/chat/completions` begins: `https://api.openai.com/v1`, `http://127.0.0.1:8080/v1`.
    /// A query, as Azure's `?api-version=…`, is kept.
    pub base_url: String,
    /// The model's name, as the server knows it.
    pub model: String,
    /// Environment variable that holds the key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_env: Option<String>,
    /// File that holds the key; relative to the folder of the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_file: Option<PathBuf>,
    /// How the key is sent.
    #[serde(default)]
    pub authentication: Authentication,
    /// How long one try may take, seconds.
    #[serde(default = "default_timeout_s")]
    pub timeout_s: f64,
    /// How many tries may follow the first.
    #[serde(default = "default_retries")]
    pub retries: u32,
    /// Pause before the second try, seconds; it doubles from try to try.
    #[serde(default = "default_retry_pause_s")]
    pub retry_pause_s: f64,
    /// Longest answer that is read, bytes.
    #[serde(default = "default_n_reply_bytes_max")]
    pub n_reply_bytes_max: usize,
    /// Folder of the prompt; the built-in one when absent. Relative to the folder of the configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt: Option<PathBuf>,
}

/// Chosen: twice what a hosted model takes for an answer of this size.
fn default_timeout_s() -> f64 {
    20.0
}

/// Chosen: a person waits; after three tries the offline parser is the better answer.
fn default_retries() -> u32 {
    2
}

fn default_retry_pause_s() -> f64 {
    0.5
}

/// Chosen: ten times the longest answer of the worked examples.
fn default_n_reply_bytes_max() -> usize {
    32 * 1024
}

/// Longest key, bytes.
const N_KEY_BYTES_MAX: u64 = 8 * 1024;

impl LlmSettings {
    /// What the environment tells: `HEEDWAY_LLM_BASE_URL`, `HEEDWAY_LLM_MODEL`, and the key in
    /// `HEEDWAY_LLM_KEY` where one is needed; for commands without a configuration.
    ///
    /// # Errors
    /// Names the variable that is missing or cannot be used.
    pub fn from_environment() -> anyhow::Result<LlmSettings> {
        const KEY: &str = "HEEDWAY_LLM_KEY";
        let needed = |name: &str| {
            let value = std::env::var(name).ok().filter(|value| !value.trim().is_empty());
            value.with_context(|| format!("no language model is configured: set {name}, or name a --config"))
        };
        let settings = LlmSettings {
            base_url: needed("HEEDWAY_LLM_BASE_URL")?,
            model: needed("HEEDWAY_LLM_MODEL")?,
            key_env: std::env::var_os(KEY).map(|_| KEY.to_owned()),
            key_file: None,
            authentication: Authentication::default(),
            timeout_s: default_timeout_s(),
            retries: default_retries(),
            retry_pause_s: default_retry_pause_s(),
            n_reply_bytes_max: default_n_reply_bytes_max(),
            prompt: None,
        };
        settings.check().context("HEEDWAY_LLM_…")?;
        Ok(settings)
    }

    /// Checks what the types do not.
    ///
    /// # Errors
    /// [`Invalid`] names the key, the value and the limit.
    pub fn check(&self) -> Result<(), Invalid> {
        let bad_url = |limit: &str| Err(Invalid::new("llm.base_url", &self.base_url, limit));
        match reqwest::Url::parse(&self.base_url) {
            Ok(url) if !["http", "https"].contains(&url.scheme()) => return bad_url("http:// or https://"),
            // The effective configuration is logged.
            Ok(url) if !url.username().is_empty() || url.password().is_some() => {
                return Err(Invalid::new(
                    "llm.base_url",
                    "holding a user or password",
                    "without; use key_env",
                ));
            }
            Ok(_) => {}
            Err(_) => return bad_url("a URL"),
        }
        // The rules carry it as `llm:MODEL`.
        let n_chars = self.model.chars().count();
        if !(1..=100).contains(&n_chars) {
            return Err(Invalid::new("llm.model", format_args!("{n_chars} characters"), "1 to 100"));
        }
        if self.key_env.is_some() && self.key_file.is_some() {
            return Err(Invalid::new("llm.key_file", "there beside key_env", "only one of them"));
        }
        codec::within("llm.timeout_s", self.timeout_s, 0.05, 300.0)?;
        codec::within("llm.retries", f64::from(self.retries), 0.0, 5.0)?;
        codec::within("llm.retry_pause_s", self.retry_pause_s, 0.0, 10.0)?;
        codec::within("llm.n_reply_bytes_max", self.n_reply_bytes_max as f64, 1024.0, 65_536.0)
    }

    /// The key, if there is one.
    ///
    /// # Errors
    /// When the variable or the file that is named holds none. The message does not hold the key.
    pub fn key(&self, folder: &Path) -> anyhow::Result<Option<String>> {
        let (key, place) = match (&self.key_env, &self.key_file) {
            (Some(name), _) => {
                let key = std::env::var(name).ok().with_context(|| {
                    format!("llm.key_env: environment variable {name} is not set, or not UTF-8")
                })?;
                (key, format!("llm.key_env: environment variable {name}"))
            }
            (None, Some(file)) => {
                let file = folder.join(file);
                let place = format!("llm.key_file: {}", file.display());
                (read_key(&file).with_context(|| place.clone())?, place)
            }
            (None, None) => return Ok(None),
        };
        let key = key.trim();
        anyhow::ensure!(!key.is_empty(), "{place} is empty");
        anyhow::ensure!(
            key.chars().all(|c| c.is_ascii_graphic()),
            "{place} holds more than one printable word"
        );
        Ok(Some(key.to_owned()))
    }

    /// When to try again.
    #[must_use]
    pub fn policy(&self) -> RetryPolicy {
        RetryPolicy {
            n_retries: self.retries as usize,
            first_pause: Duration::from_secs_f64(self.retry_pause_s.clamp(0.0, 10.0)),
        }
    }

    /// How long one try may take.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        Duration::from_secs_f64(self.timeout_s.clamp(0.05, 300.0))
    }
}

fn read_key(file: &Path) -> anyhow::Result<String> {
    let n_bytes = std::fs::metadata(file)?.len();
    anyhow::ensure!(n_bytes <= N_KEY_BYTES_MAX, "{n_bytes} bytes, at most {N_KEY_BYTES_MAX}");
    Ok(std::fs::read_to_string(file)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(more: &str) -> Result<LlmSettings, String> {
        let text = format!(r#"{{"base_url": "http://127.0.0.1:1/v1", "model": "m"{more}}}"#);
        let settings: LlmSettings = serde_json::from_str(&text).map_err(|e| e.to_string())?;
        settings.check().map_err(|invalid| invalid.to_string())?;
        Ok(settings)
    }

    #[track_caller]
    fn check(more: &str, words: &[&str]) {
        let said = settings(more).unwrap_err();
        for word in words {
            assert!(said.contains(word), "{said:?} does not name {word:?}");
        }
    }

    #[test]
    fn an_error_names_key_value_and_limit() {
        assert!(settings("").is_ok());
        check(r#", "timeout_s": 0"#, &["llm.timeout_s", "0", "0.05 to 300"]);
        check(r#", "retries": 6"#, &["llm.retries", "6", "0 to 5"]);
        check(r#", "n_reply_bytes_max": 100"#, &["n_reply_bytes_max", "100", "1024"]);
        check(r#", "key_env": "A", "key_file": "b""#, &["key_file", "key_env"]);
        check(r#", "key": "sk-secret""#, &["unknown"]);
    }

    #[test]
    fn a_url_with_a_password_is_refused_without_repeating_it() {
        let mut with_password = settings("").unwrap();
        with_password.base_url = "https://me:secret@host/v1".into();
        let said = with_password.check().unwrap_err().to_string();
        assert!(said.contains("base_url") && !said.contains("secret"), "{said}");
        with_password.base_url = "ftp://host".into();
        assert!(with_password.check().unwrap_err().to_string().contains("http"));
    }

    #[test]
    fn a_key_comes_from_a_file_and_a_missing_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("key"), "sk-1\n").unwrap();
        let key = |more: &str| settings(more).unwrap().key(folder.path());
        assert_eq!(key(r#", "key_file": "key""#).unwrap().as_deref(), Some("sk-1"));
        assert_eq!(key("").unwrap(), None);
        assert!(format!("{:#}", key(r#", "key_file": "none""#).unwrap_err()).contains("none"));
        let missing = key(r#", "key_env": "HEEDWAY_NO_SUCH_KEY""#).unwrap_err();
        assert!(format!("{missing:#}").contains("HEEDWAY_NO_SUCH_KEY"));
    }
}
