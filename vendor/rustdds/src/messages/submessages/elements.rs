
pub mod inline_qos;
pub mod parameter;
pub mod parameter_list;
pub mod serialized_payload;

pub use crate::RepresentationIdentifier;
