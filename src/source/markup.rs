//! Parses XML from files, within bounds that keep the parser fast.
//!
//! The parser compares every attribute of an element with those before it, and every namespace with
//! all others, so a few megabytes of them would take hours. GDAL's XML has only a few of either.

use roxmltree::{Document, ParsingOptions};

use crate::error::{Error, Result};

/// Most attributes of one element.
const ATTRIBUTES: u64 = 256;
/// Most namespaces of a document.
const NAMESPACES: u64 = 64;

/// Parses a document. The caller bounds its length.
pub(super) fn parse(text: &str) -> Result<Document<'_>> {
    check(text)?;
    // Each node takes at least a byte.
    let nodes_limit = u32::try_from(text.len()).unwrap_or(u32::MAX).max(1);
    let options = ParsingOptions { nodes_limit, ..ParsingOptions::default() };
    let damaged = |error| Error::format("XML", "a well-formed document", error);
    Document::parse_with_options(text, options).map_err(damaged)
}

/// Refuses a document with too many attributes in an element, or too many namespaces. Text that is
/// not XML is left to the parser, which stops at the same place.
fn check(text: &str) -> Result<()> {
    let namespaces = text.matches("xmlns").count() as u64;
    if namespaces > NAMESPACES {
        return Err(Error::limit("the number of XML namespaces", namespaces, NAMESPACES));
    }
    let mut rest = text;
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let closed = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        rest = match closed.into_iter().find(|(open, _)| rest.starts_with(open)) {
            Some((open, close)) => rest[open.len()..].split_once(close).map_or("", |(_, behind)| behind),
            None => &rest[tag(rest)?..],
        };
    }
    Ok(())
}

/// Length of the tag at the start of a text.
fn tag(text: &str) -> Result<usize> {
    let (mut quote, mut attributes) = (None, 0);
    for (at, byte) in text.bytes().enumerate() {
        match (byte, quote) {
            (b'"' | b'\'', None) => quote = Some(byte),
            (byte, Some(open)) if byte == open => quote = None,
            (b'=', None) => attributes += 1,
            (b'>', None) => return Ok(at + 1),
            _ => {}
        }
        if attributes > ATTRIBUTES {
            return Err(Error::limit("the number of attributes of an XML element", attributes, ATTRIBUTES));
        }
    }
    Ok(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_attributes_or_namespaces_are_refused_and_all_else_is_parsed() {
        let attributes =
            |count: usize| (0..count).map(|n| format!(" a{n}='>\"'")).collect::<Vec<_>>().concat();
        let element = |count| {
            format!(
                "<?x it's ?><!-- ' <a{} --><a{}><![CDATA[<b '=]]></a>",
                "=".repeat(999),
                attributes(count)
            )
        };
        assert!(parse(&element(256)).is_ok());
        assert!(matches!(parse(&element(257)), Err(Error::Limit { .. })));
        let spaces =
            |count: usize| (0..count).map(|n| format!("<a xmlns:n{n}='u{n}'/>")).collect::<Vec<_>>().concat();
        assert!(parse(&format!("<a>{}</a>", spaces(64))).is_ok());
        assert!(matches!(parse(&format!("<a>{}</a>", spaces(65))), Err(Error::Limit { .. })));
        // The parser refuses a document that is cut off; what stands before the cut is counted.
        assert!(matches!(parse("<a b='"), Err(Error::Format { .. })));
        assert!(matches!(parse(&format!("<a{} c='", attributes(300))), Err(Error::Limit { .. })));
        for text in ["", "<", "<!--", "<![CDATA[", "a<b", "<a>\u{FEFF}</a><"] {
            assert!(matches!(parse(text), Err(Error::Format { .. })), "{text}");
        }
    }
}
