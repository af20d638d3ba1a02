//! Fuzz targets: every reader of what comes from a file or the network, on mutated inputs. How to run them,
//! run one input again and add a target: docs/fuzzing.md.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test may panic, and tells what it saw")]
#![cfg(unix)]

mod bags;
mod datasets;
mod engine;
mod forms;
mod images;
mod memory;
mod messages;
mod mutate;
mod recorded;
mod results;
mod settings;
mod twins;

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;
