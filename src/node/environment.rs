//! The environment of a ROS 2 program: domain, reach, middleware, security.

use std::net::{IpAddr, Ipv4Addr};

use ros2_client::ServiceMapping;

/// Settings from environment variables.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Environment {
    /// DDS domain.
    pub domain: u16,
    /// Whether only this machine is talked to.
    pub localhost: bool,
    /// The neighbors' middleware, where it is known.
    pub middleware: Option<String>,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// Why the node refuses to start.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum EnvironmentError {
    /// No domain.
    #[error("ROS_DOMAIN_ID is `{0}`; give a number from 0 to 232")]
    Domain(String),
    /// Security is enforced but not there.
    #[error(
        "ROS_SECURITY_ENABLE is true and ROS_SECURITY_STRATEGY is Enforce, but this build has no DDS \
         security; \
         run it in a domain without security, or unset these variables"
    )]
    Security,
}

impl Environment {
    /// Reads the variables through `get`.
    ///
    /// # Errors An invalid domain; enforced security.
    pub(crate) fn read(get: impl Fn(&str) -> Option<String>) -> Result<Self, EnvironmentError> {
        // An empty variable counts as unset, as in rcl.
        let get = |name: &str| get(name).filter(|v| !v.is_empty());
        let mut warnings = Vec::new();
        let domain = match get("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => {
                // DDS makes UDP ports of the domain: 7400 + 250 per domain has to stay below 65,536.
                text.trim().parse().ok().filter(|d| *d <= 232).ok_or(EnvironmentError::Domain(text))?
            }
        };
        // To go on in the clear where security is enforced would be worse than to stop.
        if get("ROS_SECURITY_ENABLE").is_some_and(|v| v.eq_ignore_ascii_case("true")) {
            if get("ROS_SECURITY_STRATEGY").is_some_and(|v| v.eq_ignore_ascii_case("enforce")) {
                return Err(EnvironmentError::Security);
            }
            warnings.push(
                "ROS_SECURITY_ENABLE is true, but this build has no DDS security: it talks in the clear"
                    .into(),
            );
        }
        let localhost =
            match (get("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref(), get("ROS_LOCALHOST_ONLY").as_deref()) {
                (_, Some("1")) | (Some("LOCALHOST"), _) => true,
                (Some("SUBNET" | "SYSTEM_DEFAULT"), _) | (None, Some("0")) => false,
                // ROS 2 would talk to the subnet. DDS has no authentication here, so
                // the network is opened only on request.
                (None, _) => true,
                (Some(other), _) => {
                    warnings.push(format!(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE={other} is not supported: only this machine is talked to"
                ));
                    true
                }
            };
        let middleware = get("RMW_IMPLEMENTATION");
        if middleware.as_deref().is_some_and(|m| m.contains("zenoh")) {
            warnings.push(
                "RMW_IMPLEMENTATION names zenoh, but this node speaks DDS: its neighbors will not see it"
                    .into(),
            );
        }
        Ok(Self { domain, localhost, middleware, warnings })
    }

    /// The used networks; `None`: all.
    #[must_use]
    pub(crate) fn networks(&self) -> Option<[IpAddr; 1]> {
        self.localhost.then_some([IpAddr::V4(Ipv4Addr::LOCALHOST)])
    }

    /// Form of service requests on the wire, by the middleware.
    #[must_use]
    pub(crate) fn service_mapping(&self, parameter: &str) -> ServiceMapping {
        let cyclone = self.middleware.as_deref().is_some_and(|m| m.contains("cyclonedds"));
        match parameter {
            "cyclone" => ServiceMapping::Cyclone,
            // rmw_cyclonedds puts the request's identity before the
            // body, Fast DDS into the sample's metadata.
            "auto" if cyclone => ServiceMapping::Cyclone,
            _ => ServiceMapping::Enhanced,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(pairs: &[(&str, &str)]) -> Result<Environment, EnvironmentError> {
        Environment::read(|name| pairs.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
    }

    #[test]
    fn only_this_machine_unless_it_is_opened() {
        assert!(read(&[]).unwrap().localhost);
        assert!(!read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]).unwrap().localhost);
        assert!(!read(&[("ROS_LOCALHOST_ONLY", "0")]).unwrap().localhost);
        assert!(
            read(&[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")])
                .unwrap()
                .localhost
        );
        let off = read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]).unwrap();
        assert!(off.localhost && off.warnings[0].contains("OFF"));
    }

    #[test]
    fn enforced_security_and_strange_domains_are_refused() {
        let secure = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")];
        assert_eq!(read(&secure), Err(EnvironmentError::Security));
        assert!(read(&secure[..1]).unwrap().warnings[0].contains("in the clear"));
        assert_eq!(read(&[("ROS_DOMAIN_ID", "7")]).unwrap().domain, 7);
        for wrong in ["-1", "233", "x"] {
            assert!(matches!(read(&[("ROS_DOMAIN_ID", wrong)]), Err(EnvironmentError::Domain(_))), "{wrong}");
        }
    }

    #[test]
    fn the_mapping_follows_the_middleware() {
        let cyclone = read(&[("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")]).unwrap();
        assert_eq!(cyclone.service_mapping("auto"), ServiceMapping::Cyclone);
        assert_eq!(cyclone.service_mapping("fastdds"), ServiceMapping::Enhanced);
        assert_eq!(read(&[]).unwrap().service_mapping("auto"), ServiceMapping::Enhanced);
    }
}
