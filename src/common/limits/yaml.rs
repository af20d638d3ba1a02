//! Checks YAML texts before they are read.
//!
//! The reader scans nested lists in time quadratic in the depth before it refuses the depth: 200 kB of
//! brackets take minutes (measured). Its scanner alone, stopped in time, finds the depth in linear time and
//! agrees with the reader about brackets.

use std::mem::MaybeUninit;

use serde::de::DeserializeOwned;
use unsafe_libyaml_norway as unsafe_sys;

use super::{YAML_DEPTH, YAML_EVENTS};

/// Why a YAML text is refused.
#[derive(Debug, thiserror::Error)]
pub enum YamlError {
    /// Lists are nested too deep.
    #[error(
        "line {line}: lists and groups are nested deeper than {YAML_DEPTH}; no file of this kind needs that"
    )]
    Deep {
        /// Line number, from 1.
        line: u64,
    },
    /// There are too many values.
    #[error("it has more than {YAML_EVENTS} values; split it")]
    Large,
    /// It is not YAML, or does not have the expected form.
    #[error(transparent)]
    Parse(#[from] serde_norway::Error),
}

/// Reads a YAML text.
///
/// # Errors
/// [`YamlError`].
pub fn parse_yaml<T: DeserializeOwned>(text: &str) -> Result<T, YamlError> {
    check_yaml(text)?;
    Ok(serde_norway::from_str(text)?)
}

fn check_yaml(text: &str) -> Result<(), YamlError> {
    let mut scanner = Scanner::new(text);
    let mut depth = 0usize;
    for _ in 0..YAML_EVENTS {
        // The reader explains better why a text is not YAML.
        let Some((kind, line)) = scanner.next() else { return Ok(()) };
        match kind {
            unsafe_sys::YAML_STREAM_END_EVENT => return Ok(()),
            unsafe_sys::YAML_SEQUENCE_START_EVENT | unsafe_sys::YAML_MAPPING_START_EVENT => depth += 1,
            unsafe_sys::YAML_SEQUENCE_END_EVENT | unsafe_sys::YAML_MAPPING_END_EVENT => {
                depth = depth.saturating_sub(1)
            }
            _ => {}
        }
        if depth > YAML_DEPTH {
            return Err(YamlError::Deep { line });
        }
    }
    Err(YamlError::Large)
}

/// libyaml's scanner for a text.
struct Scanner<'a> {
    /// Boxed, as it points into itself and must not move.
    parser: Box<MaybeUninit<unsafe_sys::yaml_parser_t>>,
    _text: &'a str,
}

impl<'a> Scanner<'a> {
    fn new(text: &'a str) -> Self {
        // Boxed before it is initialized, as it must not move afterwards.
        let mut parser = Box::new(MaybeUninit::<unsafe_sys::yaml_parser_t>::uninit());
        // SAFETY: `initialize` writes the whole parser (it can fail only by ending the process for want of
        // memory); the text is borrowed as long as the parser lives.
        unsafe {
            let parser = parser.as_mut_ptr();
            _ = unsafe_sys::yaml_parser_initialize(parser).ok;
            unsafe_sys::yaml_parser_set_encoding(parser, unsafe_sys::YAML_UTF8_ENCODING);
            unsafe_sys::yaml_parser_set_input_string(parser, text.as_ptr(), text.len() as u64);
        }
        Self { parser, _text: text }
    }

    /// Kind and line of the next event; `None` if the text is not YAML. Must not be called after `None`.
    fn next(&mut self) -> Option<(unsafe_sys::yaml_event_type_t, u64)> {
        let mut event = MaybeUninit::<unsafe_sys::yaml_event_t>::uninit();
        // SAFETY: the parser was initialized; a successful call writes the event, which is freed once.
        unsafe {
            let event = event.as_mut_ptr();
            if unsafe_sys::yaml_parser_parse(self.parser.as_mut_ptr(), event).fail {
                return None;
            }
            let type_and_line = ((*event).type_, (*event).start_mark.line + 1);
            unsafe_sys::yaml_event_delete(event);
            Some(type_and_line)
        }
    }
}

impl Drop for Scanner<'_> {
    fn drop(&mut self) {
        // SAFETY: the parser was initialized, and nothing uses it afterwards.
        unsafe { unsafe_sys::yaml_parser_delete(self.parser.as_mut_ptr()) }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use serde_norway::Value;

    use super::*;

    #[test]
    fn ordinary_texts_are_read() {
        let text = "a: [1, {b: '[[['}] # ]]]\nc: |\n  [[[[\nd: \"]]\"\n";
        let value: Value = parse_yaml(text).unwrap();
        assert_eq!(value["a"][1]["b"], Value::from("[[["));
        assert_eq!(parse_yaml::<Value>("").unwrap(), Value::Null);
        assert!(parse_yaml::<Value>(&format!("{}{}", "[".repeat(120), "]".repeat(120))).is_ok());
        assert!(parse_yaml::<Value>(&"[1]\n".repeat(3)).is_err());
        assert!(parse_yaml::<Value>("a: [").unwrap_err().to_string().contains("line"));
    }

    #[test]
    fn depth_costs_no_time() {
        let begun = Instant::now();
        let n = 200_000;
        let texts = [
            format!("x: {}{}", "[".repeat(n), "]".repeat(n)),
            "[".repeat(n),
            format!("x: {}1{}", "{a: ".repeat(n), "}".repeat(n)),
            "[\"]\",".repeat(n),
            "[ # ]\n".repeat(n),
            "- ".repeat(n),
            "? ".repeat(n),
        ];
        for text in texts {
            let error = parse_yaml::<Value>(&text).unwrap_err();
            assert!(matches!(error, YamlError::Deep { .. }), "{error}");
        }
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    }

    #[test]
    fn aliases_and_many_values_are_refused() {
        let nine = |of: &str| [of; 9].join(",");
        let mut bomb = format!("a0: &a0 [{}]\n", nine("x"));
        (1..12).for_each(|i| bomb += &format!("a{i}: &a{i} [{}]\n", nine(&format!("*a{}", i - 1))));
        assert!(parse_yaml::<Value>(&bomb).unwrap_err().to_string().contains("repetition limit"));
        let many = parse_yaml::<Value>(&format!("[{}]", "1,".repeat(YAML_EVENTS))).unwrap_err();
        assert!(matches!(many, YamlError::Large), "{many}");
    }
}
