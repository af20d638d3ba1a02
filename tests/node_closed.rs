//! The node against neighbors that mean harm: who reaches it, and what a datagram may cost it.

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

use std::process::ExitCode;

use harness::{Missing, tests};
use ros::{Node, linux_python, printed_in_namespace, scenario, serial, with_fastdds};

fn main() -> ExitCode {
    harness::main(tests![
        who_is_not_on_this_machine_gets_nothing,
        a_datagram_costs_no_more_than_it_holds,
        large_images_arrive,
    ])
}

fn who_is_not_on_this_machine_gets_nothing() -> Result<(), Missing> {
    let told = printed_in_namespace("outside.py", &[])?;
    let closed = &told["closed"];
    assert_eq!(closed["bound"], serde_json::json!(["127.0.0.1", "239.255.0.1"]), "{told}");
    assert_eq!(
        (&closed["outside"]["datagrams"], &closed["outside"]["service"]),
        (&"0".into(), &"nothing".into()),
        "{told}"
    );
    // Nor does a neighbor on this machine that speaks for an address of the network.
    assert_eq!(closed["outside"]["own_address"], "nothing", "{told}");
    assert_eq!((&closed["begun_from_outside"], &closed["inside"]), (&0.into(), &"True".into()), "{told}");
    // Opened, the same neighbor is served, and the node says so.
    let open = &told["open"];
    assert_eq!(
        (&open["outside"]["service"], &open["begun_from_outside"]),
        (&"True".into(), &1.into()),
        "{told}"
    );
    assert_ne!(open["outside"]["datagrams"], "0", "{told}");
    let log = open["log"].as_str().unwrap();
    assert!(
        ["10.9.9.1", "22910", "22911", "no authentication", "services"].iter().all(|w| log.contains(w)),
        "{log}"
    );
    assert!(!closed["log"].as_str().unwrap().contains("open to the network"), "{told}");
    Ok(())
}

fn a_datagram_costs_no_more_than_it_holds() -> Result<(), Missing> {
    let python = linux_python()?;
    if with_fastdds() {
        return Err(ros::ONLY_CYCLONE.into());
    }
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(64, &[format!("out_folder:={}", folder.path().join("out").display())]);
    let told = scenario(&python, 64, &["claims", "--pid", &node.id().to_string()]);
    let log = node.end();
    assert!(!log.contains("panicked"), "{log}");
    let costs = told["costs"].as_object().unwrap();
    assert_eq!(costs.len(), 7, "{told}");
    assert!(costs.values().all(|mib| mib.as_f64().unwrap() < 32.0), "{told}");
    // Samples that were begun: at most the largest one is held for a writer, and nothing after the time-out.
    let (held, released) = (told["held"].as_f64().unwrap(), told["released"].as_f64().unwrap());
    assert!((20.0..100.0).contains(&held) && released < 32.0, "{told}");
    assert_eq!(told["answers"], true, "{told}");
    Ok(())
}

fn large_images_arrive() -> Result<(), Missing> {
    let python = linux_python()?;
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let node = Node::start(
        65,
        &["image_qos:=default".to_owned(), format!("out_folder:={}", folder.path().join("out").display())],
    );
    let told = scenario(&python, 65, &["large"]);
    node.end();
    assert_eq!(
        (&told["color"]["received"], &told["color"]["lost"], &told["color"]["malformed"]),
        (&"3".into(), &"0".into(), &"0".into()),
        "{told}"
    );
    Ok(())
}
