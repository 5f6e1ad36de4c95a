//! Headers, directories and tag values of a TIFF file, classic or BigTIFF, in either byte order,
//! read by position.
//!
//! Directories are interpreted as libtiff and GDAL do: the first of two equal tags counts, a number
//! may be stored in any type that holds it, and a chain of directories ends at the first damaged
//! one behind the first. Nothing is allocated before the file is known to be long enough for it.
//! Overlapping directories and values cannot multiply the work: all reads together are bounded by
//! the length of the file.

use std::collections::HashSet;

use tiff::tags::{Tag, Type};

use super::file::TiffFile;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::source::kind;

/// Most entries in all directories of a file together.
const MAX_ENTRIES: u64 = 1 << 20;

/// How often a byte may be read as part of a value: each value is read once or twice, and they do
/// not overlap in valid files.
const READ_AGAIN: u64 = 4;

/// Advice for a file that ends too early.
const CUT_OFF: &str = "(it is cut off, or damaged: get it again)";

/// Tag of GDAL's XML with scale, offset and unit.
pub(super) const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// A TIFF file whose header has been read.
pub(super) struct Reader<'a> {
    file: &'a TiffFile,
    first: u64,
    max_entries: u64,
    /// Bytes of values that may still be read.
    left: u64,
    /// True for BigTIFF.
    pub(super) big: bool,
    little: bool,
    /// True if the byte order of the file is not this machine's.
    pub(super) swapped: bool,
}

/// The tags of one image.
#[derive(Debug)]
pub(super) struct Directory {
    entries: Vec<Entry>,
}

/// A tag's type, count and position of its values.
#[derive(Clone, Copy, Debug)]
struct Entry {
    tag: u16,
    kind: u16,
    count: u64,
    /// Offset of the first value in the file; short values lie in the entry itself.
    at: u64,
}

/// Values of a tag in the byte order of the file.
struct Raw {
    kind: Type,
    bytes: Vec<u8>,
}

impl Directory {
    /// True if the directory has a tag.
    pub(super) fn contains(&self, tag: Tag) -> bool {
        self.get(tag).is_some()
    }

    /// Of two tags, the one with the later position in the directory, or the only one.
    pub(super) fn later(&self, one: Tag, other: Tag) -> Tag {
        let place = |tag: Tag| self.entries.iter().position(|entry| entry.tag == tag.to_u16());
        if place(one) > place(other) { one } else { other }
    }

    fn get(&self, tag: Tag) -> Option<Entry> {
        self.entries.iter().copied().find(|entry| entry.tag == tag.to_u16())
    }
}

impl<'a> Reader<'a> {
    /// Reads the header. A file that does not begin as a TIFF is [`Error::Unsupported`], since it
    /// may have another format.
    pub(super) fn new(file: &'a TiffFile, limits: &Limits) -> Result<Self> {
        let mut head = [0; kind::LOOK];
        let start = &mut head[..file.length().min(kind::LOOK as u64) as usize];
        file.read(start, 0, &|| "TIFF header".to_owned())?;
        let (little, big) = match start {
            [b'I', b'I', b'*', 0, ..] => (true, false),
            [b'M', b'M', 0, b'*', ..] => (false, false),
            [b'I', b'I', b'+', 0, ..] => (true, true),
            [b'M', b'M', 0, b'+', ..] => (false, true),
            other => return Err(kind::refusal(other)),
        };
        let length = if big { 16 } else { 8 };
        let Some(header) = start.get(..length) else {
            return Err(Error::format(
                "TIFF header",
                format!("{length} bytes"),
                format!("{} bytes", start.len()),
            ));
        };
        if big && (number(&header[4..6], little), number(&header[6..8], little)) != (8, 0) {
            return Err(Error::format(
                "BigTIFF header",
                "offsets of 8 bytes",
                format!("{:?}", &header[4..8]),
            ));
        }
        Ok(Self {
            file,
            first: number(if big { &header[8..16] } else { &header[4..8] }, little),
            max_entries: limits.tag_entries,
            left: file.length().saturating_mul(READ_AGAIN).saturating_add(1 << 16),
            big,
            little,
            swapped: little != cfg!(target_endian = "little"),
        })
    }

    /// Length of the file in bytes.
    pub(super) fn file_bytes(&self) -> u64 {
        self.file.length()
    }

    /// All directories of the main chain, at least one, the full image first.
    pub(super) fn directories(&mut self) -> Result<Vec<Directory>> {
        let (mut found, mut seen) = (Vec::new(), HashSet::new());
        let (mut next, mut total) = (self.first, 0_u64);
        while next != 0 && seen.insert(next) {
            let place = || format!("TIFF directory {} at offset {next}", found.len());
            let entries = self.entry_count(next)?.filter(|&entries| {
                // Overlapping directories are damage too; they are not read again and again.
                total += entries;
                total * self.entry_bytes() <= self.file.length() && total <= MAX_ENTRIES
            });
            let Some(entries) = entries else {
                if found.is_empty() {
                    let got =
                        format!("other bytes, or the end of the file at {} {CUT_OFF}", self.file.length());
                    return Err(Error::format(place(), "a directory", got));
                }
                // Damage behind the first image: the directories found so far count, as in GDAL.
                break;
            };
            let (directory, link) = self.directory(next, entries, &place)?;
            found.push(directory);
            next = link;
        }
        if found.is_empty() {
            return Err(Error::format("TIFF header", "the offset of an image", 0));
        }
        Ok(found)
    }

    /// Number of entries of the directory at an offset; `None` if it has none or extends beyond the
    /// end of the file.
    fn entry_count(&self, at: u64) -> Result<Option<u64>> {
        let room = self.file.length().checked_sub(at);
        let Some(room) = room.and_then(|room| room.checked_sub(self.count_bytes() as u64)) else {
            return Ok(None);
        };
        let mut count = [0; 8];
        let count = &mut count[..self.count_bytes()];
        self.file.read(count, at, &|| "TIFF directory".to_owned())?;
        Ok(Some(self.number(count)).filter(|&entries| entries > 0 && entries <= room / self.entry_bytes()))
    }

    /// The directory of `entries` entries at an offset, and the offset of the next one.
    fn directory(&self, at: u64, entries: u64, place: &dyn Fn() -> String) -> Result<(Directory, u64)> {
        let first = at + self.count_bytes() as u64;
        let (entry_bytes, word) = (self.entry_bytes(), self.word());
        let all = entries * entry_bytes;
        // A file may end before the link of its last directory.
        let link = (self.file.length() - first - all).min(word as u64);
        let mut bytes = vec![0; (all + link) as usize];
        self.file.read(&mut bytes, first, place)?;
        let (entry_list, link) = bytes.split_at(all as usize);
        let entry = |(index, bytes): (usize, &[u8])| {
            let field = 4 + word;
            let (kind, count) = (self.number(&bytes[2..4]), self.number(&bytes[4..field]));
            let kind = kind as u16;
            let is_inside = count.saturating_mul(bytes_of(kind)) <= word as u64;
            let inside = first + index as u64 * entry_bytes + field as u64;
            let at = if is_inside { inside } else { self.number(&bytes[field..]) };
            Entry { tag: self.number(&bytes[..2]) as u16, kind, count, at }
        };
        let entries = entry_list.chunks_exact(entry_bytes as usize).enumerate().map(entry).collect();
        let next = if link.len() == word { self.number(link) } else { 0 };
        Ok((Directory { entries }, next))
    }

    /// All values of an unsigned integer tag.
    pub(super) fn integers(&mut self, directory: &Directory, tag: Tag) -> Result<Option<Vec<u64>>> {
        self.some_integers(directory, tag, u64::MAX)
    }

    /// The first value of an unsigned integer tag.
    pub(super) fn integer(&mut self, directory: &Directory, tag: Tag) -> Result<Option<u64>> {
        Ok(self.some_integers(directory, tag, 1)?.and_then(|values| values.first().copied()))
    }

    /// An integer that must be present and fit 32 bits.
    pub(super) fn required(&mut self, directory: &Directory, tag: Tag) -> Result<u32> {
        let value =
            self.integer(directory, tag)?.ok_or_else(|| Error::format(place(tag), "one value", "none"))?;
        u32::try_from(value).map_err(|_| Error::limit(place(tag), value, u64::from(u32::MAX)))
    }

    fn some_integers(&mut self, directory: &Directory, tag: Tag, most: u64) -> Result<Option<Vec<u64>>> {
        let Some(Raw { kind, bytes }) = self.raw(directory, tag, most)? else { return Ok(None) };
        let values = bytes.chunks_exact(bytes_of(kind as u16) as usize).map(|bytes| self.number(bytes));
        let negative = |value: i64| Error::format(place(tag), "no number below 0", value);
        let signed = |value: i64| u64::try_from(value).map_err(|_| negative(value));
        match kind {
            Type::BYTE
            | Type::UNDEFINED
            | Type::SHORT
            | Type::LONG
            | Type::IFD
            | Type::LONG8
            | Type::IFD8 => Ok(Some(values.collect())),
            Type::SBYTE => values.map(|value| signed((value as i8).into())).collect::<Result<_>>().map(Some),
            Type::SSHORT => {
                values.map(|value| signed((value as i16).into())).collect::<Result<_>>().map(Some)
            }
            Type::SLONG => values.map(|value| signed((value as i32).into())).collect::<Result<_>>().map(Some),
            Type::SLONG8 => values.map(|value| signed(value as i64)).collect::<Result<_>>().map(Some),
            kind => Err(Error::format(place(tag), "integers", format!("values of type {kind:?}"))),
        }
    }

    /// All values of a numeric tag of any type.
    pub(super) fn doubles(&mut self, directory: &Directory, tag: Tag) -> Result<Option<Vec<f64>>> {
        let Some(Raw { kind, bytes }) = self.raw(directory, tag, u64::MAX)? else { return Ok(None) };
        let fraction = |above: f64, below: f64| if below == 0.0 { 0.0 } else { above / below };
        let value = |bytes: &[u8]| {
            let value = self.number(bytes);
            let half = |at: usize| self.number(&bytes[at..at + 4]);
            match kind {
                Type::FLOAT => f32::from_bits(value as u32).into(),
                Type::DOUBLE => f64::from_bits(value),
                Type::RATIONAL => fraction(half(0) as f64, half(4) as f64),
                Type::SRATIONAL => fraction((half(0) as i32).into(), (half(4) as i32).into()),
                Type::SBYTE => (value as i8).into(),
                Type::SSHORT => (value as i16).into(),
                Type::SLONG => (value as i32).into(),
                Type::SLONG8 => value as i64 as f64,
                _ => value as f64,
            }
        };
        if kind == Type::ASCII {
            return Err(Error::format(place(tag), "numbers", "a text"));
        }
        Ok(Some(bytes.chunks_exact(bytes_of(kind as u16) as usize).map(value).collect()))
    }

    /// A text up to its first NUL. Each byte that is not UTF-8 becomes `?`, so that offsets into it
    /// stay right.
    pub(super) fn text(&mut self, directory: &Directory, tag: Tag) -> Result<Option<String>> {
        let Some(Raw { kind, mut bytes }) = self.raw(directory, tag, u64::MAX)? else { return Ok(None) };
        if bytes_of(kind as u16) != 1 {
            return Err(Error::format(place(tag), "a text", format!("values of type {kind:?}")));
        }
        bytes.truncate(bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len()));
        let mut text = String::new();
        for chunk in bytes.utf8_chunks() {
            text.push_str(chunk.valid());
            text.extend(chunk.invalid().iter().map(|_| '?'));
        }
        Ok(Some(text))
    }

    /// The first `most` values of a tag, or all if there are fewer.
    fn raw(&mut self, directory: &Directory, tag: Tag, most: u64) -> Result<Option<Raw>> {
        let Some(Entry { kind, count, at, .. }) = directory.get(tag) else { return Ok(None) };
        let known = Type::from_u16(kind);
        let kind = known.ok_or_else(|| Error::format(place(tag), "a type of TIFF's", kind))?;
        let count = count.min(most);
        if count > self.max_entries {
            return Err(Error::limit(format!("the count of {}", place(tag)), count, self.max_entries));
        }
        let bytes = count * bytes_of(kind as u16);
        let length = self.file.length();
        if at.checked_add(bytes).is_none_or(|end| end > length) {
            let expected = format!("{bytes} bytes at offset {at}");
            let got = format!("the end of the file at {length} {CUT_OFF}");
            return Err(Error::format(place(tag), expected, got));
        }
        self.left = self.left.checked_sub(bytes).ok_or_else(|| {
            Error::format(place(tag), "values beside each other in the file", "values that overlap")
        })?;
        let mut values = Vec::new();
        let room = values.try_reserve_exact(bytes as usize);
        room.map_err(|_| Error::out_of_memory(place(tag), bytes))?;
        values.resize(bytes as usize, 0);
        self.file.read(&mut values, at, &|| place(tag))?;
        Ok(Some(Raw { kind, bytes: values }))
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        number(bytes, self.little)
    }

    /// Bytes of the number of entries at the start of a directory.
    fn count_bytes(&self) -> usize {
        if self.big { 8 } else { 2 }
    }

    /// Bytes of an offset, and of the value field of an entry.
    fn word(&self) -> usize {
        if self.big { 8 } else { 4 }
    }

    fn entry_bytes(&self) -> u64 {
        4 + 2 * self.word() as u64
    }
}

/// The name of a tag's place, for messages.
pub(super) fn place(tag: Tag) -> String {
    match tag {
        Tag::Unknown(number) => format!("TIFF tag {number}"),
        known => format!("TIFF tag {} ({known:?})", known.to_u16()),
    }
}

/// An unsigned number of 1, 2, 4 or 8 bytes.
fn number(bytes: &[u8], little: bool) -> u64 {
    match *bytes {
        [byte] => byte.into(),
        [a, b] if little => u16::from_le_bytes([a, b]).into(),
        [a, b] => u16::from_be_bytes([a, b]).into(),
        [a, b, c, d] if little => u32::from_le_bytes([a, b, c, d]).into(),
        [a, b, c, d] => u32::from_be_bytes([a, b, c, d]).into(),
        [a, b, c, d, e, f, g, h] if little => u64::from_le_bytes([a, b, c, d, e, f, g, h]),
        [a, b, c, d, e, f, g, h] => u64::from_be_bytes([a, b, c, d, e, f, g, h]),
        _ => 0,
    }
}

/// Bytes of a value of a type; 1 for unknown types.
fn bytes_of(kind: u16) -> u64 {
    match Type::from_u16(kind) {
        Some(Type::SHORT | Type::SSHORT) => 2,
        Some(Type::LONG | Type::SLONG | Type::FLOAT | Type::IFD) => 4,
        Some(Type::RATIONAL | Type::SRATIONAL | Type::DOUBLE | Type::LONG8 | Type::SLONG8 | Type::IFD8) => 8,
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> Result<(usize, usize)> {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.tif");
        std::fs::write(&path, bytes).expect("write");
        let limits = Limits::default();
        let file = TiffFile::open(&path, &limits)?;
        let mut reader = Reader::new(&file, &limits)?;
        let directories = reader.directories()?;
        for directory in &directories {
            reader.integers(directory, Tag::StripOffsets)?;
        }
        Ok((directories.len(), directories.iter().map(|directory| directory.entries.len()).sum()))
    }

    /// Directories of 200 entries, `stride` bytes apart, whose strip offsets all share the same
    /// values.
    fn chain(count: u32, stride: usize, values: u32) -> Vec<u8> {
        let mut file = b"II*\0\x08\0\0\0".to_vec();
        let (entries, links) = (200 * 12, 8 + 2 + 200 * 12);
        file.resize(links + 4 + count as usize * stride, 0);
        let strips = [&[0x11, 1, 4, 0][..], &values.to_le_bytes(), &8_u32.to_le_bytes()].concat();
        for at in (0..count as usize).map(|n| n * stride) {
            file[8 + at..10 + at].copy_from_slice(&200_u16.to_le_bytes());
            if stride > entries {
                file[10 + at..22 + at].copy_from_slice(&strips);
            }
            let next = (8 + at + stride) as u32;
            file[links + at..links + at + 4].copy_from_slice(&next.to_le_bytes());
        }
        file
    }

    #[test]
    fn directories_and_values_that_overlap_are_not_multiplied() {
        // Directories side by side are all read; the last one that fits the file ends the chain.
        assert_eq!(read(&chain(50, 2500, 3)).expect("directories"), (50, 50 * 200));
        // Of overlapping directories, as many are read as would fit into the file.
        let file = chain(5000, 4, 3);
        let (_, entries) = read(&file).expect("directories");
        assert!(entries * 12 <= file.len() && entries > 0, "{entries}");
        // All of these values cover nearly the whole file.
        let file = chain(50, 2500, 30_000);
        let message = read(&file).expect_err("values that overlap").to_string();
        assert!(message.contains("overlap"), "{message}");
    }

    #[test]
    fn a_first_directory_that_is_none_is_refused() {
        for bytes in
            [&b"II*\0\x08\0\0\0\0\0"[..], b"II*\0\x08\0\0\0\x01\0", b"II*\0\0\0\0\0", b"II*\0\xFF\0\0\0"]
        {
            assert!(matches!(read(bytes), Err(Error::Format { .. })), "{bytes:?}");
        }
        let big = b"II+\0\x07\0\0\0\x10\0\0\0\0\0\0\0";
        assert!(read(big).expect_err("offsets of 7 bytes").to_string().contains("8 bytes"));
    }
}
