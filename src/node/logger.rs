//! Log on standard error in the format of ROS tools: `[LEVEL] [seconds] [name]: text`.

use std::{
    io::Write as _,
    time::{SystemTime, UNIX_EPOCH},
};

use log::{Level, LevelFilter, Log, Metadata, Record};

/// Target of this crate's log records.
const OWN: &str = env!("CARGO_CRATE_NAME");

fn is_own(metadata: &Metadata) -> bool {
    metadata.target().split("::").next() == Some(OWN)
}

struct Logger {
    name: String,
    level: LevelFilter,
}

impl Log for Logger {
    fn enabled(&self, metadata: &Metadata) -> bool {
        // The middleware warns if there is only one network; only its errors are shown.
        metadata.level()
            <= if is_own(metadata) || self.level >= LevelFilter::Trace {
                self.level
            } else {
                self.level.min(LevelFilter::Error)
            }
    }

    fn log(&self, record: &Record) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        let name = if is_own(record.metadata()) { self.name.as_str() } else { record.target() };
        let level = match record.level() {
            Level::Error => "ERROR",
            Level::Warn => "WARN",
            Level::Info => "INFO",
            Level::Debug | Level::Trace => "DEBUG",
        };
        // Names may come from the network, and terminals execute control characters.
        let text: String =
            record.args().to_string().chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        writeln!(std::io::stderr(), "[{level}] [{seconds:.6}] [{name}]: {text}").ok();
    }

    fn flush(&self) {}
}

/// Starts the log of a node; `level` is `debug`, `info`, `warn`, `error` or `fatal`, and `silent` shows only
/// errors.
pub(crate) fn start_log(name: &str, level: Option<&str>, silent: bool) {
    let level = match level {
        _ if silent => LevelFilter::Error,
        Some("debug") => LevelFilter::Debug,
        Some("warn") => LevelFilter::Warn,
        Some("error" | "fatal") => LevelFilter::Error,
        _ => LevelFilter::Info,
    };
    if log::set_boxed_logger(Box::new(Logger { name: name.to_owned(), level })).is_ok() {
        log::set_max_level(level);
    }
}
