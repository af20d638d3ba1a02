//! The harness of test binaries whose tests need a tool or a peer: a test that lacks it is listed as ignored, with what to
//! install. Such a binary has `harness = false` in `Cargo.toml`, names its tests in [`tests!`], and has no `#[test]`.

#![allow(
    dead_code,
    unused_macros,
    unused_imports,
    clippy::print_stdout,
    reason = "every test binary uses its own part of this"
)]

use std::{
    collections::BTreeMap,
    process::ExitCode,
    sync::{Mutex, PoisonError},
};

use libtest_mimic::{Arguments, Completion, Failed, Trial};

/// Something that a test needs and that this machine lacks: what, and what to install.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing(pub String);

impl From<&str> for Missing {
    fn from(what: &str) -> Self {
        Self(what.to_owned())
    }
}

/// A test: its name and body.
pub struct PeerTest {
    pub name: &'static str,
    pub run: fn() -> Result<(), Missing>,
    /// Why it runs only where `--ignored` asks for it.
    pub on_request: bool,
}

/// The list of tests that [`main`] takes: functions that return `Result<(), Missing>`; those behind `on request:` run only
/// with `--ignored` or `--include-ignored`.
macro_rules! tests {
    ($($name:ident),* $(,)? $(; on request: $($slow:ident),* $(,)?)?) => {
        [
            $($crate::harness::PeerTest { name: stringify!($name), run: $name, on_request: false },)*
            $($($crate::harness::PeerTest { name: stringify!($slow), run: $slow, on_request: true },)*)?
        ]
    };
}
pub(crate) use tests;

/// Runs the tests that the command line asks for; at the end a line for everything that was missing.
///
/// With `CI=true` a test that lacks something fails: CI has all peers, and a test that did not run is no pass.
pub fn main<const N: usize>(tests: [PeerTest; N]) -> ExitCode {
    static LACKED: Mutex<BTreeMap<String, usize>> = Mutex::new(BTreeMap::new());
    let is_ci = std::env::var_os("CI").is_some_and(|ci| ci == "true");
    let trial = |test: PeerTest| {
        let body = move || match (test.run)() {
            Ok(()) => Ok(Completion::Completed),
            Err(Missing(what)) if is_ci => Err(Failed::from(format!("CI=true, but {what}"))),
            Err(Missing(what)) => {
                *LACKED.lock().unwrap_or_else(PoisonError::into_inner).entry(what.clone()).or_default() += 1;
                Ok(Completion::ignored_with(what))
            }
        };
        Trial::ignorable_test(test.name, body).with_ignored_flag(test.on_request)
    };
    let conclusion = libtest_mimic::run(&Arguments::from_args(), tests.into_iter().map(trial).collect());
    for (what, count) in LACKED.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        println!("{count} did not run: {what}\n");
    }
    conclusion.exit_code()
}
