//! Checks XML texts before a recursive reader gets them.

use std::borrow::Cow;

use roxmltree::Document;

use super::{XML_DEPTH, XML_ELEMENTS};

/// Why an XML text is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum XmlError {
    /// It declares entities.
    #[error("line {line}: it declares entities, which are not read; write out what they stand for")]
    Entities {
        /// Line number, from 1.
        line: usize,
    },
    /// Elements are nested too deep.
    #[error("line {line}: elements are nested deeper than {XML_DEPTH}; no model needs that")]
    Deep {
        /// Line number, from 1.
        line: usize,
    },
    /// There are too many elements.
    #[error("it has more than {XML_ELEMENTS} elements; split the model")]
    Large,
    /// It is not XML.
    #[error("it is no XML: {0}")]
    Parse(#[from] roxmltree::Error),
}

/// The text with a valid XML declaration: `<?xml ...?>` without a version, or behind a byte order mark or
/// empty lines, is not XML, but simulators ignore the declaration and load such files.
pub fn with_declaration(text: &str) -> Cow<'_, str> {
    let trimmed = text.trim_start_matches(|c: char| c == '\u{feff}' || c.is_whitespace());
    let text = if trimmed.starts_with("<?xml") { trimmed } else { text };
    let after = text.strip_prefix("<?xml ").and_then(|rest| rest.split_once("?>"));
    match after.filter(|(declared, _)| !declared.trim_start().starts_with("version")) {
        Some((_, rest)) => Cow::Owned(format!("<?xml version=\"1.0\"?>{rest}")),
        None => Cow::Borrowed(text),
    }
}

/// Parses a text after `check_xml`.
///
/// # Errors
/// [`XmlError`].
pub fn parse_xml(text: &str) -> Result<Document<'_>, XmlError> {
    check_xml(text)?;
    Ok(Document::parse(text)?)
}

/// Refuses elements nested deeper than [`XML_DEPTH`], more than [`XML_ELEMENTS`] of them, and declared
/// entities. Text that is not XML may pass: the reader refuses it.
///
/// # Errors
/// [`XmlError`], except [`XmlError::Parse`].
fn check_xml(text: &str) -> Result<(), XmlError> {
    // Scans only the tags: this needs no stack and stops at the first one too many.
    let mut at = 0;
    let mut depth = 0usize;
    let mut elements = 0;
    while let Some(start) = text[at..].find('<').map(|k| at + k) {
        let rest = &text[start..];
        let line = || text[..start].matches('\n').count() + 1;
        let length = if rest.starts_with("<!--") {
            rest.find("-->")
        } else if rest.starts_with("<![CDATA[") {
            rest.find("]]>")
        } else if rest.starts_with("<!ENTITY") {
            // Nested entities expand a kilobyte of text to gigabytes; no model needs one.
            return Err(XmlError::Entities { line: line() });
        } else if rest.starts_with("<!") {
            // A declaration may contain others.
            Some(1)
        } else if rest.starts_with("</") {
            // The parser refuses an end tag without a start tag.
            depth = depth.saturating_sub(1);
            rest.find('>')
        } else if rest.starts_with("<?") {
            rest.find("?>")
        } else {
            elements += 1;
            let end = tag_end(rest);
            depth += usize::from(end.is_some_and(|e| !rest[..e].ends_with('/')));
            end
        };
        if depth > XML_DEPTH {
            return Err(XmlError::Deep { line: line() });
        }
        if elements > XML_ELEMENTS {
            return Err(XmlError::Large);
        }
        let Some(length) = length else { break };
        at = start + length + 1;
    }
    Ok(())
}

/// Index of the `>` that ends a tag; those in quotes do not count.
fn tag_end(tag: &str) -> Option<usize> {
    let mut quote = None;
    for (at, byte) in tag.bytes().enumerate() {
        match (quote, byte) {
            (None, b'"' | b'\'') => quote = Some(byte),
            (None, b'>') => return Some(at),
            (Some(open), _) if open == byte => quote = None,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinary_texts_pass() {
        let text = "<?xml version='1.0'?><!DOCTYPE a><!-- <b><b> --><a x='<' \
            y=\"/>\"><b/><![CDATA[<c>]]><b c='>'></b></a>";
        assert_eq!(check_xml(text), Ok(()));
        assert_eq!(parse_xml("<a><b/></a>").unwrap().root_element().children().count(), 1);
        // Siblings are no depth.
        assert_eq!(check_xml(&format!("<a>{}</a>", "<b x='1'></b><c/>".repeat(10_000))), Ok(()));
        let deep = |n: usize| format!("{}{}", "<x>".repeat(n), "</x>".repeat(n));
        assert!(parse_xml(&deep(XML_DEPTH)).is_ok());
    }

    #[test]
    fn a_declaration_without_a_version_is_mended() {
        assert_eq!(with_declaration("\u{feff}\n<?xml version=\"1.0\"?><a/>"), "<?xml version=\"1.0\"?><a/>");
        let mended = with_declaration("<?xml verison=\"1.0\"?>\n<a/>");
        assert_eq!(mended, "<?xml version=\"1.0\"?>\n<a/>");
        assert!(parse_xml(&mended).is_ok() && parse_xml("<?xml verison=\"1.0\"?>\n<a/>").is_err());
        for whole in
            ["<a/>", "<?xml version='1.0' encoding='UTF-8'?><a/>", "<?xml no end", "<?xml-model x?><a/>"]
        {
            assert!(matches!(with_declaration(whole), Cow::Borrowed(w) if w == whole));
        }
    }

    #[test]
    fn deep_texts_are_refused_however_they_are_dressed() {
        for n in [XML_DEPTH + 1, 20_000, 100_000] {
            for open in [
                "<x>",
                "<x a='/'>",
                "<x a=\"'/>\">",
                "<x\n>",
                "<!-- </x> --><x>",
                "<x><![CDATA[</x>]]>",
                "<x a='</x>'>",
            ] {
                let error = parse_xml(&format!("{}{}", open.repeat(n), "</x>".repeat(n))).unwrap_err();
                assert!(matches!(error, XmlError::Deep { .. }), "{error}");
            }
        }
        assert!(check_xml("<x>\n<y>\n").is_ok());
        assert!(check_xml(&"<x>\n".repeat(200)) == Err(XmlError::Deep { line: 129 }));
    }

    #[test]
    fn many_elements_and_entities_are_refused() {
        assert!(check_xml(&"<x/>".repeat(XML_ELEMENTS + 1)) == Err(XmlError::Large));
        let laughs = "<!DOCTYPE r [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><r>&b;</r>";
        assert!(check_xml(laughs) == Err(XmlError::Entities { line: 1 }));
    }
}
