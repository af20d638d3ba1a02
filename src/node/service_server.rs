//! The server of a ROS 2 service, for clients of every DDS middleware of ROS 2: each request is read, and
//! answered, as the client's middleware maps services to DDS.

use std::{marker::PhantomData, sync::Arc, time::Duration};

use futures::{StreamExt as _, pin_mut};
use rustdds::{
    GUID, RTPSEntity as _, RepresentationIdentifier, SampleIdentity, SequenceNumber, Timestamp,
    WriteOptionsBuilder,
    bytes::Bytes,
    no_key::{DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader},
    serialization::{deserialize_from_cdr_with_rep_id, to_writer_with_rep_id},
};
use serde::{Serialize, de::DeserializeOwned};

use super::{
    dds_names::service_dds_names,
    error::NodeError,
    participant::{EndpointOptions, Participant, reliable_profile},
    peers::{Peers, ReplyTo},
};

/// Queue length for requests.
/// derived: that of rmw_qos_profile_services_default
const DEPTH: usize = 10;
/// Longest time for a client's reply reader to be discovered.
/// chosen: discovery takes less than a second; after this the client has given up or is gone
const READER_WAIT: Duration = Duration::from_secs(5);
/// First two bytes of the identifiers of Cyclone DDS (vendor ID, RTPS 2.5 section 9.3.1.1).
const CYCLONE_VENDOR: [u8; 2] = [1, 16];
/// Bit of an entity kind that readers have and writers have not (RTPS 2.5 section 9.3.1.2).
const READER_BIT: u8 = 0x04;

/// A sample as it came from the network, or goes there.
struct RawSample {
    encoding: RepresentationIdentifier,
    bytes: Bytes,
}

/// Passes samples on as bytes, as a request says only by its sender how it is laid out.
struct BytesAdapter;

#[derive(Clone)]
struct BytesDecoder;

/// Never occurs: bytes are passed on.
#[derive(Debug, thiserror::Error)]
#[error("the sample cannot be passed on")]
struct NotPassedOn;

impl DeserializerAdapter<RawSample> for BytesAdapter {
    type Error = NotPassedOn;
    type Decoded = RawSample;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        const ENCODINGS: [RepresentationIdentifier; 2] =
            [RepresentationIdentifier::CDR_BE, RepresentationIdentifier::CDR_LE];
        &ENCODINGS
    }

    fn transform_decoded(decoded: RawSample) -> RawSample {
        decoded
    }
}

impl DefaultDecoder<RawSample> for BytesAdapter {
    type Decoder = BytesDecoder;
    const DECODER: BytesDecoder = BytesDecoder;
}

impl Decode<'_, RawSample> for BytesDecoder {
    type Error = NotPassedOn;

    fn decode_bytes(
        self,
        bytes: &[u8],
        encoding: RepresentationIdentifier,
    ) -> Result<RawSample, NotPassedOn> {
        Ok(RawSample { encoding, bytes: Bytes::copy_from_slice(bytes) })
    }
}

impl SerializerAdapter<RawSample> for BytesAdapter {
    type Error = NotPassedOn;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(sample: &RawSample) -> Result<Bytes, NotPassedOn> {
        Ok(sample.bytes.clone())
    }
}

/// Whom a reply answers, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RequestId {
    /// The request in DDS-RPC.
    identity: SampleIdentity,
    /// Client and number before the body, if the client's middleware puts them there (rmw_cyclonedds).
    header: Option<(u64, i64)>,
    /// The client's endpoints.
    client: ReplyTo,
}

/// Why a request cannot be read, or a reply not be sent.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ServiceError {
    /// The bytes are not those of a request.
    #[error("malformed: {0}")]
    Malformed(#[from] rustdds::serialization::Error),
    /// The client's reader was not discovered.
    #[error("the client's reader was not discovered within {} s", READER_WAIT.as_secs())]
    NoReader,
    /// The middleware's message.
    #[error("{0}")]
    Middleware(String),
}

/// Receives requests of a service and sends the replies.
pub(crate) struct ServiceServer<Q, A> {
    requests: SimpleDataReader<RawSample, BytesAdapter>,
    replies: Arc<ReplyWriter>,
    types: PhantomData<fn(A) -> Q>,
}

struct ReplyWriter {
    name: String,
    writer: DataWriter<RawSample, BytesAdapter>,
    peers: Arc<Peers>,
}

impl<Q: DeserializeOwned, A: Serialize> ServiceServer<Q, A> {
    /// Offers a service by its name and ROS type, e.g. `std_srvs/srv/Trigger`.
    ///
    /// # Errors
    /// If the name is invalid or the network reports an error.
    pub(crate) fn offer(
        participant: &mut Participant,
        name: &str,
        ros_type: &str,
    ) -> Result<Self, NodeError> {
        let full = participant.checked_name(name)?;
        let [request_name, reply_name] = service_dds_names(&full, &participant.identity);
        let qos = reliable_profile(DEPTH);
        // A client of rmw_cyclonedds sends its first request when it has matched both endpoints with this ID.
        let user_data = format!("serviceid={};", participant.next_service_id());
        let mut options = EndpointOptions {
            dds_name: &reply_name,
            ros_type: &format!("{ros_type}_Response"),
            qos: &qos,
            user_data: &user_data,
        };
        // The writer first: a client that finds the reader must find the writer soon.
        let writer = participant.create_writer(&options)?;
        let request_type = format!("{ros_type}_Request");
        options = EndpointOptions { dds_name: &request_name, ros_type: &request_type, ..options };
        let requests = participant.create_reader(&options)?;
        let peers = Arc::clone(&participant.peers);
        let replies = Arc::new(ReplyWriter { name: full.to_string(), writer, peers });
        Ok(Self { requests, replies, types: PhantomData })
    }

    /// Waits for the next readable request; others are logged and left out.
    pub(crate) async fn next_request(&self) -> (RequestId, Q) {
        let samples = self.requests.as_async_stream();
        pin_mut!(samples);
        loop {
            match samples.next().await {
                Some(Ok(sample)) => {
                    let own = SampleIdentity {
                        writer_guid: sample.writer_guid(),
                        sequence_number: sample.sequence_number,
                    };
                    match read_request(&sample.sample, own, sample.related_sample_identity()) {
                        Ok(request) => return request,
                        Err(error) => {
                            log::debug!("{}: a request could not be read: {error}", self.replies.name)
                        }
                    }
                }
                Some(Err(error)) => {
                    log::debug!("{}: a request could not be read: {error}", self.replies.name)
                }
                // The stream ends with the participant only.
                None => std::future::pending().await,
            }
        }
    }

    /// Sends a reply as soon as the client's reader is matched, in a task of its own: a client that is gone
    /// makes no other wait.
    pub(crate) fn send_reply(&self, id: RequestId, reply: &A) {
        let replies = Arc::clone(&self.replies);
        let sample = match reply_sample(&id, reply) {
            Ok(sample) => sample,
            Err(error) => return log::warn!("{}: a reply was not sent: {error}", replies.name),
        };
        tokio::spawn(async move {
            if let Err(error) = replies.send(id, sample).await {
                log::warn!("{}: a reply was not sent: {error}", replies.name);
            }
        });
    }
}

impl ReplyWriter {
    async fn send(&self, id: RequestId, sample: RawSample) -> Result<(), ServiceError> {
        let matched = self.peers.reply_reader(self.writer.guid(), &id.client, READER_WAIT).await;
        let options = WriteOptionsBuilder::new()
            .source_timestamp(Timestamp::now())
            .related_sample_identity(id.identity)
            // Clients of another middleware could not read it.
            .to_single_reader(matched.ok_or(ServiceError::NoReader)?)
            .build();
        match self.writer.async_write_with_options(sample, options).await {
            Ok(_) => Ok(()),
            Err(error) => Err(ServiceError::Middleware(error.to_string())),
        }
    }
}

/// Reads a request from its sample, the sample's identity and that which the sender gave with it.
fn read_request<Q: DeserializeOwned>(
    sample: &RawSample,
    own: SampleIdentity,
    related: Option<SampleIdentity>,
) -> Result<(RequestId, Q), ServiceError> {
    let writer = own.writer_guid;
    let body = &sample.bytes;
    let encoding = sample.encoding;
    if writer.to_bytes()[..2] == CYCLONE_VENDOR {
        let (header, length) = deserialize_from_cdr_with_rep_id::<(u64, i64)>(body, encoding)?;
        // 16 bytes, so that the body is aligned as if it began there.
        let (request, _) =
            deserialize_from_cdr_with_rep_id::<Q>(body.get(length..).unwrap_or_default(), encoding)?;
        let client = ReplyTo { writer, reader: None };
        return Ok((RequestId { identity: own, header: Some(header), client }, request));
    }
    let (request, _) = deserialize_from_cdr_with_rep_id::<Q>(body, encoding)?;
    let mut identity = related.unwrap_or(own);
    // Fast DDS names its reader there and leaves the number to the sample.
    if identity.sequence_number == SequenceNumber::UNKNOWN {
        identity.sequence_number = own.sequence_number;
    }
    let is_reader = |guid: GUID| guid.to_bytes()[15] & READER_BIT != 0;
    let reader = Some(identity.writer_guid).filter(|guid| is_reader(*guid));
    Ok((RequestId { identity, header: None, client: ReplyTo { writer, reader } }, request))
}

fn reply_sample<A: Serialize>(id: &RequestId, reply: &A) -> Result<RawSample, ServiceError> {
    let mut bytes = id.header.map_or(Ok(Vec::new()), |header| cdr_bytes(&header))?;
    bytes.extend(cdr_bytes(reply)?);
    Ok(RawSample { encoding: RepresentationIdentifier::CDR_LE, bytes: bytes.into() })
}

/// A message in little-endian CDR, without the header of a sample.
fn cdr_bytes(message: &impl Serialize) -> Result<Vec<u8>, rustdds::serialization::Error> {
    let mut bytes = Vec::new();
    to_writer_with_rep_id(&mut bytes, message, RepresentationIdentifier::CDR_LE)?;
    Ok(bytes)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The bytes of a message, for the tests of messages, too.
    pub(crate) fn cdr(message: &impl Serialize) -> Vec<u8> {
        cdr_bytes(message).unwrap()
    }

    /// An identifier of a vendor's participant, and an entity kind.
    fn guid(vendor: u8, kind: u8) -> GUID {
        let mut bytes = [7; 16];
        bytes[..2].copy_from_slice(&[1, vendor]);
        bytes[15] = kind;
        GUID::from_bytes(bytes)
    }

    fn identity(writer_guid: GUID, number: i64) -> SampleIdentity {
        SampleIdentity { writer_guid, sequence_number: SequenceNumber::from(number) }
    }

    fn sample(value: &impl Serialize) -> RawSample {
        RawSample { encoding: RepresentationIdentifier::CDR_LE, bytes: cdr(value).into() }
    }

    #[test]
    fn cyclone_puts_client_and_number_before_the_body_and_gets_them_back() {
        let own = identity(guid(16, 3), 5);
        let sent = sample(&((11_u64, 12_i64), 9_u8, "text"));
        let (id, request) = read_request::<(u8, String)>(&sent, own, None).unwrap();
        assert_eq!(request, (9, "text".to_owned()));
        let reply = reply_sample(&id, &(true, 1.5_f64)).unwrap();
        assert_eq!(reply.bytes, sample(&((11_u64, 12_i64), true, 1.5_f64)).bytes);
        assert_eq!(id.client, ReplyTo { writer: guid(16, 3), reader: None });
    }

    #[test]
    fn fast_dds_names_its_reader_beside_the_body() {
        let own = identity(guid(15, 3), 5);
        let unnumbered =
            SampleIdentity { writer_guid: guid(15, 4), sequence_number: SequenceNumber::UNKNOWN };
        let (id, request) =
            read_request::<(u8, String)>(&sample(&(9_u8, "text")), own, Some(unnumbered)).unwrap();
        assert_eq!(request, (9, "text".to_owned()));
        assert_eq!(id.identity, identity(guid(15, 4), 5));
        assert_eq!(id.client, ReplyTo { writer: guid(15, 3), reader: Some(guid(15, 4)) });
        assert_eq!(reply_sample(&id, &true).unwrap().bytes, sample(&true).bytes);
        // Without it the request is identified by itself.
        let (id, _) = read_request::<u8>(&sample(&1_u8), own, None).unwrap();
        assert_eq!((id.identity, id.client.reader), (own, None));
    }

    #[test]
    fn short_requests_are_refused() {
        let own = identity(guid(16, 3), 5);
        assert!(read_request::<u8>(&sample(&1_u32), own, None).is_err());
        assert!(read_request::<String>(&sample(&(1_u64, 1_i64)), own, None).is_err());
    }
}
