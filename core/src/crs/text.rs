//! Well-known text as a tree: `KEYWORD[item,item,..]`, items being quoted texts, bare words or
//! trees.

/// Most bytes of a text: the longest of the EPSG dataset has 6 kB.
const LONGEST: usize = 1 << 16;
/// Most levels of nested trees: standards need eight.
const DEEPEST: u32 = 24;

#[derive(Debug, PartialEq)]
pub(super) enum Item {
    /// In quotes.
    Text(String),
    /// A number or an enumerated word.
    Word(String),
    Node(Node),
}

#[derive(Debug, PartialEq)]
pub(super) struct Node {
    /// In capitals.
    pub(super) keyword: String,
    pub(super) items: Vec<Item>,
}

impl Node {
    /// Reads one tree; `None` if the text is not a tree, or continues after it.
    pub(super) fn parse(text: &str) -> Option<Self> {
        if text.len() > LONGEST {
            return None;
        }
        let mut parser = Parser { rest: text.trim_end().trim_end_matches('\0').trim_end() };
        let Item::Node(node) = parser.item(0)? else { return None };
        parser.rest.is_empty().then_some(node)
    }

    /// Trees inside.
    pub(super) fn nodes(&self) -> impl Iterator<Item = &Self> {
        self.items.iter().filter_map(|item| match item {
            Item::Node(node) => Some(node),
            _ => None,
        })
    }

    /// The first tree inside that has one of these keywords.
    pub(super) fn find(&self, keywords: &[&str]) -> Option<&Self> {
        self.nodes().find(|node| node.is(keywords))
    }

    pub(super) fn is(&self, keywords: &[&str]) -> bool {
        keywords.contains(&self.keyword.as_str())
    }

    /// The item at an index as text, quoted or not.
    pub(super) fn text(&self, index: usize) -> Option<&str> {
        match self.items.get(index)? {
            Item::Text(text) | Item::Word(text) => Some(text),
            Item::Node(_) => None,
        }
    }

    /// The item at an index as a finite number, whether in quotes or not.
    pub(super) fn number(&self, index: usize) -> Option<f64> {
        self.text(index)?.trim().parse().ok().filter(|value: &f64| value.is_finite())
    }

    /// Name, the first item.
    pub(super) fn name(&self) -> &str {
        self.text(0).unwrap_or_default()
    }
}

struct Parser<'a> {
    rest: &'a str,
}

impl Parser<'_> {
    fn item(&mut self, depth: u32) -> Option<Item> {
        self.rest = self.rest.trim_start();
        if self.rest.starts_with('"') {
            return self.quoted().map(Item::Text);
        }
        let end = self.rest.find(['[', '(', ']', ')', ',', '"']).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        let word = word.trim();
        if !rest.starts_with(['[', '(']) {
            self.rest = rest;
            return (!word.is_empty()).then(|| Item::Word(word.to_owned()));
        }
        if word.is_empty() || depth >= DEEPEST {
            return None;
        }
        self.rest = &rest[1..];
        let mut items = Vec::new();
        loop {
            items.push(self.item(depth + 1)?);
            self.rest = self.rest.trim_start();
            let mut characters = self.rest.chars();
            let next = characters.next()?;
            self.rest = characters.as_str();
            match next {
                ',' => {}
                ']' | ')' => break,
                _ => return None,
            }
        }
        Some(Item::Node(Node { keyword: word.to_ascii_uppercase(), items }))
    }

    /// Text up to the closing quote; two quotes stand for one.
    fn quoted(&mut self) -> Option<String> {
        let mut text = String::new();
        loop {
            let (part, rest) = self.rest[1..].split_once('"')?;
            text += part;
            self.rest = rest;
            if !rest.starts_with('"') {
                return Some(text);
            }
            text.push('"');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn trees_texts_and_words() {
        let node = Node::parse(" A [ \"say \"\"x\"\"\", b , C(1e3,\"2\"),3 ]\0\n").expect("tree");
        assert_eq!((node.keyword.as_str(), node.name()), ("A", "say \"x\""));
        assert_eq!(node.text(1), Some("b"));
        let inner = node.find(&["X", "C"]).expect("inner");
        assert_eq!((inner.number(0), inner.number(1), inner.number(2)), (Some(1000.0), Some(2.0), None));
        assert_eq!(node.number(3), Some(3.0));
    }

    #[test]
    fn what_is_no_tree() {
        let deep = "A[".repeat(5000) + "1" + &"]".repeat(5000);
        let long = format!("A[\"{}\"]", "x".repeat(LONGEST));
        for text in [
            "",
            "A",
            "\"A\"",
            "A[",
            "A[]",
            "A[1",
            "A[1]]",
            "A[1],B[2]",
            "[1]",
            "A[\"x]",
            "A[1 \"x\"]",
            &deep,
            &long,
        ] {
            assert_eq!(Node::parse(text), None, "{}", &text[..text.len().min(40)]);
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_not(text in "([A-C]|\\[|\\]|\\(|\\)|,|\"|[0-9]|é| ){0,60}") {
            let _ = Node::parse(&text);
        }
    }
}
