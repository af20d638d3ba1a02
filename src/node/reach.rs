//! From where the node can be reached, as the system says.

use std::{
    collections::BTreeSet,
    net::{Ipv4Addr, SocketAddr, SocketAddrV4},
};

use super::{environment::Environment, error::NodeError};

/// Reports sockets open to the network; none may be open where only this machine is in reach.
///
/// # Errors For a forbidden open socket.
pub(crate) fn check_sockets(environment: &Environment) -> Result<(), NodeError> {
    // By the kernel's table: RustDDS as published binds to all addresses, whatever is asked of it.
    let sockets = own_sockets();
    if environment.localhost {
        // A socket bound to a multicast group takes messages by the loopback interface only.
        return match sockets.iter().find(|s| !s.ip().is_loopback() && !s.ip().is_multicast()) {
            Some(open) => Err(NodeError::Open(SocketAddr::V4(*open))),
            None => Ok(()),
        };
    }
    log::warn!("{}", reach_warning(&addresses(), &sockets));
    Ok(())
}

fn reach_warning(addresses: &[Ipv4Addr], sockets: &[SocketAddrV4]) -> String {
    let list = |items: BTreeSet<String>| items.into_iter().collect::<Vec<_>>().join(", ");
    format!(
        "open to the network: addresses {}, UDP ports {}; there is no authentication: whoever reaches them \
         can call the services of \
         this node and feed it images; unset ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_LOCALHOST_ONLY to talk \
         to this machine only",
        list(addresses.iter().map(ToString::to_string).collect()),
        list(sockets.iter().map(|s| s.port().to_string()).collect()),
    )
}

/// The machine's addresses but those of the loopback interface.
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

/// The UDP sockets of this process; none where the system does not say.
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

/// Inode and address of a line of `/proc/net/udp`.
fn socket(line: &str) -> Option<(&str, SocketAddrV4)> {
    // sl, local address, remote address, st, queues, timer, retransmits, uid, timeout, inode.
    let mut fields = line.split_whitespace();
    let (ip, port) = fields.nth(1)?.split_once(':')?;
    // The kernel writes the four bytes as one number of this machine.
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
        let said = reach_warning(
            &[Ipv4Addr::new(10, 9, 9, 1)],
            &["0.0.0.0:7400".parse().unwrap(), "0.0.0.0:7410".parse().unwrap()],
        );
        assert!(
            said.contains("10.9.9.1") && said.contains("7400, 7410") && said.contains("no authentication"),
            "{said}"
        );
    }
}
