//! Shows the decisions of registration and diagnosis on standard error, where `RUST_LOG` asks for them.

use std::fmt::{self, Write as _};

use tracing::{
    Event, Level, Metadata, Subscriber,
    field::{Field, Visit},
    span::{Attributes, Id, Record},
};

use super::terminal;

/// Variable that says what is shown, as for other programs: `debug`, or `articulate::parts=debug,gap=debug`.
const VARIABLE: &str = "RUST_LOG";

/// Starts the trace if the environment asks for one; else decisions cost nothing.
pub(super) fn start_trace() {
    let filters = std::env::var(VARIABLE).map(|text| filters(&text)).unwrap_or_default();
    if !filters.is_empty() {
        tracing::subscriber::set_global_default(Trace { filters }).ok();
    }
}

/// A module of the program (none: all), and the finest level shown of it.
struct Filter {
    target: String,
    level: Level,
}

/// Words that are no level, or that name a module without one, ask for debug; `off` for nothing.
fn filters(text: &str) -> Vec<Filter> {
    let words = text.split(',').map(str::trim).filter(|w| !w.is_empty());
    let mut filters = Vec::new();
    for word in words {
        let (target, level) = match word.split_once('=') {
            Some((target, level)) => (target, level.parse()),
            None if word.parse::<Level>().is_ok() => ("", word.parse()),
            None => (word, Ok(Level::DEBUG)),
        };
        if let Ok(level) = level
            && word != "off"
        {
            filters.push(Filter { target: target.to_owned(), level });
        }
    }
    filters
}

struct Trace {
    filters: Vec<Filter>,
}

impl Subscriber for Trace {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.filters.iter().any(|f| metadata.target().starts_with(&f.target) && *metadata.level() <= f.level)
    }

    fn event(&self, event: &Event<'_>) {
        let mut line = TraceLine::default();
        event.record(&mut line);
        let TraceLine { message, fields } = line;
        let metadata = event.metadata();
        terminal::print_line(&format!("{} {}: {message}{fields}", metadata.level(), metadata.target()));
    }

    // The program opens no spans.
    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

/// The parts of a line.
#[derive(Default)]
struct TraceLine {
    message: String,
    fields: String,
}

impl Visit for TraceLine {
    fn record_f64(&mut self, field: &Field, value: f64) {
        // Writing to a String cannot fail.
        _ = write!(self.fields, " {}={value:.4}", field.name());
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        _ = write!(self.fields, " {}={value}", field.name());
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        _ = match field.name() {
            "message" => write!(self.message, "{value:?}"),
            name => write!(self.fields, " {name}={value:.1?}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_and_levels_are_read_as_elsewhere() {
        let read = |text: &str| -> Vec<String> {
            filters(text).iter().map(|f| format!("{}={}", f.target, f.level)).collect()
        };
        assert_eq!(read("debug"), ["=DEBUG"]);
        assert_eq!(read("articulate::parts=debug, gap=info"), ["articulate::parts=DEBUG", "gap=INFO"]);
        assert_eq!(read("gap"), ["gap=DEBUG"]);
        assert!(read("").is_empty() && read("off").is_empty() && read("gap=loud").is_empty());
    }
}
