use speedy::{Readable, Writable};

use crate::{
  messages::{
    header::Header, protocol_id::ProtocolId, protocol_version::ProtocolVersion, vendor_id::VendorId,
  },
  structure::guid::GuidPrefix,
};

/// This message modifies the logical source of the Submessages
/// that follow.
#[derive(Debug, PartialEq, Eq, Clone, Copy, Readable, Writable)]
pub struct InfoSource {
  /// DDSI-RTPS 2.5 specifies an unused long here in 9.4.5.11
  pub unused: u32,

  /// Indicates the protocol used to encapsulate subsequent Submessages
  pub protocol_version: ProtocolVersion,

  /// Indicates the VendorId of the vendor that
  /// encapsulated subsequent Submessage
  pub vendor_id: VendorId,

  /// Identifies the Participant that is the container of the RTPS Writer
  /// entities that are the source of the Submessages that follow
  pub guid_prefix: GuidPrefix,
}

impl InfoSource {

}

impl From<Header> for InfoSource {
  fn from(
    Header {
      protocol_version,
      vendor_id,
      guid_prefix,
      ..
    }: Header,
  ) -> Self {
    InfoSource {
      unused: 0,
      protocol_version,
      vendor_id,
      guid_prefix,
    }
  }
}

impl From<InfoSource> for Header {
  fn from(
    InfoSource {
      protocol_version,
      vendor_id,
      guid_prefix,
      ..
    }: InfoSource,
  ) -> Self {
    Header {
      protocol_id: ProtocolId::PROTOCOL_RTPS,
      protocol_version,
      vendor_id,
      guid_prefix,
    }
  }
}

