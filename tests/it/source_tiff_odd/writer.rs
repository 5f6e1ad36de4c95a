//! A writer of TIFFs, byte by byte, that shares nothing with the library: any tag of any type may
//! be there, lie, or not.

use std::collections::HashMap;

/// Types of values.
pub mod kind {
    pub const BYTE: u16 = 1;
    pub const ASCII: u16 = 2;
    pub const SHORT: u16 = 3;
    pub const LONG: u16 = 4;
    pub const RATIONAL: u16 = 5;
    pub const SBYTE: u16 = 6;
    pub const SSHORT: u16 = 8;
    pub const SLONG: u16 = 9;
    pub const SRATIONAL: u16 = 10;
    pub const FLOAT: u16 = 11;
    pub const DOUBLE: u16 = 12;
    pub const LONG8: u16 = 16;
    pub const SLONG8: u16 = 17;
}

/// Byte order, and whether it is a BigTIFF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    pub little: bool,
    pub big: bool,
}

pub const FORMS: [Form; 4] = [
    Form { little: true, big: false },
    Form { little: false, big: false },
    Form { little: true, big: true },
    Form { little: false, big: true },
];

/// A tag with its values.
#[derive(Clone, Debug)]
pub struct Entry {
    pub tag: u16,
    pub kind: u16,
    pub values: Vec<f64>,
    pub text: &'static str,
}

pub fn entry(tag: u16, kind: u16, values: &[f64]) -> Entry {
    Entry { tag, kind, values: values.to_vec(), text: "" }
}

pub fn text(tag: u16, text: &'static str) -> Entry {
    Entry { tag, kind: kind::ASCII, values: Vec::new(), text }
}

/// What stands where the offset of the next directory does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    None,
    /// The directory itself.
    Itself,
    /// Behind the end of the file.
    Outside,
    /// Among the samples: what it says there is no directory.
    Samples,
    /// The file ends before it.
    CutOff,
}

pub const LINKS: [Link; 5] = [Link::None, Link::Itself, Link::Outside, Link::Samples, Link::CutOff];

impl Form {
    /// A whole number.
    pub fn int(self, value: i64, bytes: usize) -> Vec<u8> {
        if self.little {
            value.to_le_bytes()[..bytes].to_vec()
        } else {
            value.to_be_bytes()[8 - bytes..].to_vec()
        }
    }

    fn turned(self, mut big_end: Vec<u8>) -> Vec<u8> {
        if self.little {
            big_end.reverse();
        }
        big_end
    }

    fn value(self, kind: u16, value: f64) -> Vec<u8> {
        match kind {
            kind::BYTE | kind::SBYTE => self.int(value as i64, 1),
            kind::SHORT | kind::SSHORT => self.int(value as i64, 2),
            kind::LONG | kind::SLONG => self.int(value as i64, 4),
            kind::LONG8 | kind::SLONG8 => self.int(value as i64, 8),
            kind::FLOAT => self.turned((value as f32).to_be_bytes().to_vec()),
            kind::DOUBLE => self.turned(value.to_be_bytes().to_vec()),
            kind::RATIONAL | kind::SRATIONAL => [self.int((value * 4.0) as i64, 4), self.int(4, 4)].concat(),
            other => panic!("type {other}"),
        }
    }

    fn word(self) -> usize {
        if self.big { 8 } else { 4 }
    }

    /// A file with these blocks, beginning at offset 64, a gap after each, and one directory behind
    /// them, whose entries stand as they are given. `entries` is told the offsets of the blocks.
    pub fn file(self, blocks: &[Vec<u8>], link: Link, entries: impl FnOnce(&[f64]) -> Vec<Entry>) -> Vec<u8> {
        let mut file = if self.little { b"II".to_vec() } else { b"MM".to_vec() };
        file.extend(self.int(if self.big { 43 } else { 42 }, 2));
        if self.big {
            file.extend(self.int(8, 2));
            file.extend(self.int(0, 2));
        }
        let pointer = file.len();
        file.resize(64, 0xFF);
        let mut offsets = Vec::new();
        for block in blocks {
            offsets.push(file.len() as f64);
            file.extend(block);
            file.extend([0xFF; 7]);
        }
        let entries = entries(&offsets);
        let mut directory = self.int(entries.len() as i64, if self.big { 8 } else { 2 });
        for entry in entries {
            let (count, mut bytes) = if entry.kind == kind::ASCII {
                let bytes = [entry.text.as_bytes(), &[0]].concat();
                (bytes.len(), bytes)
            } else {
                let bytes = entry.values.iter().flat_map(|&value| self.value(entry.kind, value)).collect();
                (entry.values.len(), bytes)
            };
            directory.extend(self.int(entry.tag.into(), 2));
            directory.extend(self.int(entry.kind.into(), 2));
            directory.extend(self.int(count as i64, self.word()));
            if bytes.len() > self.word() {
                let at = file.len() as i64;
                file.extend(&bytes);
                bytes = self.int(at, self.word());
            }
            bytes.resize(self.word(), 0);
            directory.extend(bytes);
        }
        let at = file.len() as i64;
        file.splice(pointer..pointer + self.word(), self.int(at, self.word()));
        file.extend(directory);
        let next = match link {
            Link::None | Link::CutOff => 0,
            Link::Itself => at,
            Link::Outside => 0x7000_0000,
            Link::Samples => 64,
        };
        file.extend(self.int(next, self.word()));
        if link == Link::CutOff {
            file.truncate(file.len() - 3);
        }
        file
    }
}

/// Codes of LZW: as they are now (from the highest bit down, longer one code early), or as before
/// 1988 (from the lowest bit up, longer when it must be).
pub fn lzw(bytes: &[u8], old: bool) -> Vec<u8> {
    const CLEAR: u32 = 256;
    const END: u32 = 257;
    let (mut bits, mut table, mut width, mut next) = (Vec::new(), HashMap::new(), 9, 258);
    let push = |bits: &mut Vec<bool>, code: u32, width: u32| {
        let bit = |at: u32| code >> at & 1 == 1;
        bits.extend((0..width).map(|at| bit(if old { at } else { width - 1 - at })));
    };
    push(&mut bits, CLEAR, width);
    let mut word: Vec<u8> = Vec::new();
    let code_of = |table: &HashMap<Vec<u8>, u32>, word: &[u8]| match *word {
        [byte] => u32::from(byte),
        _ => table[word],
    };
    for &byte in bytes {
        let longer = [&word[..], &[byte]].concat();
        if longer.len() == 1 || table.contains_key(&longer) {
            word = longer;
            continue;
        }
        push(&mut bits, code_of(&table, &word), width);
        table.insert(longer, next);
        next += 1;
        // The reader is one entry behind.
        let full = if old { next > 1 << width } else { next + 1 > 1 << width };
        if full && width < 12 {
            width += 1;
        }
        if next == 4094 {
            push(&mut bits, CLEAR, width);
            table.clear();
            (width, next) = (9, 258);
        }
        word = vec![byte];
    }
    if !word.is_empty() {
        push(&mut bits, code_of(&table, &word), width);
        next += 1;
        let full = if old { next > 1 << width } else { next + 1 > 1 << width };
        if full && width < 12 {
            width += 1;
        }
    }
    push(&mut bits, END, width);
    let byte = |bits: &[bool]| {
        let place = |at: usize| if old { at } else { 7 - at };
        bits.iter().enumerate().map(|(at, &bit)| u8::from(bit) << place(at)).sum()
    };
    bits.chunks(8).map(byte).collect()
}

/// Deflate that stores.
pub fn deflate(bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len() as u16;
    let (mut a, mut b) = (1_u32, 0_u32);
    for &byte in bytes {
        a = (a + u32::from(byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    let sum = (b << 16 | a).to_be_bytes();
    [&[0x78, 1, 1][..], &length.to_le_bytes(), &(!length).to_le_bytes(), bytes, &sum].concat()
}

/// `PackBits` that repeats nothing.
pub fn pack_bits(bytes: &[u8]) -> Vec<u8> {
    bytes.chunks(128).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect()
}
