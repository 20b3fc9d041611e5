//! A bounded queue of many sources: when one source overflows, its own oldest item gives way, counted.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Notify;

/// Where inputs of a service wait for its decider, oldest first.
pub struct Inbox<I> {
    shared: Arc<Shared<I>>,
}

struct Shared<I> {
    queue: Mutex<Queue<I>>,
    arrived: Notify,
}

struct Queue<I> {
    items: VecDeque<(SlotId, I)>,
    n_slots: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SlotId(usize);

/// One source's way into an inbox.
pub struct Slot<I> {
    shared: Arc<Shared<I>>,
    id: SlotId,
    capacity: usize,
}

impl<I> Clone for Inbox<I> {
    fn clone(&self) -> Self {
        Inbox { shared: Arc::clone(&self.shared) }
    }
}

impl<I> Default for Inbox<I> {
    fn default() -> Self {
        let queue = Mutex::new(Queue { items: VecDeque::new(), n_slots: 0 });
        Inbox { shared: Arc::new(Shared { queue, arrived: Notify::new() }) }
    }
}

impl<I> Inbox<I> {
    /// An empty inbox without sources.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A new source that may have `capacity` items waiting, at least one.
    #[must_use]
    pub fn slot(&self, capacity: usize) -> Slot<I> {
        let mut queue = self.shared.queue.lock().unwrap_or_else(PoisonError::into_inner);
        let id = SlotId(queue.n_slots);
        queue.n_slots += 1;
        Slot { shared: Arc::clone(&self.shared), id, capacity: capacity.max(1) }
    }

    /// The oldest item, if one waits.
    #[must_use]
    pub fn try_next(&self) -> Option<I> {
        let mut queue = self.shared.queue.lock().unwrap_or_else(PoisonError::into_inner);
        queue.items.pop_front().map(|(_, item)| item)
    }

    /// The oldest item; waits for one. Safe to cancel: nothing is lost.
    pub async fn next(&self) -> I {
        loop {
            let arrived = self.shared.arrived.notified();
            if let Some(item) = self.try_next() {
                return item;
            }
            arrived.await;
        }
    }
}

impl<I> Slot<I> {
    /// Adds an item; `true` when an older one of this source had to give way.
    pub fn push(&self, item: I) -> bool {
        let mut queue = self.shared.queue.lock().unwrap_or_else(PoisonError::into_inner);
        let n_waiting = queue.items.iter().filter(|(id, _)| *id == self.id).count();
        let full = n_waiting >= self.capacity;
        if full && let Some(oldest) = queue.items.iter().position(|(id, _)| *id == self.id) {
            queue.items.remove(oldest);
        }
        queue.items.push_back((self.id, item));
        drop(queue);
        self.shared.arrived.notify_one();
        full
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_overflowing_source_drops_its_own_oldest_and_no_other_s() {
        let inbox = Inbox::new();
        let (scans, rules) = (inbox.slot(2), inbox.slot(1));
        assert!(!scans.push("scan 1"));
        assert!(!rules.push("rules 1"));
        assert!(!scans.push("scan 2"));
        assert!(scans.push("scan 3"));
        let order: Vec<_> = std::iter::from_fn(|| inbox.try_next()).collect();
        assert_eq!(order, ["rules 1", "scan 2", "scan 3"]);
    }

    #[tokio::test]
    async fn a_waiting_reader_is_woken() {
        let inbox = Inbox::new();
        let slot = inbox.slot(4);
        let reader = tokio::spawn({
            let inbox = inbox.clone();
            async move { inbox.next().await + inbox.next().await }
        });
        tokio::task::yield_now().await;
        slot.push(20);
        slot.push(22);
        assert_eq!(reader.await.unwrap(), 42);
    }
}
