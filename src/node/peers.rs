//! What discovery shows of other participants: which endpoints are matched, and which cannot be.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use futures::StreamExt as _;
use rustdds::{
    DomainParticipant, DomainParticipantStatusEvent, EndpointDescription, GUID, ParticipantDescription,
    QosPolicies, StatusEvented as _, policy::Durability,
};
use tokio::sync::Notify;

use super::{
    dds_names::{ros_name_of_topic, user_data_value},
    environment::Reach,
};

/// An endpoint's identifier; the first 12 bytes are those of its participant.
type Gid = [u8; 16];

/// Other participants and their endpoints, as far as they were discovered.
#[derive(Debug, Default)]
pub(crate) struct Peers {
    known: Mutex<Known>,
    /// Notified when a reader is matched.
    matched: Notify,
}

#[derive(Debug, Default)]
struct Known {
    /// Topic of each endpoint, the node's own ones included.
    topics: BTreeMap<Gid, String>,
    /// `clientid` of the endpoints of service clients that have one (rmw_cyclonedds).
    clients: BTreeMap<Gid, Vec<u8>>,
    /// Remote readers matched to each local writer.
    readers: BTreeMap<Gid, BTreeSet<Gid>>,
}

/// The client that waits for a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReplyTo {
    /// Its request writer.
    pub writer: GUID,
    /// Its reply reader, where the request names it (rmw_fastrtps).
    pub reader: Option<GUID>,
}

impl Known {
    /// The client's reader among those matched to a writer.
    fn reader_of_client(&self, reply_writer: GUID, client: &ReplyTo) -> Option<Gid> {
        let writer = client.writer.to_bytes();
        let mut matched = self.readers.get(&reply_writer.to_bytes())?.iter();
        if let Some(reader) = client.reader {
            return matched.find(|r| **r == reader.to_bytes()).copied();
        }
        let id = self.clients.get(&writer);
        // A participant may have several clients of one service; rmw_cyclonedds numbers them.
        let is_of_client = |r: &&Gid| r[..12] == writer[..12] && (id.is_none() || self.clients.get(*r) == id);
        matched.find(is_of_client).copied()
    }

    fn note_endpoint(&mut self, endpoint: EndpointDescription) {
        let gid = endpoint.guid.to_bytes();
        if let Some(id) = user_data_value(&endpoint.user_data, "clientid") {
            self.clients.insert(gid, id.to_vec());
        }
        self.topics.insert(gid, endpoint.topic_name);
    }

    /// Forgets all identifiers with these first bytes: an endpoint, or all endpoints of a participant.
    fn forget(&mut self, first: &[u8]) {
        self.topics.retain(|gid, _| !gid.starts_with(first));
        self.clients.retain(|gid, _| !gid.starts_with(first));
        self.readers.values_mut().for_each(|readers| readers.retain(|gid| !gid.starts_with(first)));
    }

    /// ROS name of an endpoint's topic.
    fn topic_of(&self, guid: GUID) -> &str {
        self.topics.get(&guid.to_bytes()).map_or("a topic", |name| ros_name_of_topic(name))
    }
}

impl Peers {
    /// Follows discovery from now on, in a task of its own.
    pub(crate) fn follow(participant: &DomainParticipant, reach: Reach) -> Arc<Self> {
        let peers = Arc::new(Self::default());
        let listener = participant.status_listener();
        let this = Arc::clone(&peers);
        tokio::spawn(async move {
            let mut events = listener.as_async_status_stream();
            while let Some(event) = events.next().await {
                this.take_event(event, reach);
            }
        });
        peers
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take_event(&self, event: DomainParticipantStatusEvent, reach: Reach) {
        use DomainParticipantStatusEvent as Event;
        match event {
            Event::ParticipantDiscovered { dpd } => {
                if let Some(warning) = unreachable_warning(&dpd, reach) {
                    log::warn!("{warning}");
                }
            }
            Event::ReaderDetected { reader: endpoint } | Event::WriterDetected { writer: endpoint } => {
                self.known().note_endpoint(endpoint);
            }
            Event::RemoteReaderMatched { local_writer, remote_reader } => {
                let writer = local_writer.to_bytes();
                self.known().readers.entry(writer).or_default().insert(remote_reader.to_bytes());
                self.matched.notify_waiters();
            }
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => {
                self.known().forget(&guid.to_bytes());
            }
            // Endpoints of a participant that ends or falls silent are not named one by one.
            Event::ParticipantLost { id, .. } => self.known().forget(id.as_ref()),
            Event::RemoteReaderQosIncompatible { remote_reader, requested_qos, offered_qos, .. } => {
                let policy = refused_policy(&offered_qos, &requested_qos);
                let known = self.known();
                let topic = known.topic_of(remote_reader);
                log::warn!(
                    "{topic}: a subscriber gets nothing, as it asks for {policy}, which is not offered"
                );
            }
            Event::RemoteWriterQosIncompatible { remote_writer, requested_qos, offered_qos, .. } => {
                let policy = refused_policy(&offered_qos, &requested_qos);
                let known = self.known();
                let topic = known.topic_of(remote_writer);
                log::warn!(
                    "{topic}: a publisher is not heard, as it does not offer {policy}; for images and \
                     camera_info set image_qos and info_qos to sensor_data"
                );
            }
            _ => {}
        }
    }

    /// Waits until the client's reader is matched to the writer of replies; `None` after `wait`.
    pub(crate) async fn reply_reader(
        &self,
        reply_writer: GUID,
        client: &ReplyTo,
        wait: Duration,
    ) -> Option<GUID> {
        let end = tokio::time::Instant::now() + wait;
        loop {
            let mut changed = std::pin::pin!(self.matched.notified());
            // Registered before looking, so that no match between the two is missed.
            changed.as_mut().enable();
            if let Some(reader) = self.known().reader_of_client(reply_writer, client) {
                return Some(GUID::from_bytes(reader));
            }
            tokio::time::timeout_at(end, changed).await.ok()?;
        }
    }
}

/// The quality of service that was requested and is not offered.
fn refused_policy(offered: &QosPolicies, requested: &QosPolicies) -> &'static str {
    let is_durable = |qos: &QosPolicies| qos.durability().is_some_and(|d| d != Durability::Volatile);
    match () {
        () if requested.is_reliable() && !offered.is_reliable() => "reliability `reliable`",
        () if is_durable(requested) && !is_durable(offered) => "durability `transient local`",
        () => "a deadline, liveliness or data representation",
    }
}

/// A warning if none of a participant's addresses can be reached.
fn unreachable_warning(peer: &ParticipantDescription, reach: Reach) -> Option<String> {
    let addresses: BTreeSet<String> = peer.unicast_addresses.iter().map(|a| a.ip().to_string()).collect();
    let is_here = |a: &std::net::SocketAddr| a.ip().is_loopback();
    if reach != Reach::Localhost || addresses.is_empty() || peer.unicast_addresses.iter().any(is_here) {
        return None;
    }
    let addresses = addresses.into_iter().collect::<Vec<_>>().join(", ");
    Some(format!(
        "a participant is on {addresses} only, while this node talks to 127.0.0.1 only: it will get nothing \
         from this node; set ROS_AUTOMATIC_DISCOVERY_RANGE to LOCALHOST for it too, or to SUBNET for this \
         node"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gid(participant: u8, entity: u8) -> Gid {
        let mut bytes = [participant; 16];
        bytes[12..].copy_from_slice(&[0, 0, entity, 4]);
        bytes
    }

    #[test]
    fn a_reply_goes_to_the_reader_of_its_client() {
        let reply_writer = GUID::from_bytes(gid(9, 1));
        let mut known = Known::default();
        let client = |writer, reader: Option<Gid>| ReplyTo {
            writer: GUID::from_bytes(writer),
            reader: reader.map(GUID::from_bytes),
        };
        let found = |known: &Known, client| known.reader_of_client(reply_writer, &client);
        assert_eq!(found(&known, client(gid(1, 1), None)), None);
        known.readers.insert(reply_writer.to_bytes(), BTreeSet::from([gid(1, 2), gid(1, 3), gid(2, 2)]));
        // By participant, by the reader that is named, by the client's number.
        assert_eq!(found(&known, client(gid(2, 1), None)), Some(gid(2, 2)));
        assert_eq!(found(&known, client(gid(1, 1), Some(gid(1, 3)))), Some(gid(1, 3)));
        assert_eq!(found(&known, client(gid(1, 1), Some(gid(1, 4)))), None);
        known.clients.insert(gid(1, 1), b"a".to_vec());
        assert_eq!(found(&known, client(gid(1, 1), None)), None);
        known.clients.insert(gid(1, 3), b"a".to_vec());
        assert_eq!(found(&known, client(gid(1, 1), None)), Some(gid(1, 3)));
        known.forget(&gid(1, 3));
        assert_eq!(found(&known, client(gid(1, 1), None)), None);
        known.forget(&gid(2, 0)[..12]);
        assert_eq!(found(&known, client(gid(2, 1), None)), None);
        assert_eq!(known.readers[&reply_writer.to_bytes()], BTreeSet::from([gid(1, 2)]));
    }
}
