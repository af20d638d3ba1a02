//! The abilities of this machine.

use std::{fs, path::Path, thread};

use io::free_bytes;

/// Facts of the machine for a run; `None`: unknown to the system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Machine {
    /// Name of the processor.
    pub processor: Option<String>,
    /// Vector instructions of the processor with a use here.
    pub vector_instructions: Vec<&'static str>,
    /// Threads running at once.
    pub threads: Option<usize>,
    /// Memory, bytes.
    pub memory_total: Option<u64>,
    /// Memory available without swapping, bytes.
    pub memory_available: Option<u64>,
    /// Free space on the disk of the current folder, bytes.
    pub disk_free: Option<u64>,
}

impl Machine {
    /// Asks the system.
    #[must_use]
    pub(super) fn detect() -> Self {
        let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let memory = fs::read_to_string("/proc/meminfo").unwrap_or_default();
        Self {
            // Linux on ARM gives no model name; the report then says `unknown`.
            processor: table_value(&cpu, "model name").map(str::to_owned),
            vector_instructions: vector_instructions(),
            threads: thread::available_parallelism().ok().map(Into::into),
            memory_total: memory_bytes(&memory, "MemTotal"),
            // MemAvailable, not MemFree: caches are given up on request.
            memory_available: memory_bytes(&memory, "MemAvailable"),
            disk_free: free_bytes(Path::new(".")),
        }
    }
}

/// The first value of a `name : value` table.
fn table_value<'a>(table: &'a str, name: &str) -> Option<&'a str> {
    table
        .lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(n, _)| n.trim() == name)
        .map(|(_, value)| value.trim())
}

fn memory_bytes(table: &str, name: &str) -> Option<u64> {
    table_value(table, name)?.strip_suffix(" kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(target_arch = "x86_64")]
fn vector_instructions() -> Vec<&'static str> {
    let found = [
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("f16c", is_x86_feature_detected!("f16c")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ];
    found.into_iter().filter_map(|(name, has)| has.then_some(name)).collect()
}

#[cfg(not(target_arch = "x86_64"))]
fn vector_instructions() -> Vec<&'static str> {
    if cfg!(target_arch = "aarch64") { vec!["neon"] } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_the_system_are_read() {
        let cpu = "processor\t: 0\nmodel name\t: Example CPU @ 2.50GHz\nmodel name\t: other\n";
        assert_eq!(table_value(cpu, "model name"), Some("Example CPU @ 2.50GHz"));
        assert_eq!(table_value(cpu, "model"), None);
        let memory = "MemTotal:       24000000 kB\nMemFree: many kB\nHugePages_Total: 0\n";
        assert_eq!(memory_bytes(memory, "MemTotal"), Some(24_000_000 * 1024));
        assert_eq!(memory_bytes(memory, "MemFree"), None);
        assert_eq!(memory_bytes(memory, "HugePages_Total"), None);
    }

    #[test]
    fn a_machine_has_a_thread() {
        assert!(Machine::detect().threads.is_some_and(|n| n > 0));
    }
}
