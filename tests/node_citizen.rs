//! The node among peers configured as ROS 2 configures them: no interface named, on a machine with an
//! Ethernet card (a network namespace with a pair of interfaces).

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "a test may panic, and says why it is left out"
)]

mod common;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/ros.rs"]
mod ros;
#[path = "common/venv.rs"]
mod venv;

use std::{path::Path, process::ExitCode};

use harness::{Missing, tests};
use ros::{printed_in_namespace, with_fastdds};
use serde_json::Value;

/// Longest time for the first reply to a fresh client, seconds.
/// chosen: a person does not notice it; a reply that was lost takes 3 s or never comes
const FIRST_REPLY_SECS: f64 = 0.2;

fn main() -> ExitCode {
    harness::main(tests![
        services_answer_as_ros_2_expects,
        a_node_that_is_closed_says_who_cannot_hear_it,
        without_multicast_a_list_of_peers_helps,
        images_at_30_hz_arrive_from_a_default_peer;
        on request:
        five_minutes_of_images_arrive_from_a_default_peer = "5 minutes of images at 30 Hz",
    ])
}

/// Runs `tests/python/ros/citizen.py` in a network namespace of its own.
fn citizen(arguments: &[&str]) -> Result<Value, Missing> {
    if with_fastdds() {
        return Err(ros::ONLY_CYCLONE.into());
    }
    printed_in_namespace("citizen.py", arguments)
}

fn log_of(told: &Value) -> &str {
    told["log"].as_str().unwrap()
}

fn services_answer_as_ros_2_expects() -> Result<(), Missing> {
    let told = citizen(&["services"])?;
    let log = log_of(&told);
    assert!(!log.contains("panicked"), "{log}");
    // The range is that of ROS 2, and one line tells what is open.
    assert!(log.contains("open to the network: addresses 10.9.9.1"), "{log}");
    // First calls of fresh clients, which wait for the service and no longer.
    let calls = told["first_calls"].as_array().unwrap();
    let slow = calls.iter().filter(|s| s.as_f64().is_none_or(|s| s > FIRST_REPLY_SECS)).count();
    assert!(calls.len() == 50 && slow == 0, "{slow} of {calls:?}");
    // Replies that do not fit into a datagram.
    assert_eq!(told["got"], told["names"], "{told}");
    assert!(told["long"].as_u64().unwrap() > 200_000, "{}", told["long"]);
    assert_eq!(told["undescribed"], serde_json::json!([]));
    // Outputs come, with paths that mean the same elsewhere.
    assert!(Path::new(told["session"].as_str().unwrap()).is_absolute(), "{}", told["session"]);
    // Parameters: one that can be set, one that gives its reason.
    assert_eq!(told["set"][0], serde_json::json!([true, ""]));
    let refused = told["set"][1][1].as_str().unwrap();
    assert!(told["set"][1][0] == false && refused.contains("the subscriptions stand"), "{refused}");
    assert_eq!(told["tracking"], "never");
    // Every endpoint has the hash of its type.
    let user_data = told["user_data"].as_object().unwrap();
    assert!(user_data.len() > 40, "{user_data:?}");
    for (endpoint, data) in user_data {
        let hash = data.as_str().unwrap().split(';').find_map(|pair| pair.strip_prefix("typehash=RIHS01_"));
        assert!(hash.is_some_and(|h| h.len() == 64), "{endpoint}: {data}");
    }
    // Without simulated time nothing is read from /clock.
    let read = told["read"].as_array().unwrap();
    assert!(
        read.contains(&"rq/artitwin/saveRequest".into()) && !read.contains(&"rt/clock".into()),
        "{read:?}"
    );
    // A subscriber that asks for more than is offered is named.
    assert!(log.contains("/artitwin/unseen: a subscriber gets nothing, as it asks for durability"), "{log}");
    assert_eq!(told["eager"], 0);
    Ok(())
}

fn a_node_that_is_closed_says_who_cannot_hear_it() -> Result<(), Missing> {
    let told = citizen(&["closed"])?;
    let log = log_of(&told["LOCALHOST"]);
    // At the start, whoever is there; and by name, whose announcement comes.
    assert!(log.contains("open to this machine only") && log.contains("to LOCALHOST for them too"), "{log}");
    assert!(
        log.contains("a participant is on 10.9.9.1 only") && log.contains("to SUBNET for this node"),
        "{log}"
    );
    assert_eq!(told["LOCALHOST"]["heard"], false);
    let alone = log_of(&told["OFF"]);
    assert!(told["OFF"]["heard"] == false && alone.contains("closed to all other nodes"), "{told}");
    Ok(())
}

fn without_multicast_a_list_of_peers_helps() -> Result<(), Missing> {
    let told = citizen(&["unlisted"])?;
    assert_eq!((&told["none"], &told["10.9.9.2"]), (&"False".into(), &"True".into()), "{told}");
    Ok(())
}

/// Images at 30 Hz for some seconds, best effort as a camera driver sends them.
fn flood(seconds: &str) -> Result<(), Missing> {
    let told = citizen(&["flood", seconds])?;
    for part in ["color", "depth"] {
        assert_eq!(told[part]["dropped_busy"], 0, "{part}: {told}");
        assert_eq!(
            (&told[part]["received"], &told[part]["lost"]),
            (&told["sent"], &0.into()),
            "{part}: {told}"
        );
    }
    let resident = told["resident_every_20_s"].as_array().unwrap();
    let grown = resident.last().map_or(0, |r| r.as_i64().unwrap())
        - resident.get(1).map_or(0, |r| r.as_i64().unwrap());
    assert!(resident.len() < 3 || grown < 64 << 20, "{told}");
    eprintln!("{}", serde_json::json!({"sent": told["sent"], "color": told["color"], "resident": resident}));
    Ok(())
}

fn images_at_30_hz_arrive_from_a_default_peer() -> Result<(), Missing> {
    flood("10")
}

fn five_minutes_of_images_arrive_from_a_default_peer() -> Result<(), Missing> {
    flood("300")
}
