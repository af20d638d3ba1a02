//! How ROS 2 names topics, services and their types in DDS, and what it says of an endpoint in USER_DATA.

use ros2_client::{Name, NodeName};

/// Types with their REP-2016 hashes, written by `tests/python/ros/definitions.py`.
const HASHES: &str = include_str!("type_hashes.txt");

/// DDS name of the topic with a full ROS name.
#[must_use]
pub(crate) fn topic_dds_name(full: &Name, node: &NodeName) -> String {
    full.to_dds_name("rt", node, "")
}

/// DDS names of a service's topics for requests and replies.
#[must_use]
pub(crate) fn service_dds_names(full: &Name, node: &NodeName) -> [String; 2] {
    [full.to_dds_name("rq", node, "Request"), full.to_dds_name("rr", node, "Reply")]
}

/// The ROS name of a DDS topic, or the DDS name where it has none.
#[must_use]
pub(crate) fn ros_name_of_topic(dds_name: &str) -> &str {
    match dds_name.split_once('/') {
        Some(("rt" | "rq" | "rr", _)) => &dds_name[2..],
        _ => dds_name,
    }
}

/// DDS name of a ROS type: `sensor_msgs/msg/Image` is `sensor_msgs::msg::dds_::Image_`.
///
/// `ros2_client::MessageTypeName` knows the folder `msg` only, and its names of requests, replies and actions
/// are private.
#[must_use]
pub(crate) fn type_dds_name(ros_type: &str) -> String {
    match ros_type.rsplit_once('/') {
        Some((folder, name)) => format!("{}::dds_::{name}_", folder.replace('/', "::")),
        None => format!("{ros_type}_"),
    }
}

/// USER_DATA of an endpoint: the hash of its type, which rmw implementations read, and `more`.
#[must_use]
pub(crate) fn endpoint_user_data(ros_type: &str, more: &str) -> Vec<u8> {
    let hash = HASHES.lines().filter_map(|l| l.split_once(' ')).find(|(name, _)| *name == ros_type);
    format!("{more}typehash={};", hash.map_or("", |(_, hash)| hash)).into_bytes()
}

/// The value of a key in USER_DATA of the form `key=value;key=value;`.
#[must_use]
pub(crate) fn user_data_value<'a>(user_data: &'a [u8], key: &str) -> Option<&'a [u8]> {
    let pairs = user_data.split(|b| *b == b';');
    pairs.filter_map(|p| p.strip_prefix(key.as_bytes())?.strip_prefix(b"=")).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_rmw() {
        assert_eq!(type_dds_name("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
        assert_eq!(type_dds_name("a/srv/B_Request"), "a::srv::dds_::B_Request_");
        let node = NodeName::new("/lab", "twin").unwrap();
        let service = Name::parse("/a/b").unwrap();
        assert_eq!(service_dds_names(&service, &node), ["rq/a/bRequest", "rr/a/bReply"]);
        let topic = topic_dds_name(&Name::parse("/a").unwrap(), &node);
        assert_eq!((topic.as_str(), ros_name_of_topic(&topic)), ("rt/a", "/a"));
        assert_eq!(ros_name_of_topic("ros_discovery_info"), "ros_discovery_info");
    }

    #[test]
    fn user_data_is_read_back() {
        let data = endpoint_user_data("sensor_msgs/msg/Image", "serviceid=1.2;");
        let hash = user_data_value(&data, "typehash").unwrap();
        assert!(hash.starts_with(b"RIHS01_") && hash.len() == 71, "{data:?}");
        assert_eq!(user_data_value(&data, "serviceid"), Some(&b"1.2"[..]));
        assert_eq!(user_data_value(&data, "id"), None);
    }
}
