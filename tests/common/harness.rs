//! The harness of test binaries whose tests need a tool or a peer: a test that lacks it is listed as ignored,
//! with what to install. Such a binary has `harness = false` in `Cargo.toml`, names its tests in [`tests!`],
//! and has no `#[test]`.

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
///
/// The same text wherever the same is missing, so that [`main`] counts these tests together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing(pub String);

impl From<&str> for Missing {
    fn from(what: &str) -> Self {
        Self(what.to_owned())
    }
}

/// What a test function gives: nothing, where it needs no peer, or a result.
pub trait Ended {
    fn ended(self) -> Result<(), Missing>;
}

impl Ended for () {
    fn ended(self) -> Result<(), Missing> {
        Ok(())
    }
}

impl Ended for Result<(), Missing> {
    fn ended(self) -> Self {
        self
    }
}

/// A test: its name and body.
pub struct PeerTest {
    pub name: &'static str,
    pub run: fn() -> Result<(), Missing>,
    /// Why it runs only where `--ignored` or `--include-ignored` asks for it.
    pub on_request: Option<&'static str>,
}

/// The list of tests that [`main`] takes: functions without arguments, which give nothing or
/// `Result<(), Missing>`; those behind `on request:` run only with `--ignored` or `--include-ignored`, and
/// may say why: `name = "10 minutes"`.
macro_rules! tests {
    (
        $($(#[$attribute:meta])* $name:ident),* $(,)?
        $(; on request: $($(#[$slow_attribute:meta])* $slow:ident $(= $why:literal)?),* $(,)?)?
    ) => {
        [
            $(
                $(#[$attribute])*
                $crate::harness::PeerTest {
                    name: stringify!($name),
                    run: || $crate::harness::Ended::ended($name()),
                    on_request: None,
                },
            )*
            $($(
                $(#[$slow_attribute])*
                $crate::harness::PeerTest {
                    name: stringify!($slow),
                    run: || $crate::harness::Ended::ended($slow()),
                    on_request: Some(concat!("on request" $(, ": ", $why)?)),
                },
            )*)?
        ]
    };
}
pub(crate) use tests;

/// Runs the tests that the command line asks for; at the end a line for everything that was missing.
///
/// With `CI=true` a test that lacks something fails: CI has all peers, and a test that did not run is no
/// pass.
pub fn main<const N: usize>(tests: [PeerTest; N]) -> ExitCode {
    let arguments = Arguments::from_args();
    let is_asked = arguments.ignored || arguments.include_ignored || arguments.list;
    let trials = tests.into_iter().map(|test| match test.on_request {
        // Without the flag, which would hide the reason.
        Some(why) if !is_asked => Trial::ignorable_test(test.name, move || Ok(Completion::ignored_with(why))),
        on_request => {
            let trial = Trial::ignorable_test(test.name, move || completion((test.run)()));
            trial.with_ignored_flag(on_request.is_some())
        }
    });
    let conclusion = libtest_mimic::run(&arguments, trials.collect());
    let lacked = LACKED.lock().unwrap_or_else(PoisonError::into_inner);
    for (what, count) in lacked.iter() {
        println!("{count} did not run: {what}");
    }
    if !lacked.is_empty() {
        println!();
    }
    conclusion.exit_code()
}

/// How many tests lacked what.
static LACKED: Mutex<BTreeMap<String, usize>> = Mutex::new(BTreeMap::new());

fn completion(ended: Result<(), Missing>) -> Result<Completion, Failed> {
    let Err(Missing(what)) = ended else { return Ok(Completion::Completed) };
    if std::env::var_os("CI").is_some_and(|ci| ci == "true") {
        return Err(Failed::from(format!("CI=true, but {what}")));
    }
    *LACKED.lock().unwrap_or_else(PoisonError::into_inner).entry(what.clone()).or_default() += 1;
    Ok(Completion::ignored_with(what))
}
