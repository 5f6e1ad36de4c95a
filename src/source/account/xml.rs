//! XML that GDAL writes beside and into rasters, read as leniently as GDAL reads it.
//!
//! Names of elements and attributes match in any case. The text of an element counts only if the
//! element has nothing else, not even a comment. A document with a bare `&`, or with text behind
//! its end, is read all the same.

use roxmltree::Node;

use crate::source::markup;

/// Reads a document whose root has this name: `None` for another root, `Err` with the reason if the
/// text is not XML.
pub(super) fn read<T>(text: &str, root: &str, read: impl Fn(Node<'_, '_>) -> T) -> Result<Option<T>, String> {
    let text = text.trim_start_matches('\u{feff}').trim();
    let found = |text: &str| {
        let document = markup::parse(text).map_err(|error| error.to_string())?;
        let top = document.root_element();
        Ok(is(top, root).then(|| read(top)))
    };
    found(text).or_else(|reason| found(&mended(text, root)).map_err(|_: String| reason))
}

/// The text with every bare `&` escaped, and without what follows the end of the root.
fn mended(text: &str, root: &str) -> String {
    let close = format!("</{root}>");
    let text = text.rfind(&close).map_or(text, |at| &text[..at + close.len()]);
    let mut parts = text.split('&');
    let mut mended = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let is_reference = part.split_once(';').is_some_and(|(name, _)| {
            !name.is_empty()
                && name.len() < 10
                && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'#')
        });
        mended.push_str(if is_reference { "&" } else { "&amp;" });
        mended.push_str(part);
    }
    mended
}

/// True if an element has this name.
pub(super) fn is(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name().eq_ignore_ascii_case(name)
}

/// The children with this name.
pub(super) fn children<'a, 'i>(node: Node<'a, 'i>, name: &str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| is(*child, name))
}

/// The first child with this name.
pub(super) fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

/// The value of an attribute.
pub(super) fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.attributes().find(|one| one.name().eq_ignore_ascii_case(name)).map(|one| one.value())
}

/// The text of an element; `None` if it is empty or the element has other content.
pub(super) fn text<'a>(node: Node<'a, '_>) -> Option<&'a str> {
    let mut inside = node.children();
    match (inside.next(), inside.next()) {
        (Some(only), None) if only.is_text() => only.text(),
        _ => None,
    }
}

/// The text of the first child with this name.
pub(super) fn text_of<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    child(node, name).and_then(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(xml: &str) -> Result<Option<String>, String> {
        read(xml, "Root", |root| text_of(root, "v").map(str::to_owned)).map(Option::flatten)
    }

    #[test]
    fn what_gdal_reads() {
        let some = |text: &str| Ok(Some(text.to_owned()));
        assert_eq!(value("<Root><v>1</v></Root>"), some("1"));
        assert_eq!(value("\u{feff}<?xml version=\"1.0\"?><!-- c --><Root><v>1</v></Root>\n"), some("1"));
        assert_eq!(value("<rOOT xmlns=\"u:x\"><V>1</V></rOOT>"), some("1"));
        assert_eq!(value("<Root><v><![CDATA[1]]></v></Root>"), some("1"));
        assert_eq!(value("<Root><v>&#49;</v></Root>"), some("1"));
        assert_eq!(value("<Root><v>1</v><d>a & b &amp; c&</d></Root>"), some("1"));
        assert_eq!(value("<Root><v>1</v></Root>and more"), some("1"));
        for nothing in
            ["<Root/>", "<Root><v/></Root>", "<Root><v>1<!-- c --></v></Root>", "<Other><v>1</v></Other>"]
        {
            assert_eq!(value(nothing), Ok(None), "{nothing}");
        }
        for broken in
            ["", "<Root>", "<Root><v>1</v>", "words", "<Root><v>1</w></Root>", "<!DOCTYPE Root><Root/>"]
        {
            assert!(value(broken).is_err(), "{broken}");
        }
    }
}
