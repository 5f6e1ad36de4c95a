//! Headers, directories and tag values of a TIFF file, classic and big, of either byte order.
//!
//! The `tiff` crate reads directories and values. Two of its habits are worked around here and nowhere else: its
//! decoder insists on understanding the first image before it shows a single tag (so it could not even name a
//! compression it lacks), and it allocates for a value before it knows that the file is long enough.

use std::collections::HashSet;
use std::io::{Cursor, Read, Seek, SeekFrom};

use tiff::decoder::{Decoder, Limits as TiffLimits};
use tiff::tags::{ByteOrder, IfdPointer, Tag, Type, ValueBuffer};
use tiff::{Directory, TiffError};

use crate::error::{Error, Result};
use crate::limits::Limits;

/// More directories than this in one file are a sign of damage.
const MAX_DIRECTORIES: usize = 4096;

/// GDAL's XML with scale, offset and unit.
pub(super) const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// What directories are read from.
pub(super) trait Input: Read + Seek {}

impl<T: Read + Seek> Input for T {}

/// A TIFF file whose header has been read.
pub(super) struct Reader<'a> {
    decoder: Decoder<Box<dyn Input + 'a>>,
    first: u64,
    file_bytes: u64,
    max_entries: u64,
    /// True if the header says BigTIFF.
    pub(super) big: bool,
    /// True if numbers in the file are not in this machine's byte order.
    pub(super) swapped: bool,
}

/// A tag's values, in this machine's byte order.
struct Raw {
    kind: Type,
    bytes: Vec<u8>,
}

impl<'a> Reader<'a> {
    /// Reads the header. Anything that does not start like a TIFF is [`Error::Unsupported`]: it may be another format.
    pub(super) fn new(mut file: impl Input + 'a, file_bytes: u64, limits: &Limits) -> Result<Self> {
        let mut head = [0; 16];
        let start = &mut head[..file_bytes.min(16) as usize];
        file.read_exact(start)
            .and_then(|()| file.seek(SeekFrom::Start(0)))
            .map_err(|error| tiff_error("TIFF header".to_owned(), &error.into()))?;
        let (order, big) = signature(start)?;
        let header = if big { 16 } else { 8 };
        if start.len() < header {
            return Err(Error::format(
                "TIFF header",
                format!("{header} bytes"),
                format!("{} bytes", start.len()),
            ));
        }
        let number = |at: usize, bytes: usize| {
            let field = start.get(at..at + bytes).unwrap_or_default().iter();
            let push = |value: u64, &byte: &u8| value << 8 | u64::from(byte);
            if order == ByteOrder::BigEndian { field.fold(0, push) } else { field.rev().fold(0, push) }
        };
        let first = if big { number(8, 8) } else { number(4, 4) };
        // The decoder is made over a 1 x 1 image of the same kind and then given the file.
        let stub: Box<dyn Input + 'a> = Box::new(Cursor::new(stub(order, big)));
        let mut decoder = Decoder::new(stub)
            .map_err(|error| Error::format("TIFF header", "one that the decoder accepts", error))?
            .with_limits(TiffLimits::unlimited());
        *decoder.inner() = Box::new(file);
        Ok(Self {
            decoder,
            first,
            file_bytes,
            max_entries: limits.tag_entries,
            big,
            swapped: order != ByteOrder::native(),
        })
    }

    /// All directories of the main chain, first the full image.
    pub(super) fn directories(&mut self) -> Result<Vec<Directory>> {
        let mut found = Vec::new();
        let mut seen = HashSet::new();
        let mut next = Some(IfdPointer(self.first));
        while let Some(pointer) = next {
            let place = || format!("TIFF directory {} at offset {}", found.len(), pointer.0);
            if !seen.insert(pointer.0) {
                return Err(Error::format(place(), "a directory not seen before", "a cycle"));
            }
            if found.len() == MAX_DIRECTORIES {
                return Err(Error::limit(
                    "the number of TIFF directories",
                    found.len() as u64 + 1,
                    found.len() as u64,
                ));
            }
            if pointer.0 >= self.file_bytes {
                return Err(Error::format(
                    place(),
                    format!("an offset in the {} bytes of the file", self.file_bytes),
                    pointer.0,
                ));
            }
            let directory =
                self.decoder.read_directory(pointer).map_err(|error| tiff_error(place(), &error))?;
            next = directory.next();
            found.push(directory);
        }
        Ok(found)
    }

    /// All values of an unsigned integer tag.
    pub(super) fn integers(&mut self, directory: &Directory, tag: Tag) -> Result<Option<Vec<u64>>> {
        let Some(raw) = self.raw(directory, tag)? else { return Ok(None) };
        let bytes = &raw.bytes;
        let values = match raw.kind {
            Type::BYTE | Type::UNDEFINED => bytes.iter().map(|&byte| u64::from(byte)).collect(),
            Type::SHORT => each(bytes, |b| u64::from(u16::from_ne_bytes(b))),
            Type::LONG | Type::IFD => each(bytes, |b| u64::from(u32::from_ne_bytes(b))),
            Type::LONG8 | Type::IFD8 => each(bytes, u64::from_ne_bytes),
            kind => {
                return Err(Error::format(
                    place(tag),
                    "unsigned integers",
                    format!("values of type {kind:?}"),
                ));
            }
        };
        Ok(Some(values))
    }

    /// The first value of an unsigned integer tag.
    pub(super) fn integer(&mut self, directory: &Directory, tag: Tag) -> Result<Option<u64>> {
        Ok(self.integers(directory, tag)?.and_then(|values| values.first().copied()))
    }

    /// An integer that must be there and fit 32 bits.
    pub(super) fn required(&mut self, directory: &Directory, tag: Tag) -> Result<u32> {
        let value =
            self.integer(directory, tag)?.ok_or_else(|| Error::format(place(tag), "one value", "none"))?;
        u32::try_from(value).map_err(|_| Error::limit(place(tag), value, u64::from(u32::MAX)))
    }

    /// All values of a floating-point tag.
    pub(super) fn doubles(&mut self, directory: &Directory, tag: Tag) -> Result<Option<Vec<f64>>> {
        let Some(raw) = self.raw(directory, tag)? else { return Ok(None) };
        match raw.kind {
            Type::DOUBLE => Ok(Some(each(&raw.bytes, f64::from_ne_bytes))),
            Type::FLOAT => Ok(Some(each(&raw.bytes, |b| f64::from(f32::from_ne_bytes(b))))),
            kind => {
                Err(Error::format(place(tag), "floating-point numbers", format!("values of type {kind:?}")))
            }
        }
    }

    /// A text up to its first NUL. Bytes that are not UTF-8 become `?` one by one, so that offsets into it stay right.
    pub(super) fn text(&mut self, directory: &Directory, tag: Tag) -> Result<Option<String>> {
        let Some(Raw { mut bytes, .. }) = self.raw(directory, tag)? else { return Ok(None) };
        bytes.truncate(bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len()));
        let mut text = String::new();
        for chunk in bytes.utf8_chunks() {
            text.push_str(chunk.valid());
            text.extend(chunk.invalid().iter().map(|_| '?'));
        }
        Ok(Some(text))
    }

    fn raw(&mut self, directory: &Directory, tag: Tag) -> Result<Option<Raw>> {
        let Some(entry) = directory.get(tag) else { return Ok(None) };
        let (kind, count) = (entry.field_type(), entry.count());
        if count > self.max_entries {
            return Err(Error::limit(format!("the count of {}", place(tag)), count, self.max_entries));
        }
        if count.saturating_mul(bytes_of(kind)) > self.file_bytes.max(8) {
            let expected = format!("no more values than fit the {} bytes of the file", self.file_bytes);
            return Err(Error::format(place(tag), expected, count));
        }
        let mut buffer = ValueBuffer::empty(Type::BYTE);
        self.decoder
            .read_directory_tags(directory)
            .find_tag_buf(tag, &mut buffer)
            .map_err(|error| tiff_error(place(tag), &error))?;
        buffer.set_byte_order(ByteOrder::native());
        Ok(Some(Raw { kind, bytes: buffer.as_bytes().to_vec() }))
    }
}

/// Where a tag's value is, for messages.
pub(super) fn place(tag: Tag) -> String {
    match tag {
        Tag::Unknown(number) => format!("TIFF tag {number}"),
        known => format!("TIFF tag {} ({known:?})", known.to_u16()),
    }
}

/// Byte order, and whether it is a BigTIFF.
fn signature(file: &[u8]) -> Result<(ByteOrder, bool)> {
    let start = file.get(..4).unwrap_or(file);
    match start {
        b"II*\0" => Ok((ByteOrder::LittleEndian, false)),
        b"MM\0*" => Ok((ByteOrder::BigEndian, false)),
        b"II+\0" => Ok((ByteOrder::LittleEndian, true)),
        b"MM\0+" => Ok((ByteOrder::BigEndian, true)),
        [] => Err(Error::format("TIFF header", "8 bytes", "an empty file")),
        _ => Err(Error::unsupported(
            format!("not a TIFF (it starts with {})", start.escape_ascii()),
            crate::source::open::NEEDS_GDAL,
        )),
    }
}

/// A TIFF of one pixel.
fn stub(order: ByteOrder, big: bool) -> &'static [u8] {
    match (order, big) {
        (ByteOrder::LittleEndian, false) => {
            b"II*\0\x08\0\0\0\x05\0\
            \0\x01\x03\0\x01\0\0\0\x01\0\0\0\x01\x01\x03\0\x01\0\0\0\x01\0\0\0\x06\x01\x03\0\x01\0\0\0\x01\0\0\0\
            \x11\x01\x04\0\x01\0\0\0\0\0\0\0\x17\x01\x04\0\x01\0\0\0\x01\0\0\0\0\0\0\0"
        }
        (ByteOrder::BigEndian, false) => {
            b"MM\0*\0\0\0\x08\0\x05\
            \x01\0\0\x03\0\0\0\x01\0\x01\0\0\x01\x01\0\x03\0\0\0\x01\0\x01\0\0\x01\x06\0\x03\0\0\0\x01\0\x01\0\0\
            \x01\x11\0\x04\0\0\0\x01\0\0\0\0\x01\x17\0\x04\0\0\0\x01\0\0\0\x01\0\0\0\0"
        }
        (ByteOrder::LittleEndian, true) => {
            b"II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0\x05\0\0\0\0\0\0\0\
            \0\x01\x03\0\x01\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x01\x01\x03\0\x01\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\
            \x06\x01\x03\0\x01\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\x11\x01\x04\0\x01\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\
            \x17\x01\x04\0\x01\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"
        }
        (ByteOrder::BigEndian, true) => {
            b"MM\0+\0\x08\0\0\0\0\0\0\0\0\0\x10\0\0\0\0\0\0\0\x05\
            \x01\0\0\x03\0\0\0\0\0\0\0\x01\0\x01\0\0\0\0\0\0\x01\x01\0\x03\0\0\0\0\0\0\0\x01\0\x01\0\0\0\0\0\0\
            \x01\x06\0\x03\0\0\0\0\0\0\0\x01\0\x01\0\0\0\0\0\0\x01\x11\0\x04\0\0\0\0\0\0\0\x01\0\0\0\0\0\0\0\0\
            \x01\x17\0\x04\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0\0\0\0\0\0\0\0\0\0"
        }
    }
}

fn bytes_of(kind: Type) -> u64 {
    match kind {
        Type::SHORT | Type::SSHORT => 2,
        Type::LONG | Type::SLONG | Type::FLOAT | Type::IFD => 4,
        Type::RATIONAL | Type::SRATIONAL | Type::DOUBLE | Type::LONG8 | Type::SLONG8 | Type::IFD8 => 8,
        _ => 1,
    }
}

fn each<const N: usize, T>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&chunk| read(chunk)).collect()
}

fn tiff_error(place: String, error: &TiffError) -> Error {
    let got = match error {
        TiffError::IoError(io) if io.kind() == std::io::ErrorKind::UnexpectedEof => {
            "the end of the file".to_owned()
        }
        TiffError::IoError(io) => {
            let source =
                io.raw_os_error().map_or_else(|| io.kind().into(), std::io::Error::from_raw_os_error);
            return Error::io("", format!("read {place}"), source);
        }
        other => other.to_string(),
    };
    Error::format(place, "a readable value", got)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stub_is_a_tiff_that_the_decoder_accepts() {
        for order in [ByteOrder::LittleEndian, ByteOrder::BigEndian] {
            for big in [false, true] {
                let read = |file: &[u8]| {
                    let length = file.len() as u64;
                    Reader::new(Cursor::new(file.to_vec()), length, &Limits::default())
                };
                let mut file = stub(order, big).to_vec();
                let mut reader = read(&file).expect("stub");
                let directories = reader.directories().expect("directory");
                assert_eq!(directories.len(), 1);
                assert_eq!(reader.required(&directories[0], Tag::ImageWidth).expect("width"), 1);
                let at = file.len() - if big { 8 } else { 4 };
                let tail = file.split_off(at);
                assert!(read(&file).expect("header").directories().is_err());
                drop(tail);
            }
        }
    }
}
