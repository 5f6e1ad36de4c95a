//! One imagery tile's bytes: texels <-> a chunk of colour and a chunk of alpha (`format-spec.md`,
//! section 16.3).
//!
//! All tiles of a layer have one [`Form`]. The *prefix* that all JPEG tiles share (quantisation and
//! Huffman tables, size) is stored once, in the header of the layer; a chunk is the entropy-coded
//! data alone. Encoders are deterministic, whatever the machine and the thread.
//!
//! Decoders are total: any bytes give an error or texels, and the size is compared with that of the
//! form before anything is allocated.

#[cfg(feature = "imagery")]
mod alpha;
#[cfg(feature = "imagery")]
mod block;
mod huffman;
mod jpeg;
#[cfg(feature = "imagery")]
mod jpeg_texels;
#[cfg(feature = "imagery")]
mod lossless;
#[cfg(all(test, feature = "imagery"))]
mod tests;

use std::fmt;
use std::str::FromStr;

use crate::codec::frame;
use crate::error::{Error, Result};
use crate::texel::Colour;
#[cfg(feature = "imagery")]
use crate::texel::Texels;

pub use huffman::Histograms;
pub use jpeg::{JpegTables, MAX_PREFIX};

/// How the texels of a tile are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Codec {
    /// Baseline JPEG, lossy; alpha apart and lossless.
    #[default]
    Jpeg = 1,
    /// Lossless WebP.
    Webp = 2,
    /// PNG.
    Png = 3,
    /// BC7 blocks for the GPU, packed by zstd; 8 bits a texel there. Alpha is in the blocks, and
    /// lossless beside them.
    Bc7 = 4,
    /// BC1 blocks for the GPU, packed by zstd; 4 bits a texel there; alpha apart and lossless.
    Bc1 = 5,
}

impl Codec {
    /// All codecs, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::Jpeg, Self::Webp, Self::Png, Self::Bc7, Self::Bc1];

    /// The codec of a number in a file.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&codec| codec as u8 == number)
    }

    /// The name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Jpeg => "jpeg",
            Self::Webp => "webp",
            Self::Png => "png",
            Self::Bc7 => "bc7",
            Self::Bc1 => "bc1",
        }
    }

    /// True if colours are stored without loss; alpha always is.
    pub fn is_lossless(self) -> bool {
        matches!(self, Self::Webp | Self::Png)
    }

    /// Bytes of a 4 x 4 block of a GPU format.
    pub fn block_bytes(self) -> Option<usize> {
        match self {
            Self::Bc7 => Some(16),
            Self::Bc1 => Some(8),
            _ => None,
        }
    }

    /// True if the colour chunk has the alpha in it.
    pub fn carries_alpha(self) -> bool {
        matches!(self, Self::Webp | Self::Png)
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Codec {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|codec| codec.as_str() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::as_str).join(", ");
            Error::usage(format!("there is no imagery codec {name:?}; use one of {names}"))
        })
    }
}

/// The properties that all tiles of a layer share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// How they are stored.
    pub codec: Codec,
    /// Quality of a JPEG, 1..=100; 0 for other codecs.
    pub quality: u8,
    /// The colour type of a texel.
    pub colour: Colour,
    /// Texels along a side, gutters included: a multiple of 4, at most 8192.
    pub side: usize,
}

impl Form {
    /// Bytes that a chunk may have at most: enough for any image.
    pub fn max_chunk_bytes(&self) -> u64 {
        8 * (self.side as u64).pow(2) + 65_536
    }
}

/// The chunks of a tile.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImageryChunks {
    /// Colour; never empty. Of a JPEG, the entropy-coded data, with the tables of [`jpeg_tables`].
    pub colour: Vec<u8>,
    /// Alpha, lossless, if the codec does not carry it with the colour and the tile is not opaque.
    pub alpha: Vec<u8>,
    /// True if some texel is not opaque. In chunks that were read: true if there is an alpha chunk.
    pub clear: bool,
}

/// Encodes a tile. If all texels are opaque, no alpha is stored.
#[cfg(all(feature = "imagery", feature = "write"))]
pub fn encode(form: &Form, texels: &Texels) -> Result<ImageryChunks> {
    check(form, texels)?;
    let opaque = |alpha: &&Vec<u8>| alpha.iter().any(|&a| a != 255);
    let alpha = texels.alpha.as_ref().filter(opaque).map(Vec::as_slice);
    let colour = match form.codec {
        Codec::Jpeg => jpeg_texels::encode(form, &texels.colour)?,
        Codec::Webp => lossless::encode_webp(form, &texels.colour, alpha)?,
        Codec::Png => lossless::encode_png(form, &texels.colour, alpha)?,
        Codec::Bc7 | Codec::Bc1 => block::encode(form, &texels.colour, alpha)?,
    };
    let clear = alpha.is_some();
    let alpha = match alpha {
        Some(alpha) if !form.codec.carries_alpha() => alpha::encode(form.side, alpha)?,
        _ => Vec::new(),
    };
    Ok(ImageryChunks { colour, alpha, clear })
}

/// Fails unless the texels have the form.
#[cfg(feature = "imagery")]
fn check(form: &Form, texels: &Texels) -> Result<()> {
    let (side, count) = (form.side, form.side * form.side);
    let lengths = (texels.colour.len(), texels.alpha.as_ref().map_or(count, Vec::len));
    if (texels.side, texels.kind) == (side, form.colour) && lengths == (count * form.colour.channels(), count)
    {
        return Ok(());
    }
    Err(Error::usage(format!("an imagery tile of {0} x {0} texels came to a layer of {side}", texels.side)))
}

/// The JPEG tables that [`encode`] uses; `None` for other codecs.
#[cfg(feature = "imagery")]
pub fn jpeg_tables(form: &Form) -> Result<Option<JpegTables>> {
    (form.codec == Codec::Jpeg).then(|| jpeg_texels::standard_tables(form)).transpose()
}

/// Decodes a tile. `tables` are those of the layer if it is of JPEGs.
#[cfg(feature = "imagery")]
pub fn decode(form: &Form, tables: Option<&JpegTables>, colour: &[u8], alpha: &[u8]) -> Result<Texels> {
    let (bytes, carried) = match (form.codec, tables) {
        (Codec::Jpeg, Some(tables)) => (jpeg_texels::decode(form, tables, colour)?, None),
        (Codec::Jpeg, None) => return Err(Error::format("imagery header", "JPEG tables", "none")),
        (Codec::Webp, _) => lossless::decode_webp(form, colour)?,
        (Codec::Png, _) => lossless::decode_png(form, colour)?,
        (Codec::Bc7 | Codec::Bc1, _) => (block::decode(form, colour)?, None),
    };
    let apart = if alpha.is_empty() { None } else { Some(alpha::decode(form.side, alpha)?) };
    if form.codec.carries_alpha() && apart.is_some() {
        return Err(Error::format("alpha chunk", "none, for the colour carries it", "one"));
    }
    Ok(Texels { side: form.side, kind: form.colour, colour: bytes, alpha: carried.or(apart) })
}

/// Bytes of the blocks of a tile.
fn content_bytes(form: &Form) -> Result<usize> {
    let not = || Error::usage(format!("codec {} has no blocks for a graphics card", form.codec));
    Ok((form.side / 4).pow(2) * form.codec.block_bytes().ok_or_else(not)?)
}

/// The GPU blocks of a tile, row by row from the north-west, as a graphics card takes them. Fails
/// for other codecs.
pub fn unpack_blocks(form: &Form, chunk: &[u8]) -> Result<Vec<u8>> {
    let bytes = content_bytes(form)?;
    let mut blocks = Vec::new();
    frame::decompress(chunk, bytes..=bytes, "colour chunk", &mut blocks)?;
    Ok(blocks)
}

/// The colour, of one or three channels, of pixels of `stride` bytes, red first.
#[cfg(feature = "imagery")]
fn take_colour(pixels: &[u8], stride: usize, colour: Colour) -> Vec<u8> {
    match colour {
        // Grey is the middle channel: in blocks of 5, 6 and 5 bits the one with 6.
        Colour::Grey => pixels.chunks_exact(stride).map(|pixel| pixel[(stride - 1).min(1)]).collect(),
        Colour::Rgb => pixels.chunks_exact(stride).flat_map(|p| [p[0], p[1], p[2]]).collect(),
    }
}
