//! One call to an OpenAI-compatible endpoint, with a limit on time and size.

use std::time::Duration;

use anyhow::Context;
use reqwest::header::{HeaderMap, HeaderName, HeaderValue, RETRY_AFTER};
use reqwest::{StatusCode, Url, redirect};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{Authentication, CallError, LlmSettings};

/// What the server is asked to hold the model to, strongest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// The JSON Schema of a draft, strictly.
    Schema,
    /// Any JSON object.
    Object,
    /// Nothing.
    Plain,
}

impl Format {
    /// 0 for the strongest.
    #[must_use]
    pub fn rank(self) -> u8 {
        match self {
            Format::Schema => 0,
            Format::Object => 1,
            Format::Plain => 2,
        }
    }

    /// The format of a rank; the weakest for those beyond.
    #[must_use]
    pub fn of_rank(rank: u8) -> Format {
        match rank {
            0 => Format::Schema,
            1 => Format::Object,
            _ => Format::Plain,
        }
    }

    /// The next weaker format, if there is one.
    #[must_use]
    pub fn weaker(self) -> Option<Format> {
        match self {
            Format::Schema => Some(Format::Object),
            Format::Object => Some(Format::Plain),
            Format::Plain => None,
        }
    }

    fn response_format(self) -> Option<Value> {
        match self {
            Format::Schema => {
                let schema = strict(json!(rules::schema::draft_reply_schema()));
                let schema = json!({"name": "reply", "strict": true, "schema": schema});
                Some(json!({"type": "json_schema", "json_schema": schema}))
            }
            Format::Object => Some(json!({"type": "json_object"})),
            Format::Plain => None,
        }
    }
}

/// The schema in the dialect that strict servers take: no `oneOf`, no number formats.
fn strict(schema: Value) -> Value {
    match schema {
        Value::Object(map) => {
            let entries = map.into_iter().filter(|(key, value)| {
                // A property may be called `format`; then its value is a schema, not a word.
                !(["format", "$schema"].contains(&key.as_str()) && value.is_string())
            });
            let renamed = entries.map(|(key, value)| {
                let key = if key == "oneOf" { "anyOf".to_owned() } else { key };
                (key, strict(value))
            });
            Value::Object(renamed.collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(strict).collect()),
        other => other,
    }
}

/// Where the model is asked.
pub(super) struct Endpoint {
    client: reqwest::Client,
    url: Url,
    model: String,
    timeout: Duration,
    n_reply_bytes_max: usize,
}

impl Endpoint {
    pub(super) fn new(settings: &LlmSettings, key: Option<String>) -> anyhow::Result<Endpoint> {
        let mut headers = HeaderMap::new();
        if let Some(key) = key {
            let (name, value) = match settings.authentication {
                Authentication::Bearer => (reqwest::header::AUTHORIZATION, format!("Bearer {key}")),
                Authentication::ApiKey => (HeaderName::from_static("api-key"), key),
            };
            let mut value = HeaderValue::from_str(&value).context("the key does not fit a header")?;
            value.set_sensitive(true);
            headers.insert(name, value);
        }
        let client = reqwest::Client::builder()
            .default_headers(headers)
            // A redirect would carry the words, and maybe the key, to somebody else.
            .redirect(redirect::Policy::none())
            .build()
            .context("make HTTP client")?;
        Ok(Endpoint {
            client,
            url: completions_url(&settings.base_url)?,
            model: settings.model.clone(),
            timeout: settings.timeout(),
            n_reply_bytes_max: settings.n_reply_bytes_max,
        })
    }

    /// The content of the model's message. Whatever came is added to `raw`.
    pub(super) async fn complete(
        &self,
        messages: &[Value],
        format: Format,
        raw: &mut Vec<String>,
    ) -> Result<String, CallError> {
        let mut body = json!({"model": self.model, "messages": messages, "temperature": 0, "stream": false});
        if let (Some(body), Some(format)) = (body.as_object_mut(), format.response_format()) {
            body.insert("response_format".into(), format);
        }
        // One limit over connecting, waiting and reading: a server may hang at any of them.
        let bytes = tokio::time::timeout(self.timeout, self.call(&body))
            .await
            .map_err(|_| CallError::TimedOut(self.timeout))??;
        let content = content(&bytes);
        raw.push(match &content {
            Ok(content) => content.clone(),
            Err(_) => String::from_utf8_lossy(&bytes).into_owned(),
        });
        content
    }

    async fn call(&self, body: &Value) -> Result<Vec<u8>, CallError> {
        let broken = |error: reqwest::Error| {
            // Without the address, which may hold what is not for a log.
            CallError::Unreachable(error.without_url().to_string())
        };
        let mut response = self.client.post(self.url.clone()).json(body).send().await.map_err(broken)?;
        if let Some(error) = refusal(response.status(), response.headers()) {
            return Err(error);
        }
        let mut bytes = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(broken)? {
            if bytes.len() + chunk.len() > self.n_reply_bytes_max {
                return Err(CallError::Oversized(self.n_reply_bytes_max));
            }
            bytes.extend_from_slice(&chunk);
        }
        Ok(bytes)
    }
}

fn completions_url(base_url: &str) -> anyhow::Result<Url> {
    let mut url = Url::parse(base_url).with_context(|| format!("base_url {base_url}"))?;
    match url.path_segments_mut() {
        Ok(mut segments) => {
            segments.pop_if_empty().extend(["chat", "completions"]);
        }
        Err(()) => anyhow::bail!("base_url {base_url} takes no path"),
    }
    Ok(url)
}

fn refusal(status: StatusCode, headers: &HeaderMap) -> Option<CallError> {
    let code = status.as_u16();
    match code {
        _ if status.is_success() => None,
        401 | 403 => Some(CallError::Unauthorised(code)),
        400 | 422 => Some(CallError::FormatRefused(code)),
        429 => Some(CallError::TooMany(retry_after(headers))),
        500..=599 => Some(CallError::Server(code)),
        _ => Some(CallError::Rejected(code)),
    }
}

/// Whole seconds only: a date would need the wall clock, and the usual pause does as well.
fn retry_after(headers: &HeaderMap) -> Option<Duration> {
    let seconds = headers.get(RETRY_AFTER)?.to_str().ok()?.trim().parse::<u64>().ok()?;
    Some(Duration::from_secs(seconds))
}

#[derive(Deserialize)]
struct Completion {
    choices: Vec<Choice>,
}

#[derive(Deserialize)]
struct Choice {
    message: Message,
    #[serde(default)]
    finish_reason: Option<String>,
}

#[derive(Deserialize)]
struct Message {
    #[serde(default)]
    content: Option<String>,
    #[serde(default)]
    refusal: Option<String>,
}

fn content(bytes: &[u8]) -> Result<String, CallError> {
    let nonsense = |reason: String| CallError::Nonsense(reason);
    let completion: Completion =
        serde_json::from_slice(bytes).map_err(|reason| nonsense(format!("no completion: {reason}")))?;
    let choice = completion.choices.into_iter().next().ok_or_else(|| nonsense("no choice".into()))?;
    if choice.finish_reason.as_deref() == Some("length") {
        return Err(nonsense("cut off at the server's length limit".into()));
    }
    if choice.message.refusal.is_some() {
        return Err(nonsense("the model refused".into()));
    }
    choice.message.content.ok_or_else(|| nonsense("no content".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_query_of_the_base_url_is_kept() {
        let check = |base: &str, wanted: &str| assert_eq!(completions_url(base).unwrap().as_str(), wanted);
        check("http://h:1/v1", "http://h:1/v1/chat/completions");
        check("http://h:1/v1/", "http://h:1/v1/chat/completions");
        check(
            "https://h/openai/deployments/d?api-version=1",
            "https://h/openai/deployments/d/chat/completions?api-version=1",
        );
    }

    #[test]
    fn formats_get_weaker_until_there_is_none() {
        let all: Vec<Format> =
            std::iter::successors(Some(Format::Schema), |format| format.weaker()).collect();
        assert_eq!(all, [Format::Schema, Format::Object, Format::Plain]);
        assert!(all.iter().all(|format| Format::of_rank(format.rank()) == *format));
    }

    #[test]
    fn the_schema_is_strict() {
        let format = Format::Schema.response_format().unwrap();
        let schema = &format["json_schema"]["schema"];
        assert_eq!(schema["additionalProperties"], json!(false));
        let n_properties = schema["properties"].as_object().unwrap().len();
        assert_eq!(schema["required"].as_array().unwrap().len(), n_properties);
        let text = schema.to_string();
        assert!(!text.contains("oneOf") && !text.contains("double") && !text.contains("$ref"));
    }
}
