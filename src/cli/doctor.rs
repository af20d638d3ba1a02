//! `artitwin doctor`.

use std::fmt::Write as _;

use super::{
    args::SettingArgs,
    exit::{CliError, Exit},
    machine::Machine,
    terminal,
};
use config::Engine;
use field::{self, Adapter, EngineError, InstructionSet};

/// Less available memory than this is worth a word, bytes.
const MEMORY_WANTED: u64 = 4 << 30;
/// Less free disk space than this is worth a word, bytes.
const DISK_WANTED: u64 = 2 << 30;

/// Text for a value unknown to the system.
const UNKNOWN: &str = "unknown";

/// Prints the abilities of the machine, and those used by a run with these settings.
///
/// # Errors
/// If the configuration is wrong, or its engine cannot run here.
pub(super) fn print_machine(settings: &SettingArgs) -> Result<Exit, CliError> {
    let engine = settings.resolved_config()?.config.run.engine;
    let adapters = field::adapters();
    // Before the engine is refused: the report shows why.
    terminal::print_result(&machine_report(&Machine::detect(), &adapters))?;
    let name = engine_name(engine, &adapters).map_err(|e| CliError::Machine(e.to_string()))?;
    terminal::print_result(&format!("engine     {name}\n"))?;
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
            Ok(found) => {
                found.iter().map(|a| format!("gpu        {}", a.description)).collect::<Vec<_>>().join("\n")
            }
            Err(EngineError::NotBuilt) => "gpu        built without the gpu feature".to_owned(),
            Err(error) => format!("gpu        {error}"),
        },
    ];
    // Writing to a String cannot fail.
    lines.iter().for_each(|line| writeln!(text, "{line}").unwrap_or_default());
    text
}

fn size_text(bytes: Option<u64>) -> String {
    bytes.map_or_else(|| UNKNOWN.to_owned(), |b| format!("{:.1} GiB", b as f64 / (1u64 << 30) as f64))
}

/// A remark on too little of something. It is no refusal: the need of a run depends on the recording.
fn shortage_text(available: Option<u64>, wanted: u64) -> &'static str {
    if available.is_some_and(|a| a < wanted) { "; this may be too little" } else { "" }
}

/// Why the engine of the settings cannot run here.
#[derive(Debug, thiserror::Error)]
pub(super) enum EngineUnfit {
    /// There is no GPU.
    #[error("run.engine is gpu, but no adapter was found; install a Vulkan driver or use --engine cpu")]
    NoAdapter,
    /// The GPUs cannot be asked.
    #[error("run.engine is gpu: {0}")]
    Adapters(String),
}

/// Name of the engine of the fields, or why it cannot run.
fn engine_name(engine: Engine, adapters: &Result<Vec<Adapter>, EngineError>) -> Result<String, EngineUnfit> {
    match (engine, adapters) {
        (Engine::Cpu, _) => Ok(format!("cpu, {} kernels", InstructionSet::detect().name())),
        (Engine::Burn, _) => Ok("burn on the CPU".to_owned()),
        (Engine::Gpu, Ok(found)) if found.is_empty() => Err(EngineUnfit::NoAdapter),
        (Engine::Gpu, Ok(found)) if found.iter().all(|a| a.is_software) => {
            Ok("burn on a software adapter, which is slower than the cpu engine".to_owned())
        }
        (Engine::Gpu, Ok(_)) => Ok("burn on a GPU".to_owned()),
        (Engine::Gpu, Err(error)) => Err(EngineUnfit::Adapters(error.to_string())),
    }
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
            "gpu        llvmpipe",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} not in\n{text}");
        }
        assert!(
            machine_report(&machine, &Err(EngineError::NotBuilt)).contains("built without the gpu feature")
        );
    }

    #[test]
    fn an_engine_that_cannot_run_is_refused() {
        let software = vec![adapter("llvmpipe (Cpu, Vulkan, driver x)")];
        assert!(engine_name(Engine::Gpu, &Ok(software)).unwrap().contains("software"));
        assert!(
            engine_name(Engine::Gpu, &Err(EngineError::NotBuilt))
                .unwrap_err()
                .to_string()
                .contains("--features gpu")
        );
        assert!(matches!(engine_name(Engine::Gpu, &Ok(Vec::new())), Err(EngineUnfit::NoAdapter)));
        assert!(engine_name(Engine::Cpu, &Err(EngineError::NotBuilt)).unwrap().starts_with("cpu, "));
    }
}
