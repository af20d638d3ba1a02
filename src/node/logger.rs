//! Log on standard error in the format of ROS tools: `[LEVEL] [seconds] [name]: text`.

use std::{
    io::Write as _,
    sync::OnceLock,
    sync::atomic::{AtomicU32, Ordering},
    time::{SystemTime, UNIX_EPOCH},
};

use log::{Level, LevelFilter, Log, Metadata, Record};
use ros2_client::{Log as LogMessage, builtin_interfaces};
use tokio::sync::mpsc;

/// Target of this crate's log records.
const OWN: &str = env!("CARGO_CRATE_NAME");

fn is_own(metadata: &Metadata) -> bool {
    metadata.target().split("::").next() == Some(OWN)
}

/// The node's log: its name, the level of the start and the present one, as ROS 2 numbers them.
struct Logger {
    name: String,
    start: u32,
    level: AtomicU32,
}

/// The log of this process.
static LOGGER: OnceLock<Logger> = OnceLock::new();
/// Where the node's own lines go, too.
static COPIES: OnceLock<mpsc::Sender<LogMessage>> = OnceLock::new();

/// Copies the node's own lines to a queue from now on.
pub(crate) fn copy_lines(queue: mpsc::Sender<LogMessage>) {
    COPIES.set(queue).ok();
}

impl Logger {
    fn level(&self) -> LevelFilter {
        filter_of_number(self.level.load(Ordering::Relaxed))
    }
}

/// The lines that are shown from a level on, as ROS 2 numbers it.
fn filter_of_number(number: u32) -> LevelFilter {
    let filters = [
        (LogMessage::DEBUG, LevelFilter::Debug),
        (LogMessage::INFO, LevelFilter::Info),
        (LogMessage::WARN, LevelFilter::Warn),
    ];
    let shown = filters.into_iter().find(|(level, _)| number <= u32::from(*level));
    shown.map_or(LevelFilter::Error, |(_, filter)| filter)
}

/// The present level of a logger as ROS 2 numbers it; 0, as rclcpp answers where none was set, for others
/// than the node's.
#[must_use]
pub(crate) fn level_of_logger(name: &str) -> u32 {
    LOGGER.get().filter(|l| l.name == name).map_or(0, |l| l.level.load(Ordering::Relaxed))
}

/// Sets the level of the node's logger; 0 is the level of the start.
///
/// # Errors
/// The reason, if there is no such logger.
pub(crate) fn set_level(name: &str, number: u32) -> Result<(), String> {
    match LOGGER.get() {
        Some(logger) if logger.name == name => {
            let number = if number == 0 { logger.start } else { number };
            logger.level.store(number, Ordering::Relaxed);
            log::set_max_level(filter_of_number(number));
            Ok(())
        }
        Some(logger) => Err(format!("there is no logger `{}`; it is `{}`", name.escape_debug(), logger.name)),
        None => Err("there is no log".to_owned()),
    }
}

impl Log for Logger {
    fn enabled(&self, metadata: &Metadata) -> bool {
        // The middleware warns if there is only one network; only its errors are shown.
        metadata.level() <= if is_own(metadata) { self.level() } else { LevelFilter::Error }
    }

    fn log(&self, record: &Record) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = if is_own(record.metadata()) { self.name.as_str() } else { record.target() };
        let (level, number) = match record.level() {
            Level::Error => ("ERROR", LogMessage::ERROR),
            Level::Warn => ("WARN", LogMessage::WARN),
            Level::Info => ("INFO", LogMessage::INFO),
            Level::Debug | Level::Trace => ("DEBUG", LogMessage::DEBUG),
        };
        // Names may come from the network, and terminals execute control characters.
        let text: String =
            record.args().to_string().chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let seconds = format!("{}.{:06}", now.as_secs(), now.subsec_micros());
        writeln!(std::io::stderr(), "[{level}] [{seconds}] [{name}]: {text}").ok();
        // Not the middleware's lines: publishing may make them.
        if let Some(queue) = COPIES.get().filter(|_| is_own(record.metadata())) {
            let line = LogMessage {
                stamp: builtin_interfaces::Time::from_nanos(i64::try_from(now.as_nanos()).unwrap_or(0)),
                level: number,
                name: name.to_owned(),
                msg: text,
                file: record.file().unwrap_or_default().to_owned(),
                function: String::new(),
                line: record.line().unwrap_or_default(),
            };
            queue.try_send(line).ok();
        }
    }

    fn flush(&self) {}
}

/// Starts the log of a node; `level` is `debug`, `info`, `warn`, `error` or `fatal`, and `silent` shows only
/// errors.
pub(crate) fn start_log(name: &str, level: Option<&str>, silent: bool) {
    let number = u32::from(match level {
        _ if silent => LogMessage::ERROR,
        Some("debug") => LogMessage::DEBUG,
        Some("warn") => LogMessage::WARN,
        Some("error") => LogMessage::ERROR,
        Some("fatal") => LogMessage::FATAL,
        _ => LogMessage::INFO,
    });
    let logger = LOGGER.get_or_init(|| Logger { name: name.to_owned(), start: number, level: number.into() });
    if log::set_logger(logger).is_ok() {
        log::set_max_level(filter_of_number(number));
    }
}
