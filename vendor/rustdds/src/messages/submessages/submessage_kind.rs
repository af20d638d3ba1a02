use std::{fmt, fmt::Debug};

use speedy::{Readable, Writable};

#[derive(PartialEq, Eq, Readable, Writable, Clone, Copy)]
pub struct SubmessageKind {
  value: u8,
}

impl From<SubmessageKind> for u8 {
  fn from(s: SubmessageKind) -> Self {
    s.value
  }
}

impl SubmessageKind {
  pub const PAD: Self = Self { value: 0x01 };
  pub const ACKNACK: Self = Self { value: 0x06 };
  pub const HEARTBEAT: Self = Self { value: 0x07 };
  pub const GAP: Self = Self { value: 0x08 };
  pub const INFO_TS: Self = Self { value: 0x09 };
  pub const INFO_SRC: Self = Self { value: 0x0c };
  pub const INFO_REPLY_IP4: Self = Self { value: 0x0d };
  pub const INFO_DST: Self = Self { value: 0x0e };
  pub const INFO_REPLY: Self = Self { value: 0x0f };
  pub const NACK_FRAG: Self = Self { value: 0x12 };
  pub const HEARTBEAT_FRAG: Self = Self { value: 0x13 };
  pub const DATA: Self = Self { value: 0x15 };
  pub const DATA_FRAG: Self = Self { value: 0x16 };
  pub const SEC_BODY: Self = Self { value: 0x30 }; // Section 7.3.7.5.2 of the Security specification (v. 1.1)
  pub const SEC_PREFIX: Self = Self { value: 0x31 }; // Section 7.3.7.6.2 of the Security specification (v. 1.1)
  pub const SEC_POSTFIX: Self = Self { value: 0x32 }; // Section 7.3.7.7.2 of the Security specification (v. 1.1)
  pub const SRTPS_PREFIX: Self = Self { value: 0x33 }; // Section 7.3.7.8.2 of the Security specification (v. 1.1)
  pub const SRTPS_POSTFIX: Self = Self { value: 0x34 }; // Section 7.3.7.9.2 of the Security specification (v. 1.1)
}

impl Debug for SubmessageKind {
  fn fmt(&self, fmt: &mut fmt::Formatter<'_>) -> fmt::Result {
    match *self {
      Self::PAD => fmt.write_str("PAD"),
      Self::ACKNACK => fmt.write_str("ACKNACK"),
      Self::HEARTBEAT => fmt.write_str("HEARTBEAT"),
      Self::GAP => fmt.write_str("GAP"),
      Self::INFO_TS => fmt.write_str("INFO_TS"),
      Self::INFO_SRC => fmt.write_str("INFO_SRC"),
      Self::INFO_REPLY_IP4 => fmt.write_str("INFO_REPLY_IP4"),
      Self::INFO_DST => fmt.write_str("INFO_DST"),
      Self::INFO_REPLY => fmt.write_str("INFO_REPLY"),
      Self::NACK_FRAG => fmt.write_str("NACK_FRAG"),
      Self::HEARTBEAT_FRAG => fmt.write_str("HEARTBEAT_FRAG"),
      Self::DATA => fmt.write_str("DATA"),
      Self::DATA_FRAG => fmt.write_str("DATA_FRAG"),
      Self::SEC_BODY => fmt.write_str("SEC_BODY"),
      Self::SEC_PREFIX => fmt.write_str("SEC_PREFIX"),
      Self::SEC_POSTFIX => fmt.write_str("SEC_POSTFIX"),
      Self::SRTPS_PREFIX => fmt.write_str("SRTPS_PREFIX"),
      Self::SRTPS_POSTFIX => fmt.write_str("SRTPS_POSTFIX"),
      Self { value: other } => fmt.write_fmt(format_args!("SubmessageKind {other} (UNKNOWN!)")),
    }
  }
}

