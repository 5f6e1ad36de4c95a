//! Writes the TIFF header and image file directories, little-endian. Knows nothing of pixels.

/// Tag numbers.
pub(super) mod tags {
    pub const NEW_SUBFILE_TYPE: u16 = 254;
    pub const IMAGE_WIDTH: u16 = 256;
    pub const IMAGE_LENGTH: u16 = 257;
    pub const BITS_PER_SAMPLE: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC: u16 = 262;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES_PER_PIXEL: u16 = 277;
    pub const ROWS_PER_STRIP: u16 = 278;
    pub const STRIP_BYTE_COUNTS: u16 = 279;
    pub const PLANAR_CONFIGURATION: u16 = 284;
    pub const PREDICTOR: u16 = 317;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_LENGTH: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTE_COUNTS: u16 = 325;
    pub const EXTRA_SAMPLES: u16 = 338;
    pub const SAMPLE_FORMAT: u16 = 339;
    pub const MODEL_PIXEL_SCALE: u16 = 33550;
    pub const MODEL_TIEPOINT: u16 = 33922;
    pub const MODEL_TRANSFORMATION: u16 = 34264;
    pub const GEO_KEY_DIRECTORY: u16 = 34735;
    pub const GEO_DOUBLE_PARAMS: u16 = 34736;
    pub const GEO_ASCII_PARAMS: u16 = 34737;
    pub const GDAL_METADATA: u16 = 42112;
    pub const GDAL_NODATA: u16 = 42113;
}

/// A tag and its values.
#[derive(Clone, Debug)]
pub(super) struct Tag {
    pub id: u16,
    pub value: Value,
}

impl Tag {
    pub fn new(id: u16, value: Value) -> Self {
        Self { id, value }
    }
}

/// Values of a tag.
#[derive(Clone, Debug)]
pub(super) enum Value {
    /// SHORT.
    Shorts(Vec<u16>),
    /// LONG.
    Long(u32),
    /// Offsets and sizes: LONG in a classic TIFF, LONG8 in a BigTIFF.
    Offsets(Vec<u64>),
    /// DOUBLE.
    Doubles(Vec<f64>),
    /// ASCII; the closing NUL is added.
    Ascii(String),
}

impl Value {
    /// TIFF type number, count and little-endian bytes.
    fn encode(&self, big: bool) -> (u16, u64, Vec<u8>) {
        match self {
            Self::Shorts(v) => (3, v.len() as u64, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Long(v) => (4, 1, v.to_le_bytes().to_vec()),
            Self::Offsets(v) if big => (16, v.len() as u64, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Offsets(v) => {
                (4, v.len() as u64, v.iter().flat_map(|x| (*x as u32).to_le_bytes()).collect())
            }
            Self::Doubles(v) => (12, v.len() as u64, v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Ascii(v) => {
                let bytes: Vec<u8> = v.bytes().chain([0]).collect();
                (2, bytes.len() as u64, bytes)
            }
        }
    }
}

/// A block index of the right length, all zero, for measuring the size of the directory.
pub(super) fn zero_index(count: u64) -> Vec<(u64, u64)> {
    vec![(0, 0); count as usize]
}

/// Header, directory and the values that do not fit into its entries: the file up to its first
/// block. `next` is the offset of another directory, or 0.
///
/// The length depends on the tags and the number of blocks, not on their offsets. The caller must
/// keep the offsets of a classic TIFF below 4 GiB.
pub(super) fn encode(
    other: &[Tag],
    blocks: &[(u64, u64)],
    tiled: bool,
    big: bool,
    next: Option<u64>,
) -> Vec<u8> {
    let mut front = header(big);
    let start = front.len() as u64;
    front.extend(directory(other, blocks, tiled, big, (start, next.unwrap_or(0))));
    front
}

/// A second directory, at offset `place`, of an image in strips.
pub(super) fn another(other: &[Tag], blocks: &[(u64, u64)], big: bool, place: u64) -> Vec<u8> {
    directory(other, blocks, false, big, (place, 0))
}

/// A directory at an offset, with the offset of the next one, and its values.
fn directory(
    other: &[Tag],
    blocks: &[(u64, u64)],
    tiled: bool,
    big: bool,
    (place, next): (u64, u64),
) -> Vec<u8> {
    let (offsets, counts) = if tiled {
        (tags::TILE_OFFSETS, tags::TILE_BYTE_COUNTS)
    } else {
        (tags::STRIP_OFFSETS, tags::STRIP_BYTE_COUNTS)
    };
    let mut all = other.to_vec();
    all.push(Tag::new(offsets, Value::Offsets(blocks.iter().map(|block| block.0).collect())));
    all.push(Tag::new(counts, Value::Offsets(blocks.iter().map(|block| block.1).collect())));
    all.sort_by_key(|tag| tag.id);

    // Classic: 2 bytes of count, 12 per entry, 4 of link. BigTIFF: 8, 20, 8.
    let (count, entry, word) = if big { (8, 20, 8) } else { (2, 12, 4) };
    let end = place + (count + entry * all.len() + word) as u64;
    let mut values_at = end.next_multiple_of(8);
    let padding = (values_at - end) as usize;
    let (mut front, mut values) = (Vec::new(), Vec::new());
    if big {
        front.extend((all.len() as u64).to_le_bytes());
    } else {
        front.extend((all.len() as u16).to_le_bytes());
    }
    for tag in &all {
        let (kind, count, mut bytes) = tag.value.encode(big);
        front.extend(tag.id.to_le_bytes());
        front.extend(kind.to_le_bytes());
        push_word(&mut front, count, big);
        if bytes.len() <= word {
            bytes.resize(word, 0);
            front.extend(bytes);
        } else {
            push_word(&mut front, values_at, big);
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            values_at += bytes.len() as u64;
            values.extend(bytes);
        }
    }
    push_word(&mut front, next, big);
    front.resize(front.len() + padding, 0);
    front.extend(values);
    front
}

/// The header, directly followed by the first directory.
fn header(big: bool) -> Vec<u8> {
    let mut front = Vec::from(*b"II");
    if big {
        for short in [43_u16, 8, 0] {
            front.extend(short.to_le_bytes());
        }
        front.extend(16_u64.to_le_bytes());
    } else {
        front.extend(42_u16.to_le_bytes());
        front.extend(8_u32.to_le_bytes());
    }
    front
}

fn push_word(bytes: &mut Vec<u8>, value: u64, big: bool) {
    if big {
        bytes.extend(value.to_le_bytes());
    } else {
        bytes.extend((value as u32).to_le_bytes());
    }
}
