use speedy::{Readable, Writable};
use serde::{Deserialize, Serialize};

#[derive(
  Debug, PartialEq, Eq, Ord, PartialOrd, Readable, Writable, Copy, Clone, Serialize, Deserialize,
)]
pub struct ParameterId {
  value: u16,
}

impl ParameterId {
  pub const PID_PAD: Self = Self { value: 0x0000 };
  pub const PID_SENTINEL: Self = Self { value: 0x0001 };
  pub const PID_USER_DATA: Self = Self { value: 0x002c };
  pub const PID_TOPIC_NAME: Self = Self { value: 0x0005 };
  pub const PID_TYPE_NAME: Self = Self { value: 0x0007 };
  pub const PID_GROUP_DATA: Self = Self { value: 0x002d };
  pub const PID_TOPIC_DATA: Self = Self { value: 0x002e };
  pub const PID_DURABILITY: Self = Self { value: 0x001d };
  pub const PID_DURABILITY_SERVICE: Self = Self { value: 0x001e };
  pub const PID_DEADLINE: Self = Self { value: 0x0023 };
  pub const PID_LATENCY_BUDGET: Self = Self { value: 0x0027 };
  pub const PID_LIVELINESS: Self = Self { value: 0x001b };
  pub const PID_RELIABILITY: Self = Self { value: 0x001a };
  pub const PID_LIFESPAN: Self = Self { value: 0x002b };
  pub const PID_DESTINATION_ORDER: Self = Self { value: 0x0025 };
  pub const PID_HISTORY: Self = Self { value: 0x0040 };
  pub const PID_RESOURCE_LIMITS: Self = Self { value: 0x0041 };
  pub const PID_OWNERSHIP: Self = Self { value: 0x001f };
  pub const PID_OWNERSHIP_STRENGTH: Self = Self { value: 0x0006 };
  pub const PID_PRESENTATION: Self = Self { value: 0x0021 };
  pub const PID_PARTITION: Self = Self { value: 0x0029 };
  pub const PID_TIME_BASED_FILTER: Self = Self { value: 0x0004 };
  pub const PID_TRANSPORT_PRIO: Self = Self { value: 0x0049 };
  pub const PID_PROTOCOL_VERSION: Self = Self { value: 0x0015 };
  pub const PID_VENDOR_ID: Self = Self { value: 0x0016 };
  pub const PID_UNICAST_LOCATOR: Self = Self { value: 0x002f };
  pub const PID_MULTICAST_LOCATOR: Self = Self { value: 0x0030 };
  pub const PID_MULTICAST_IPADDRESS: Self = Self { value: 0x0011 };
  pub const PID_DEFAULT_UNICAST_LOCATOR: Self = Self { value: 0x0031 };
  pub const PID_DEFAULT_MULTICAST_LOCATOR: Self = Self { value: 0x0048 };
  pub const PID_METATRAFFIC_UNICAST_LOCATOR: Self = Self { value: 0x0032 };
  pub const PID_METATRAFFIC_MULTICAST_LOCATOR: Self = Self { value: 0x0033 };
  pub const PID_DEFAULT_UNICAST_IPADDRESS: Self = Self { value: 0x000c };
  pub const PID_DEFAULT_UNICAST_PORT: Self = Self { value: 0x000e };
  pub const PID_METATRAFFIC_UNICAST_IPADDRESS: Self = Self { value: 0x0045 };
  pub const PID_METATRAFFIC_UNICAST_PORT: Self = Self { value: 0x000d };
  pub const PID_METATRAFFIC_MULTICAST_IPADDRESS: Self = Self { value: 0x000b };
  pub const PID_METATRAFFIC_MULTICAST_PORT: Self = Self { value: 0x0046 };
  pub const PID_EXPECTS_INLINE_QOS: Self = Self { value: 0x0043 };
  pub const PID_PARTICIPANT_MANUAL_LIVELINESS_COUNT: Self = Self { value: 0x0034 };
  pub const PID_PARTICIPANT_BUILTIN_ENDPOINTS: Self = Self { value: 0x0044 };
  pub const PID_PARTICIPANT_LEASE_DURATION: Self = Self { value: 0x0002 };
  pub const PID_CONTENT_FILTER_PROPERTY: Self = Self { value: 0x0035 };
  pub const PID_PARTICIPANT_GUID: Self = Self { value: 0x0050 };
  pub const PID_GROUP_GUID: Self = Self { value: 0x0052 };
  pub const PID_GROUP_ENTITYID: Self = Self { value: 0x0053 };
  pub const PID_BUILTIN_ENDPOINT_SET: Self = Self { value: 0x0058 };
  pub const PID_ENDPOINT_GUID: Self = Self { value: 0x005a };
  pub const PID_BUILTIN_ENDPOINT_QOS: Self = Self { value: 0x0077 };
  pub const PID_PROPERTY_LIST: Self = Self { value: 0x0059 };
  pub const PID_TYPE_MAX_SIZE_SERIALIZED: Self = Self { value: 0x0060 };
  pub const PID_ENTITY_NAME: Self = Self { value: 0x0062 };
  pub const PID_KEY_HASH: Self = Self { value: 0x0070 };
  pub const PID_STATUS_INFO: Self = Self { value: 0x0071 };
  // DDS-XTypes v1.3, Section 7.6.3.1: DataRepresentationQosPolicy.
  pub const PID_DATA_REPRESENTATION: Self = Self { value: 0x0073 };

  // From Specification "Remote Procedure Calls over DDS v1.0"
  // Section 7.6.2.1.1 Extended PublicationBuiltin TopicData and
  // 7.6.2.1.2 Extended SubscriptionBuiltinTopicData
  pub const PID_SERVICE_INSTANCE_NAME: Self = Self { value: 0x0080 };
  pub const PID_RELATED_ENTITY_GUID: Self = Self { value: 0x0081 };
  pub const PID_TOPIC_ALIASES: Self = Self { value: 0x0082 };
  // Section "7.8.2 Request and Reply Correlation in the Enhanced Service
  // Profile": ...a new parameter id PID_RELATED_SAMPLE_IDENTITY with value
  // 0x0083
  //
  // But then again, the actual PID on the wire seems to be 0x800f, at least in
  // eProsima FastRTPS and RTI Connext. eProsima sources even have the value
  // 0x0083 commented out.
  // Wireshark calls this "PID_RELATED_ORIGINAL_WRITER_INFO".
  //
  // Update 2024-11-18:
  //
  // eProsima seems to have made a bug fix in Mar 27, 2023:
  // https://github.com/eProsima/Fast-DDS/commit/359eeaadd0ff0216aa1968a8ea34b5092c4f346e
  // They changed PID_RELATED_SAMPLE_IDENTITY from 0x800f to 0x0083.
  //
  // PID 0x800f is still supported in FastDDS, and it is called
  // PID_CUSTOM_RELATED_SAMPLE_IDENTITY, which naming we will copy, so that
  // future debugging is less confusing. Now FastDDS sends both of these PIDs in
  // Inline QoS, if it needs to send related_sample_identity. This seems like
  // a good idea for backward compatibility.
  //
  // The receive behaviour of FastDDS is somewhat unclear. They recognize both
  // versions on receive, but receiveing related_sample_identity does not work
  // correctly with PID=0x800f in ROS 2 Jazzy.
  pub const PID_RELATED_SAMPLE_IDENTITY: Self = Self { value: 0x0083 };
  pub const PID_RELATED_SAMPLE_IDENTITY_CUSTOM: Self = Self { value: 0x800f };

  // DDS Security spec v1.1:

  // Section 7.4.1.4 Extension to RTPS Standard DCPSParticipants Builtin Topic
  // Table 10
  pub const PID_IDENTITY_TOKEN: Self = Self { value: 0x1001 };
  pub const PID_PERMISSIONS_TOKEN: Self = Self { value: 0x1002 };

  // Section 7.4.1.7 New DCPSPublicationsSecure Builtin Topic
  // Table 14 & 15
  pub const PID_DATA_TAGS: Self = Self { value: 0x1003 };
  // Section 7.4.1.5
  // "Extension to RTPS Standard DCPSPublications and DCPSSubscriptions Builtin
  // Topics" Table 12
  pub const PID_ENDPOINT_SECURITY_INFO: Self = Self { value: 0x1004 };

  // Table 10:
  pub const PID_PARTICIPANT_SECURITY_INFO: Self = Self { value: 0x1005 };

  // Section 7.4.1.6 "New DCPSParticipantSecure Builtin Topic"
  // Table 13
  pub const PID_IDENTITY_STATUS_TOKEN: Self = Self { value: 0x1006 };
}

