//! The typed bus: rows of the topic table become publishers, subscriptions and questions.
//!
//! Payloads are decoded at the door; what does not decode is counted and logged, and goes no further.
//! Everything received carries the receiver's own time. Latched topics answer late joiners: their
//! publisher keeps the last payload and answers queries on its key, and their subscriber asks when it
//! joins and again whenever a service comes alive. A receiver must therefore expect to hear a value twice.

use std::marker::PhantomData;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, anyhow};
use geometry::Time;
use proto::{DecodeError, Delivery, Encoding, Message, Segment, Topic, keys};
use zenoh::Wait;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::SampleKind;

use crate::clock::Clock;
use crate::health::Counters;
use crate::inbox::{Inbox, Slot};

/// A message as it came in.
#[derive(Clone, Debug)]
pub struct Received<M> {
    /// The message, decoded and checked.
    pub message: M,
    /// When it came, by this process's clock.
    pub at: Time,
    /// Last segment of its key: which instance of a topic that ends in `*`.
    pub instance: String,
}

/// A service that came or went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeerChange {
    /// The service's name.
    pub service: String,
    /// Whether it is alive now.
    pub alive: bool,
}

/// One robot's part of the network.
#[derive(Clone)]
pub struct Bus {
    session: zenoh::Session,
    robot: Segment,
    clock: Clock,
    counters: Counters,
    /// Subscriptions and queryables live as long as the bus.
    held: Arc<Mutex<Vec<Box<dyn std::any::Any + Send>>>>,
}

/// Publishes one kind of message on one key.
pub struct Publisher<M> {
    publisher: zenoh::pubsub::Publisher<'static>,
    last: Option<Arc<Mutex<Option<Vec<u8>>>>>,
    message: PhantomData<fn(M)>,
}

/// A question that waits for its answer.
pub struct Question<Q, A> {
    /// What is asked.
    pub request: Q,
    query: zenoh::query::Query,
    answer: PhantomData<fn(A)>,
}

fn zenoh_error(e: zenoh::Error) -> anyhow::Error {
    anyhow!("{e}")
}

fn encoding_of(encoding: Encoding) -> zenoh::bytes::Encoding {
    match encoding {
        Encoding::Json => zenoh::bytes::Encoding::APPLICATION_JSON,
        Encoding::Binary { .. } => zenoh::bytes::Encoding::APPLICATION_OCTET_STREAM,
    }
}

impl Bus {
    /// The robot's part of the network that `session` reaches.
    #[must_use]
    pub fn new(session: zenoh::Session, robot: Segment, clock: Clock, counters: Counters) -> Self {
        Bus { session, robot, clock, counters, held: Arc::default() }
    }

    /// The session below.
    #[must_use]
    pub fn session(&self) -> &zenoh::Session {
        &self.session
    }

    /// The robot whose keys these are.
    #[must_use]
    pub fn robot(&self) -> &Segment {
        &self.robot
    }

    /// A publisher for a topic with one key.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn publisher<M: Message>(&self, topic: &Topic) -> anyhow::Result<Publisher<M>> {
        self.publish_on(keys::key(&self.robot, topic), topic).await
    }

    /// A publisher for one instance of a topic that ends in `*`.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn instance_publisher<M: Message>(
        &self,
        topic: &Topic,
        instance: &Segment,
    ) -> anyhow::Result<Publisher<M>> {
        self.publish_on(keys::instance_key(&self.robot, topic, instance), topic).await
    }

    async fn publish_on<M: Message>(&self, key: String, topic: &Topic) -> anyhow::Result<Publisher<M>> {
        debug_assert_eq!(topic.message, M::NAME);
        let (priority, congestion, express) = match topic.delivery {
            Delivery::Control => (Priority::RealTime, CongestionControl::Drop, true),
            Delivery::Bulk => (Priority::DataLow, CongestionControl::Drop, false),
            Delivery::Event | Delivery::Latched | Delivery::Query => {
                (Priority::Data, CongestionControl::Block, true)
            }
        };
        let publisher = self
            .session
            .declare_publisher(key.clone())
            .priority(priority)
            .congestion_control(congestion)
            .express(express)
            .encoding(encoding_of(M::ENCODING))
            .await
            .map_err(zenoh_error)
            .with_context(|| format!("declare publisher {key}"))?;
        let mut last = None;
        if topic.delivery == Delivery::Latched {
            let kept: Arc<Mutex<Option<Vec<u8>>>> = Arc::default();
            self.answer_with_last(&key, M::ENCODING, Arc::clone(&kept)).await?;
            last = Some(kept);
        }
        Ok(Publisher { publisher, last, message: PhantomData })
    }

    async fn answer_with_last(
        &self,
        key: &str,
        encoding: Encoding,
        kept: Arc<Mutex<Option<Vec<u8>>>>,
    ) -> anyhow::Result<()> {
        let reply_key = key.to_owned();
        let queryable = self
            .session
            .declare_queryable(key.to_owned())
            .callback(move |query| {
                let last = kept.lock().unwrap_or_else(PoisonError::into_inner).clone();
                if let Some(bytes) = last {
                    // Whoever asked may be gone; then there is nobody to tell.
                    let _ = query.reply(&reply_key, bytes).encoding(encoding_of(encoding)).wait();
                }
            })
            .await
            .map_err(zenoh_error)
            .with_context(|| format!("declare queryable {key}"))?;
        self.hold(queryable);
        Ok(())
    }

    /// Feeds every message of a topic into an inbox; at most `capacity` wait.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn subscribe<M: Message, I: Send + 'static>(
        &self,
        topic: &Topic,
        inbox: &Inbox<I>,
        capacity: usize,
        wrap: fn(Received<M>) -> I,
    ) -> anyhow::Result<()> {
        debug_assert_eq!(topic.message, M::NAME);
        self.subscribe_decoded(topic, inbox, capacity, proto::decode::<M>, wrap).await
    }

    /// As [`Bus::subscribe`], with a decoder of its own: for keys that people write to.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn subscribe_decoded<M: Send + 'static, I: Send + 'static>(
        &self,
        topic: &Topic,
        inbox: &Inbox<I>,
        capacity: usize,
        decode: fn(&[u8]) -> Result<M, DecodeError>,
        wrap: fn(Received<M>) -> I,
    ) -> anyhow::Result<()> {
        let key = keys::key(&self.robot, topic);
        let door = Arc::new(Door {
            slot: inbox.slot(capacity),
            clock: self.clock,
            counters: self.counters.clone(),
            topic: topic.key,
            decode,
            wrap,
        });
        let door_of_samples = Arc::clone(&door);
        let subscriber = self
            .session
            .declare_subscriber(key.clone())
            .callback(move |sample| {
                if sample.kind() == SampleKind::Put {
                    door_of_samples.admit(sample.key_expr().as_str(), &sample.payload().to_bytes());
                }
            })
            .await
            .map_err(zenoh_error)
            .with_context(|| format!("subscribe to {key}"))?;
        self.hold(subscriber);
        if topic.delivery == Delivery::Latched {
            self.ask_when_peers_come(key, door).await?;
        }
        Ok(())
    }

    /// Asks for the last value of a latched key now and whenever a service comes alive.
    async fn ask_when_peers_come<M: Send + 'static, I: Send + 'static>(
        &self,
        key: String,
        door: Arc<Door<M, I>>,
    ) -> anyhow::Result<()> {
        let session = self.session.clone();
        let ask = move || {
            let door = Arc::clone(&door);
            let asked = session
                .get(key.as_str())
                .target(zenoh::query::QueryTarget::All)
                .consolidation(zenoh::query::ConsolidationMode::None)
                .callback(move |reply| {
                    if let Ok(sample) = reply.result() {
                        door.admit(sample.key_expr().as_str(), &sample.payload().to_bytes());
                    }
                })
                .wait();
            if let Err(e) = asked {
                tracing::warn!(key, error = %e, "cannot ask for the last value");
            }
        };
        ask();
        let alive = format!("{}/{}/alive/*", keys::ROOT, self.robot);
        let watcher = self
            .session
            .liveliness()
            .declare_subscriber(alive)
            .callback(move |sample| {
                if sample.kind() == SampleKind::Put {
                    ask();
                }
            })
            .await
            .map_err(zenoh_error)
            .context("watch for services")?;
        self.hold(watcher);
        Ok(())
    }

    /// Feeds the coming and going of services into an inbox, beginning with those that are alive.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn watch_peers<I: Send + 'static>(
        &self,
        inbox: &Inbox<I>,
        wrap: fn(PeerChange) -> I,
    ) -> anyhow::Result<()> {
        let slot = inbox.slot(64);
        let watcher = self
            .session
            .liveliness()
            .declare_subscriber(format!("{}/{}/alive/*", keys::ROOT, self.robot))
            .history(true)
            .callback(move |sample| {
                let service = keys::instance_of(sample.key_expr().as_str()).to_owned();
                slot.push(wrap(PeerChange { service, alive: sample.kind() == SampleKind::Put }));
            })
            .await
            .map_err(zenoh_error)
            .context("watch for services")?;
        self.hold(watcher);
        Ok(())
    }

    /// Feeds questions on a topic into an inbox; at most `capacity` wait, the oldest give way unanswered.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn answer<Q: Message, A: Message, I: Send + 'static>(
        &self,
        topic: &Topic,
        inbox: &Inbox<I>,
        capacity: usize,
        wrap: fn(Question<Q, A>) -> I,
    ) -> anyhow::Result<()> {
        debug_assert_eq!(topic.message, Q::NAME);
        let key = keys::key(&self.robot, topic);
        let (slot, counters, topic_key) = (inbox.slot(capacity), self.counters.clone(), topic.key);
        let queryable = self
            .session
            .declare_queryable(key.clone())
            .callback(move |query| {
                let bytes = query.payload().map(|p| p.to_bytes().into_owned()).unwrap_or_default();
                match proto::decode::<Q>(&bytes) {
                    Ok(request) => {
                        if slot.push(wrap(Question { request, query, answer: PhantomData })) {
                            counters.dropped(topic_key);
                        }
                    }
                    Err(e) => {
                        counters.rejected(topic_key, &e.to_string());
                        let _ = query.reply_err(e.to_string()).wait();
                    }
                }
            })
            .await
            .map_err(zenoh_error)
            .with_context(|| format!("answer questions on {key}"))?;
        self.hold(queryable);
        Ok(())
    }

    /// Asks whoever answers on a topic; the first good answer counts.
    ///
    /// # Errors
    /// When nobody answers within `patience`, or with an error, or with something that is no answer.
    pub async fn ask<Q: Message, A: Message>(
        &self,
        topic: &Topic,
        request: &Q,
        patience: Duration,
    ) -> anyhow::Result<A> {
        let key = keys::key(&self.robot, topic);
        let bytes = proto::encode(request)?;
        let answers = self
            .session
            .get(key.as_str())
            .payload(bytes)
            .timeout(patience)
            .await
            .map_err(zenoh_error)
            .with_context(|| format!("ask {key}"))?;
        let mut refusal = None;
        while let Ok(answer) = answers.recv_async().await {
            match answer.result() {
                Ok(sample) => match proto::decode::<A>(&sample.payload().to_bytes()) {
                    Ok(message) => return Ok(message),
                    Err(e) => {
                        self.counters.rejected(topic.key, &e.to_string());
                        refusal = Some(anyhow!(e));
                    }
                },
                Err(e) => refusal = Some(anyhow!("{}", String::from_utf8_lossy(&e.payload().to_bytes()))),
            }
        }
        let silence = || anyhow!("no answer within {} ms", patience.as_millis());
        Err(refusal.unwrap_or_else(silence)).with_context(|| format!("ask {key}"))
    }

    /// Says that this service is alive, for as long as the bus lives.
    ///
    /// # Errors
    /// When the session refuses.
    pub async fn declare_alive(&self, service: &Segment) -> anyhow::Result<()> {
        let token = self
            .session
            .liveliness()
            .declare_token(keys::alive_key(&self.robot, service))
            .await
            .map_err(zenoh_error)
            .context("declare liveliness")?;
        self.hold(token);
        Ok(())
    }

    fn hold(&self, thing: impl std::any::Any + Send) {
        self.held.lock().unwrap_or_else(PoisonError::into_inner).push(Box::new(thing));
    }
}

/// Where payloads of one topic come in: decoded, stamped, queued; or rejected and counted.
struct Door<M, I> {
    slot: Slot<I>,
    clock: Clock,
    counters: Counters,
    topic: &'static str,
    decode: fn(&[u8]) -> Result<M, DecodeError>,
    wrap: fn(Received<M>) -> I,
}

impl<M, I> Door<M, I> {
    fn admit(&self, key: &str, bytes: &[u8]) {
        let at = self.clock.now();
        match (self.decode)(bytes) {
            Ok(message) => {
                let instance = keys::instance_of(key).to_owned();
                if self.slot.push((self.wrap)(Received { message, at, instance })) {
                    self.counters.dropped(self.topic);
                }
            }
            Err(e) => self.counters.rejected(self.topic, &e.to_string()),
        }
    }
}

impl<M: Message> Publisher<M> {
    /// Publishes a message; a latched one is also kept for those who join late.
    ///
    /// `Ok` says that it left, not that anyone heard.
    ///
    /// # Errors
    /// When the message breaks its own rules, or the session is closed.
    pub fn put(&self, message: &M) -> anyhow::Result<()> {
        let bytes = proto::encode(message)?;
        if let Some(last) = &self.last {
            *last.lock().unwrap_or_else(PoisonError::into_inner) = Some(bytes.clone());
        }
        self.publisher.put(bytes).wait().map_err(zenoh_error).context(M::NAME)
    }
}

impl<Q, A: Message> Question<Q, A> {
    /// Answers it.
    ///
    /// # Errors
    /// When the answer breaks its own rules, or whoever asked is gone.
    pub fn answer(self, answer: &A) -> anyhow::Result<()> {
        let bytes = proto::encode(answer)?;
        let key = self.query.key_expr().clone();
        self.query
            .reply(key, bytes)
            .encoding(encoding_of(A::ENCODING))
            .wait()
            .map_err(zenoh_error)
            .context(A::NAME)
    }

    /// Says why there is no answer.
    pub fn refuse(self, reason: &str) {
        // Whoever asked may be gone; then there is nobody to tell.
        let _ = self.query.reply_err(reason).wait();
    }
}
