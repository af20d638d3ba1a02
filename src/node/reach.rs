//! Checks from which networks the node can be reached.

use std::{
    collections::BTreeSet,
    net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4},
};

use super::{environment::Environment, error::NodeError};

/// Logs from where the node can be reached, and checks that no socket is open if only this machine may
/// reach it.
///
/// # Errors
/// [`NodeError`] if a socket is open that must not be.
pub(crate) fn check_sockets(environment: &Environment) -> Result<(), NodeError> {
    // From the kernel's table, as the released RustDDS binds to all addresses regardless of its settings.
    let sockets = own_sockets();
    if environment.is_closed() {
        // A socket bound to a multicast group receives only on the loopback interface.
        if let Some(open) = sockets.iter().find(|s| !s.ip().is_loopback() && !s.ip().is_multicast()) {
            return Err(NodeError::Open(SocketAddr::V4(*open)));
        }
    }
    log::info!("{}", reach_line(environment, &addresses(), &sockets));
    Ok(())
}

fn reach_line(environment: &Environment, addresses: &[Ipv4Addr], sockets: &[SocketAddrV4]) -> String {
    let list = |items: BTreeSet<String>| items.into_iter().collect::<Vec<_>>().join(", ");
    if environment.is_alone() {
        return "closed to all other nodes (ROS_AUTOMATIC_DISCOVERY_RANGE=OFF)".to_owned();
    }
    if environment.is_closed() {
        return "open to this machine only: nodes at the defaults of ROS 2 may get nothing from it; set \
                ROS_AUTOMATIC_DISCOVERY_RANGE to LOCALHOST for them too, or to SUBNET for this node"
            .to_owned();
    }
    let is_used = |a: &&Ipv4Addr| environment.networks.as_ref().is_none_or(|n| n.contains(&IpAddr::V4(**a)));
    let used = addresses.iter().filter(is_used).map(ToString::to_string).collect();
    format!(
        "open to the network: addresses {}, UDP ports {}; there is no authentication: whoever reaches \
         them can call the services of this node and feed it images; \
         ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST closes it",
        list(used),
        list(sockets.iter().map(|s| s.port().to_string()).collect()),
    )
}

/// Addresses of this machine without the loopback interface.
#[cfg(unix)]
fn addresses() -> Vec<Ipv4Addr> {
    let Ok(all) = nix::ifaddrs::getifaddrs() else { return Vec::new() };
    let addresses = all.filter_map(|i| Some(i.address?.as_sockaddr_in()?.ip()));
    addresses.filter(|a| !a.is_loopback()).collect()
}

#[cfg(not(unix))]
fn addresses() -> Vec<Ipv4Addr> {
    Vec::new()
}

/// UDP sockets of this process; empty if the system does not list them.
fn own_sockets() -> Vec<SocketAddrV4> {
    let Ok(descriptors) = std::fs::read_dir("/proc/self/fd") else { return Vec::new() };
    let inodes: BTreeSet<String> = descriptors
        .flatten()
        .filter_map(|d| {
            std::fs::read_link(d.path())
                .ok()?
                .to_str()?
                .strip_prefix("socket:[")?
                .strip_suffix(']')
                .map(str::to_owned)
        })
        .collect();
    let table = std::fs::read_to_string("/proc/self/net/udp").unwrap_or_default();
    table
        .lines()
        .skip(1)
        .filter_map(socket)
        .filter(|(inode, _)| inodes.contains(*inode))
        .map(|(_, address)| address)
        .collect()
}

/// Inode and address from a line of `/proc/net/udp`.
fn socket(line: &str) -> Option<(&str, SocketAddrV4)> {
    // sl, local address, remote address, st, queues, timer, retransmits, uid, timeout, inode.
    let mut fields = line.split_whitespace();
    let (ip, port) = fields.nth(1)?.split_once(':')?;
    // The kernel writes the four bytes as one number in native byte order.
    let ip = u32::from_str_radix(ip, 16).ok()?.to_ne_bytes();
    Some((fields.nth(7)?, SocketAddrV4::new(Ipv4Addr::from(ip), u16::from_str_radix(port, 16).ok()?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sockets_of_this_process_are_found() {
        let own = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        if std::path::Path::new("/proc/self/net/udp").exists() {
            let SocketAddr::V4(address) = own.local_addr().unwrap() else { panic!() };
            assert!(own_sockets().contains(&address));
        }
    }

    #[test]
    fn what_is_open_is_said() {
        let line = |range: &str| {
            let environment =
                Environment::read(|name| (name == "ROS_AUTOMATIC_DISCOVERY_RANGE").then(|| range.to_owned()));
            let sockets = ["0.0.0.0:7400".parse().unwrap(), "0.0.0.0:7410".parse().unwrap()];
            reach_line(&environment.unwrap(), &[Ipv4Addr::new(10, 9, 9, 1)], &sockets)
        };
        let open = line("SUBNET");
        assert!(
            open.contains("10.9.9.1") && open.contains("7400, 7410") && open.contains("no authentication"),
            "{open}"
        );
        assert!(line("LOCALHOST").contains("this machine only") && line("OFF").contains("closed to all"));
    }
}
