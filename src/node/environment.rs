//! Environment variables of a ROS 2 program: domain, network, middleware, security.

use std::net::{IpAddr, Ipv4Addr, ToSocketAddrs as _, UdpSocket};

/// How far the node is found by itself (`ROS_AUTOMATIC_DISCOVERY_RANGE`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Reach {
    /// Not at all.
    Off,
    /// On this machine.
    Localhost,
    /// In the networks of this machine.
    #[default]
    Subnet,
}

/// Settings from environment variables.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Environment {
    /// DDS domain ID.
    pub domain: u16,
    /// How far the node is found by itself.
    pub reach: Reach,
    /// Machines that are asked for other nodes (`ROS_STATIC_PEERS`).
    pub peers: Vec<IpAddr>,
    /// Addresses of the networks to use; `None` for all.
    pub networks: Option<Vec<IpAddr>>,
    /// Warnings to log.
    pub warnings: Vec<String>,
}

/// Why the environment prevents a start.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum EnvironmentError {
    /// Invalid domain ID.
    #[error("ROS_DOMAIN_ID is `{0}`; give a number from 0 to 232")]
    Domain(String),
    /// Security is enforced, but this build does not support it.
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
    /// # Errors
    /// If the domain ID is invalid or security is enforced.
    pub(crate) fn read(get: impl Fn(&str) -> Option<String>) -> Result<Self, EnvironmentError> {
        // Empty variables count as unset, as in rcl.
        let get = |name: &str| get(name).filter(|v| !v.is_empty());
        let mut warnings = Vec::new();
        let domain = match get("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => {
                // DDS derives UDP ports from the domain: 7400 + 250 per domain must stay below 65,536.
                text.trim().parse().ok().filter(|d| *d <= 232).ok_or(EnvironmentError::Domain(text))?
            }
        };
        // Where security is enforced, unencrypted communication would be worse than none.
        if get("ROS_SECURITY_ENABLE").is_some_and(|v| v.eq_ignore_ascii_case("true")) {
            if get("ROS_SECURITY_STRATEGY").is_some_and(|v| v.eq_ignore_ascii_case("enforce")) {
                return Err(EnvironmentError::Security);
            }
            warnings.push(
                "ROS_SECURITY_ENABLE is true, but this build has no DDS security: it talks in the clear"
                    .into(),
            );
        }
        let range = get("ROS_AUTOMATIC_DISCOVERY_RANGE");
        // As rmw_dds_common: the older variable wins, and anything else is the default of ROS 2.
        let reach = match (get("ROS_LOCALHOST_ONLY").as_deref(), range.as_deref()) {
            (Some("1"), _) | (_, Some("LOCALHOST")) => Reach::Localhost,
            (_, Some("OFF")) => Reach::Off,
            (_, None | Some("SUBNET" | "SYSTEM_DEFAULT")) => Reach::Subnet,
            (_, Some(other)) => {
                warnings.push(format!(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE is `{}`, none of SUBNET, LOCALHOST, OFF and \
                     SYSTEM_DEFAULT: taken as SUBNET",
                    other.escape_debug()
                ));
                Reach::Subnet
            }
        };
        let mut peers = Vec::new();
        // With SYSTEM_DEFAULT the middleware decides alone; OFF is stronger than a list.
        let listed = get("ROS_STATIC_PEERS")
            .filter(|_| reach != Reach::Off && range.as_deref() != Some("SYSTEM_DEFAULT"));
        for name in listed.iter().flat_map(|l| l.split(';')).map(str::trim).filter(|n| !n.is_empty()) {
            match addresses_of_peer(name) {
                addresses if !addresses.is_empty() => peers.extend(addresses),
                _ => warnings.push(format!(
                    "ROS_STATIC_PEERS names `{}`, which has no IPv4 address",
                    name.escape_debug()
                )),
            }
        }
        let middleware = get("RMW_IMPLEMENTATION");
        if middleware.as_deref().is_some_and(|m| m.contains("zenoh")) {
            warnings.push(
                "RMW_IMPLEMENTATION names zenoh, but this node speaks DDS: its neighbors will not see it"
                    .into(),
            );
        }
        let networks = networks_to_use(reach, &peers);
        Ok(Self { domain, reach, peers, networks, warnings })
    }

    /// Whether nobody is to be heard.
    #[must_use]
    pub(crate) fn is_alone(&self) -> bool {
        self.reach == Reach::Off
    }

    /// Whether only this machine can reach the node.
    #[must_use]
    pub(crate) fn is_closed(&self) -> bool {
        self.reach != Reach::Subnet && self.peers.iter().all(IpAddr::is_loopback)
    }

    /// Machines to which the node announces itself by unicast.
    #[must_use]
    pub(crate) fn discovery_peers(&self) -> Vec<IpAddr> {
        let mut peers = self.peers.clone();
        // Other nodes on this machine, without multicast.
        if self.reach == Reach::Localhost {
            peers.push(IpAddr::V4(Ipv4Addr::LOCALHOST));
        }
        peers
    }
}

/// Addresses of the networks by which others and the listed peers are reached; `None` for all.
fn networks_to_use(reach: Reach, peers: &[IpAddr]) -> Option<Vec<IpAddr>> {
    match reach {
        Reach::Subnet => None,
        Reach::Off => Some(Vec::new()),
        Reach::Localhost => {
            let mut networks = vec![IpAddr::V4(Ipv4Addr::LOCALHOST)];
            for peer in peers {
                networks.extend(own_address_towards(*peer).filter(|a| !networks.contains(a)));
            }
            Some(networks)
        }
    }
}

/// IPv4 addresses of a host.
fn addresses_of_peer(name: &str) -> Vec<IpAddr> {
    let found = (name, 0).to_socket_addrs().map(|all| all.map(|a| a.ip()).filter(IpAddr::is_ipv4).collect());
    found.unwrap_or_default()
}

/// The address of this machine from which a host is reached.
fn own_address_towards(peer: IpAddr) -> Option<IpAddr> {
    // No datagram is sent: the system looks up the route.
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((peer, 9)).ok()?;
    Some(socket.local_addr().ok()?.ip())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(pairs: &[(&str, &str)]) -> Result<Environment, EnvironmentError> {
        Environment::read(|name| pairs.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
    }

    #[test]
    fn the_range_is_that_of_ros_2() {
        let reach = |pairs: &[(&str, &str)]| read(pairs).unwrap().reach;
        assert_eq!(reach(&[]), Reach::Subnet);
        for (range, expected) in [
            ("SUBNET", Reach::Subnet),
            ("SYSTEM_DEFAULT", Reach::Subnet),
            ("LOCALHOST", Reach::Localhost),
            ("OFF", Reach::Off),
        ] {
            assert_eq!(reach(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", range)]), expected);
        }
        assert_eq!(reach(&[("ROS_LOCALHOST_ONLY", "0")]), Reach::Subnet);
        let both = [("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")];
        assert_eq!(reach(&both), Reach::Localhost);
        let strange = read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost")]).unwrap();
        assert!(strange.reach == Reach::Subnet && strange.warnings[0].contains("`localhost`"));
    }

    #[test]
    fn peers_open_the_networks_by_which_they_are_reached() {
        let local = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        let alone = read(&[local]).unwrap();
        assert!(alone.is_closed());
        assert_eq!(alone.networks.clone().unwrap(), alone.discovery_peers());
        let peers = read(&[local, ("ROS_STATIC_PEERS", "127.0.0.1; 192.0.2.7;;")]).unwrap();
        assert_eq!(peers.peers, ["127.0.0.1", "192.0.2.7"].map(|a| a.parse::<IpAddr>().unwrap()));
        assert!(!peers.is_closed());
        let off =
            read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"), ("ROS_STATIC_PEERS", "192.0.2.7")]).unwrap();
        assert!(off.is_closed() && off.is_alone() && off.peers.is_empty());
        assert_eq!(off.networks, Some(Vec::new()));
        let unknown = read(&[("ROS_STATIC_PEERS", "no host")]).unwrap();
        assert!(unknown.peers.is_empty() && unknown.warnings[0].contains("`no host`"));
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
}
