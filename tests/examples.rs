//! The examples run, one after the other.

#[path = "../examples/diagnose_run.rs"]
mod diagnose_run;
#[path = "../examples/read_model.rs"]
mod read_model;
#[path = "../examples/reconstruct_bag.rs"]
mod reconstruct_bag;

#[test]
fn a_bag_becomes_a_twin_that_is_read_and_diagnosed() {
    reconstruct_bag::main().expect("a twin");
    read_model::main().expect("its joints");
    diagnose_run::main().expect("a verdict");
}
