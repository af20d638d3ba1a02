//! `artitwin doctor`.

use std::fmt::Write as _;

use super::{
    exit::{CliError, Exit},
    machine::Machine,
    terminal,
};
use field::{self, Adapter, EngineError, InstructionSet};

/// Less available memory than this is worth a word, bytes.
const MEMORY_WANTED: u64 = 4 << 30;
/// Less free disk space than this is worth a word, bytes.
const DISK_WANTED: u64 = 2 << 30;

/// Text for a value unknown to the system.
const UNKNOWN: &str = "unknown";

/// Prints the abilities of the machine, and those used by a run.
///
/// # Errors
/// If nothing can be printed.
pub(super) fn print_machine() -> Result<Exit, CliError> {
    terminal::print_result(&machine_report(&Machine::detect(), &field::adapters()))?;
    terminal::print_result(&format!("engine     cpu, {} kernels\n", InstructionSet::detect().name()))?;
    Ok(Exit::Done)
}

fn machine_report(machine: &Machine, adapters: &Result<Vec<Adapter>, EngineError>) -> String {
    let threads = machine.threads.map_or_else(|| UNKNOWN.to_owned(), |n| n.to_string());
    let vectors = if machine.vector_instructions.is_empty() {
        "none known".to_owned()
    } else {
        machine.vector_instructions.join(" ")
    };
    let mut text = format!(
        "artitwin   {} ({} {})\nprocessor  {}, {threads} threads, {vectors}\n",
        env!("CARGO_PKG_VERSION"),
        std::env::consts::OS,
        std::env::consts::ARCH,
        machine.processor.as_deref().unwrap_or(UNKNOWN),
    );
    let lines = [
        format!(
            "memory     {} of {} available{}",
            size_text(machine.memory_available),
            size_text(machine.memory_total),
            shortage_text(machine.memory_available, MEMORY_WANTED)
        ),
        format!(
            "disk       {} free in this folder{}",
            size_text(machine.disk_free),
            shortage_text(machine.disk_free, DISK_WANTED)
        ),
        match adapters {
            Ok(found) if found.is_empty() => "gpu        no adapter found".to_owned(),
            Ok(found) => found.iter().map(adapter_line).collect::<Vec<_>>().join("\n"),
            Err(EngineError::NotBuilt) => "gpu        built without the gpu feature".to_owned(),
            Err(error) => format!("gpu        {error}"),
        },
    ];
    // Writing to a String cannot fail.
    lines.iter().for_each(|line| writeln!(text, "{line}").unwrap_or_default());
    text
}

fn adapter_line(adapter: &Adapter) -> String {
    let slow = if adapter.is_software { "; software, slower than the cpu engine" } else { "" };
    format!("gpu        {}{slow}", adapter.description)
}

fn size_text(bytes: Option<u64>) -> String {
    bytes.map_or_else(|| UNKNOWN.to_owned(), |b| format!("{:.1} GiB", b as f64 / (1u64 << 30) as f64))
}

/// A remark on too little of something. It is no refusal: the need of a run depends on the recording.
fn shortage_text(available: Option<u64>, wanted: u64) -> &'static str {
    if available.is_some_and(|a| a < wanted) { "; this may be too little" } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(description: &str) -> Adapter {
        Adapter { description: description.to_owned(), is_software: true }
    }

    #[test]
    fn the_report_names_what_is_there_and_what_is_short() {
        let machine = Machine {
            processor: Some("Example CPU".to_owned()),
            vector_instructions: vec!["avx2", "fma"],
            threads: Some(2),
            memory_total: Some(8 << 30),
            memory_available: Some(3 << 30),
            disk_free: None,
        };
        let text = machine_report(&machine, &Ok(vec![adapter("llvmpipe")]));
        for line in [
            "processor  Example CPU, 2 threads, avx2 fma",
            "memory     3.0 GiB of 8.0 GiB available; this may be too little",
            "disk       unknown free in this folder",
            "gpu        llvmpipe; software, slower than the cpu engine",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} not in\n{text}");
        }
        assert!(
            machine_report(&machine, &Err(EngineError::NotBuilt)).contains("built without the gpu feature")
        );
    }
}
