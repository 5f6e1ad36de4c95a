//! The imagery layer (section 16 of the specification): its header, and the rows of its index.

use super::bytes::Bytes;
use super::directory::{ChunkPlace, IndexPage, Quadtree, Row, column, encode_columns, existing_children};
use crate::codec::imagery::{Codec, Form, JpegTables, MAX_PREFIX};
use crate::error::{Error, Result};
use crate::texel::Colour;
use crate::tile::TileId;

/// Deepest level of an imagery layer.
pub const MAX_IMAGERY_LEVEL: u8 = 30;
const PLACE: &str = "imagery header";

/// The header of an imagery layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageryHeader {
    /// Texels along the side of a tile, gutters not counted: a multiple of 4, 64..=4096.
    pub tile: u32,
    /// Texels of its neighbours that a tile repeats on every side, 0..=16.
    pub gutter: u8,
    /// How tiles are stored.
    pub codec: Codec,
    /// Quality of a JPEG, 1..=100; 0 for other codecs.
    pub quality: u8,
    /// The colour type of a texel.
    pub colour: Colour,
    /// True if some tile has a texel that is not opaque.
    pub alpha: bool,
    /// The level that no tile lies below.
    pub leaf: u8,
    /// Existing tiles.
    pub tiles: u64,
}

impl ImageryHeader {
    /// Texels along the side of a stored tile.
    pub fn side(&self) -> usize {
        self.tile as usize + 2 * usize::from(self.gutter)
    }

    /// The form of the tiles, for the codec.
    pub fn form(&self) -> Form {
        Form { codec: self.codec, quality: self.quality, colour: self.colour, side: self.side() }
    }

    /// Texels along a side of the root square at a level.
    pub fn texels(&self, level: u8) -> u64 {
        u64::from(self.tile) << level
    }

    /// Fails unless every field is within its range and fits the others.
    pub fn check(&self) -> Result<()> {
        let demand = |is: bool, field: &str, expected: &str, got: String| {
            if is { Ok(()) } else { Err(Error::format(format!("{PLACE}, {field}"), expected, got)) }
        };
        let fits = (64..=4096).contains(&self.tile) && self.tile.is_multiple_of(4);
        demand(fits, "tile size", "a multiple of 4 in 64 to 4096", self.tile.to_string())?;
        demand(
            self.gutter <= 16 && self.side().is_multiple_of(4),
            "gutter",
            "at most 16, even",
            self.gutter.to_string(),
        )?;
        let (expected, range) = if self.codec == Codec::Jpeg { ("1 to 100", 1..=100) } else { ("0", 0..=0) };
        demand(range.contains(&self.quality), "quality", expected, self.quality.to_string())?;
        demand(self.leaf <= MAX_IMAGERY_LEVEL, "leaf level", "at most 30", self.leaf.to_string())?;
        demand(self.tiles > 0, "tile count", "at least 1", "0".into())
    }

    /// The section: the fields, the root page as stored, and the JPEG prefix (empty for other
    /// codecs).
    pub fn encode(&self, root: &[u8], prefix: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        out.extend((self.tile as u16).to_le_bytes());
        let channels = self.colour.channels() as u8;
        out.extend([self.gutter, self.codec as u8, self.quality, channels, u8::from(self.alpha), self.leaf]);
        out.extend(self.tiles.to_le_bytes());
        out.extend((root.len() as u32).to_le_bytes());
        out.extend((prefix.len() as u32).to_le_bytes());
        out.extend(root);
        out.extend(prefix);
        out
    }

    /// Decodes the section: the inverse of [`ImageryHeader::encode`]. Returns the header, the root
    /// page as stored, and the tables of a JPEG layer.
    pub(super) fn decode(bytes: &[u8]) -> Result<(Self, &[u8], Option<JpegTables>)> {
        let mut bytes = Bytes::new(bytes, PLACE);
        let tile = bytes.u16()?.into();
        let (gutter, codec, quality, channels) = (bytes.u8()?, bytes.u8()?, bytes.u8()?, bytes.u8()?);
        let (flags, leaf, tiles) = (bytes.u8()?, bytes.u8()?, bytes.u64()?);
        let codec = Codec::from_number(codec)
            .ok_or_else(|| super::layout::newer(format!("imagery codec {codec}")))?;
        let colour = match channels {
            1 => Colour::Grey,
            3 => Colour::Rgb,
            other => return Err(Error::format(PLACE, "1 or 3 channels", other)),
        };
        if flags > 1 {
            return Err(Error::format(PLACE, "flags 0 or 1", flags));
        }
        let header = Self { tile, gutter, codec, quality, colour, alpha: flags != 0, leaf, tiles };
        header.check()?;
        let (root, prefix) = (bytes.u32()?, bytes.u32()?);
        let root = bytes.take(root as usize)?;
        let prefix = bytes.take(prefix as usize)?;
        bytes.end()?;
        let tables = if codec == Codec::Jpeg {
            Some(JpegTables::parse(&header.form(), prefix)?)
        } else if prefix.is_empty() {
            None
        } else {
            return Err(Error::format(PLACE, "no JPEG prefix", format!("{} bytes", prefix.len())));
        };
        Ok((header, root, tables))
    }

    /// Most bytes of the section.
    pub(super) fn max_bytes() -> u64 {
        24 + 2 * IndexPage::<ImageryEntry>::MAX_BYTES + MAX_PREFIX as u64
    }
}

impl Quadtree for ImageryHeader {
    fn leaf(&self) -> u8 {
        self.leaf
    }

    fn holds(&self, id: TileId) -> bool {
        id.level <= self.leaf && id.x >> id.level == 0 && id.y >> id.level == 0
    }

    fn max_chunk_bytes(&self) -> u64 {
        self.form().max_chunk_bytes()
    }
}

/// A row of the imagery's index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageryEntry {
    /// Which tile.
    pub id: TileId,
    /// Bit `q` is set if child `q` exists; 0 if there is no finer imagery.
    pub children: u8,
    /// Where its chunks are stored: colour, alpha.
    pub chunks: ChunkPlace<2>,
}

impl ImageryEntry {
    /// The children that exist, by quadrant.
    pub fn child_ids(&self) -> impl Iterator<Item = TileId> + use<> {
        existing_children(self.id, self.children)
    }

    fn check(&self) -> Result<()> {
        let demand = |is: bool, expected: &str| {
            if is {
                return Ok(());
            }
            Err(Error::format(format!("imagery index row of tile {}", self.id), expected, "other"))
        };
        demand(self.children < 16, "children in bits 0 to 3")?;
        demand(self.chunks.lengths[0] > 0, "colour")?;
        demand(self.chunks.lengths[1] > 0 || self.chunks.crcs[1] == 0, "CRC 0 of no bytes")
    }
}

impl Row for ImageryEntry {
    const BYTES: usize = 25;
    const LAYER: &'static str = "imagery ";
    const MAX_LEVEL: u8 = MAX_IMAGERY_LEVEL;

    fn id(&self) -> TileId {
        self.id
    }

    fn children(&self) -> u8 {
        self.children
    }

    fn offset(&self) -> u64 {
        self.chunks.offset
    }

    fn set_offset(&mut self, offset: u64) {
        self.chunks.offset = offset;
    }

    fn lengths(&self) -> &[u32] {
        &self.chunks.lengths
    }

    fn encode(rows: &[Self], out: &mut Vec<u8>) {
        encode_columns(rows, out, |entry| entry.chunks.offset.to_le_bytes());
        for index in 0..2 {
            encode_columns(rows, out, |entry| entry.chunks.lengths[index].to_le_bytes());
        }
        for index in 0..2 {
            encode_columns(rows, out, |entry| entry.chunks.crcs[index].to_le_bytes());
        }
    }

    fn decode(bytes: &mut Bytes, ids: &[TileId], children: &[u8]) -> Result<Vec<Self>> {
        let count = ids.len();
        let offsets = column(bytes, count, Bytes::u64)?;
        let mut numbers = || column(bytes, count, Bytes::u32);
        let lengths = [numbers()?, numbers()?];
        let crcs = [numbers()?, numbers()?];
        let mut rows = Vec::with_capacity(count);
        for (index, (&id, &children)) in ids.iter().zip(children).enumerate() {
            let chunks = ChunkPlace {
                offset: offsets[index],
                lengths: lengths.each_ref().map(|column| column[index]),
                crcs: crcs.each_ref().map(|column| column[index]),
            };
            let row = Self { id, children, chunks };
            row.check()?;
            rows.push(row);
        }
        Ok(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::imagery::jpeg_tables;

    fn header(codec: Codec) -> ImageryHeader {
        ImageryHeader {
            tile: 252,
            gutter: 2,
            codec,
            quality: if codec == Codec::Jpeg { 85 } else { 0 },
            colour: Colour::Rgb,
            alpha: true,
            leaf: 7,
            tiles: 1 << 40,
        }
    }

    #[test]
    fn headers_come_back_and_are_checked() {
        for codec in Codec::ALL {
            let header = header(codec);
            let tables = jpeg_tables(&header.form()).unwrap();
            let prefix = tables.as_ref().map_or(&[][..], |tables| tables.prefix());
            let bytes = header.encode(b"root", prefix);
            assert!((bytes.len() as u64) < ImageryHeader::max_bytes());
            assert_eq!(ImageryHeader::decode(&bytes).unwrap(), (header, &b"root"[..], tables));
            for end in 0..bytes.len() {
                assert!(ImageryHeader::decode(&bytes[..end]).is_err(), "{codec}, cut at {end}");
            }
            for (at, value) in
                [(0, 255), (1, 64), (2, 17), (2, 1), (3, 0), (3, 6), (4, 101), (5, 2), (6, 2), (7, 31)]
            {
                let mut bad = bytes.clone();
                bad[at] = value;
                assert!(ImageryHeader::decode(&bad).is_err(), "{codec}, {value} at {at}");
            }
        }
    }
}
