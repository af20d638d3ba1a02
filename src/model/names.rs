//! Names and text in files: names that are plain in every format, and how to write others in each syntax.

use std::borrow::Cow;

/// Whether a name is safe in every format, as a file name and as a ROS name: `[A-Za-z][A-Za-z0-9_]*`, at most
/// 64 characters.
pub fn is_plain_name(name: &str) -> bool {
    name.len() <= 64 && name.starts_with(|c: char| c.is_ascii_alphabetic()) && name.chars().all(is_word)
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// Escapes text for an attribute or an element of XML or HTML, in either kind of quotes; a reader gets the
/// same text back.
///
/// Characters that XML cannot hold (most control characters) become U+FFFD: the file stays readable, and
/// readers of names refuse them.
pub fn escape_xml(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            // In an attribute a reader turns these into a space, and a carriage return into a line feed
            // anywhere.
            '\t' => escaped.push_str("&#9;"),
            '\n' => escaped.push_str("&#10;"),
            '\r' => escaped.push_str("&#13;"),
            c => escaped.push(if is_xml_char(c) { c } else { char::REPLACEMENT_CHARACTER }),
        }
    }
    escaped
}

/// [`escape_xml`] of every line of a text; line breaks stay, as in a `<pre>`.
pub fn escape_lines(text: &str) -> String {
    text.split('\n').map(escape_xml).collect::<Vec<_>>().join("\n")
}

/// Whether XML can hold a text: it cannot hold most control characters.
pub fn is_xml_text(text: &str) -> bool {
    text.chars().all(is_xml_char)
}

fn is_xml_char(c: char) -> bool {
    matches!(c, '\t' | '\n' | '\r') || (c >= ' ' && !matches!(c, '\u{fffe}' | '\u{ffff}'))
}

/// JSON for a `<script>` of a page: nothing in it can end the script, and its meaning stays.
pub fn script_json(json: &str) -> String {
    // In JSON a `<` occurs only within strings, where the escape means the same.
    json.replace('<', "\\u003c")
}

/// A name for formats that take only identifiers and cannot write others (USD, OBJ, CMake, file names). A
/// plain name stays; in others every character but a letter, digit or `_` becomes its number between two `_`.
pub fn identifier(name: &str) -> Cow<'_, str> {
    if !name.is_empty() && name.chars().all(is_word) && !name.starts_with(|c: char| c.is_ascii_digit()) {
        return Cow::Borrowed(name);
    }
    let word = |c: char| if is_word(c) { c.to_string() } else { format!("_{:x}_", u32::from(c)) };
    // The leading `_` also allows for names that start with a digit.
    Cow::Owned(format!("_{}", name.chars().map(word).collect::<String>()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_text_that_xml_can_hold_is_read_back(text in any::<String>()) {
            let file = format!("<a name=\"{0}\" other='{0}'>{0}</a>", escape_xml(&text));
            let document = roxmltree::Document::parse(&file).unwrap();
            let root = document.root_element();
            let kept = |c: char| if is_xml_text(&c.to_string()) { c } else { char::REPLACEMENT_CHARACTER };
            let expected: String = text.chars().map(kept).collect();
            prop_assert_eq!(root.attribute("name"), Some(expected.as_str()));
            prop_assert_eq!(root.attribute("other"), Some(expected.as_str()));
            prop_assert_eq!(root.text().unwrap_or_default(), expected);
        }

        #[test]
        fn an_identifier_is_one_and_a_plain_name_its_own(
            name in any::<String>(),
            plain in "[A-Za-z][A-Za-z0-9_]{0,63}",
        ) {
            let id = identifier(&name);
            let begins = !id.is_empty() && !id.starts_with(|c: char| c.is_ascii_digit());
            prop_assert!(begins && id.chars().all(is_word), "{}", id);
            prop_assert!(is_plain_name(&plain) && identifier(&plain) == plain);
        }

        #[test]
        fn json_in_a_script_ends_nothing_and_means_the_same(text in any::<String>()) {
            let json = script_json(&serde_json::to_string(&text).unwrap());
            prop_assert!(!json.contains('<'));
            prop_assert_eq!(serde_json::from_str::<String>(&json).unwrap(), text);
        }
    }

    #[test]
    fn markup_and_breaks_are_written_by_their_names() {
        assert_eq!(escape_xml("a<b>&\"c\"'\t\n\r"), "a&lt;b&gt;&amp;&quot;c&quot;&#39;&#9;&#10;&#13;");
        assert_eq!(escape_lines("a\n<b\n"), "a\n&lt;b\n");
        assert_eq!(escape_xml("\0\u{1b}\u{ffff}"), "\u{fffd}\u{fffd}\u{fffd}");
        assert_eq!(identifier("a b/../\u{e9}"), "_a_20_b_2f__2e__2e__2f__e9_");
        assert_eq!((identifier(""), identifier("2nd")), ("_".into(), "_2nd".into()));
    }
}
