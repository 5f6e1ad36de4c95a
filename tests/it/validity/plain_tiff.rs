//! TIFFs written tag by tag, uncompressed, with what the writer of the library has no words for.

use std::fs;
use std::path::Path;

/// Type of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    U8,
    U16,
    I16,
    I32,
    F32,
    F64,
}

impl Kind {
    /// Bytes, and TIFF's number of the format.
    fn shape(self) -> (u32, u32) {
        match self {
            Self::U8 => (1, 1),
            Self::U16 => (2, 1),
            Self::I16 => (2, 2),
            Self::I32 => (4, 2),
            Self::F32 => (4, 3),
            Self::F64 => (8, 3),
        }
    }

    fn bytes(self, value: f64) -> Vec<u8> {
        match self {
            Self::U8 => vec![value as u8],
            Self::U16 => (value as u16).to_le_bytes().to_vec(),
            Self::I16 => (value as i16).to_le_bytes().to_vec(),
            Self::I32 => (value as i32).to_le_bytes().to_vec(),
            Self::F32 => (value as f32).to_le_bytes().to_vec(),
            Self::F64 => value.to_le_bytes().to_vec(),
        }
    }
}

/// A file to be written.
#[derive(Clone, Debug)]
pub struct Tiff {
    pub size: (u32, u32),
    pub kind: Kind,
    pub bands: Vec<Vec<f64>>,
    /// Bands lie apart.
    pub planar: bool,
    pub photometric: u32,
    /// Tag 338.
    pub extra: Vec<u32>,
    /// Tag 320, three times 256 numbers.
    pub palette: bool,
    /// Tag 42113.
    pub nodata: Option<String>,
    /// Tag 42112.
    pub metadata: Option<String>,
    /// A mask in the file, of bytes.
    pub mask: Option<Vec<bool>>,
    /// North-west corner and pixel in EPSG:4326.
    pub place: Option<[f64; 3]>,
}

impl Tiff {
    pub fn new(size: (u32, u32), kind: Kind, bands: Vec<Vec<f64>>) -> Self {
        let (planar, palette) = (false, false);
        let (nodata, metadata, mask, place) = (None, None, None, None);
        Self {
            size,
            kind,
            bands,
            planar,
            photometric: 1,
            extra: Vec::new(),
            palette,
            nodata,
            metadata,
            mask,
            place,
        }
    }

    /// Samples as they lie in the file, plane by plane.
    fn planes(&self) -> Vec<Vec<u8>> {
        let each = |value: &f64| self.kind.bytes(*value);
        if self.planar {
            return self.bands.iter().map(|band| band.iter().flat_map(each).collect()).collect();
        }
        let pixel = |at: usize| self.bands.iter().flat_map(move |band| self.kind.bytes(band[at]));
        vec![(0..self.bands[0].len()).flat_map(pixel).collect()]
    }

    pub fn write(&self, path: &Path) {
        let (size, format) = self.kind.shape();
        let count = self.bands.len();
        let mut file = b"II*\0\0\0\0\0".to_vec();
        let blocks = append(&mut file, self.planes());
        let shorts = |value: u32| (3, vec![value; count]);
        let mut tags =
            vec![(258, shorts(8 * size)), (262, (3, vec![self.photometric])), (277, (3, vec![count as u32]))];
        tags.push((284, (3, vec![if self.planar { 2 } else { 1 }])));
        tags.push((339, shorts(format)));
        if !self.extra.is_empty() {
            tags.push((338, (3, self.extra.clone())));
        }
        if self.palette {
            tags.push((320, (3, vec![0x1234; 768])));
        }
        let mut texts = Vec::new();
        texts.extend(self.metadata.as_ref().map(|text| (42112, text)));
        texts.extend(self.nodata.as_ref().map(|text| (42113, text)));
        for (tag, text) in texts {
            tags.push((tag, (2, text.bytes().chain([0]).map(u32::from).collect())));
        }
        let mut doubles = Vec::new();
        if let Some([x, y, step]) = self.place {
            doubles.push((33550, vec![step, step, 0.0]));
            doubles.push((33922, vec![0.0, 0.0, 0.0, x, y, 0.0]));
            tags.push((34735, (3, vec![1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326])));
        }
        let link = self.directory(&mut file, tags, &doubles, &blocks, 4);
        if let Some(mask) = &self.mask {
            let bytes = mask.iter().map(|&valid| u8::from(valid) * 255).collect();
            let blocks = append(&mut file, vec![bytes]);
            let one = |value: u32| (3, vec![value]);
            let tags = vec![(254, (4, vec![4])), (258, one(8)), (262, one(4)), (277, one(1))];
            self.directory(&mut file, tags, &[], &blocks, link);
        }
        fs::write(path, file).expect("write");
    }

    /// Appends a directory and puts its place where `link` is; gives the place of its own link.
    fn directory(
        &self,
        file: &mut Vec<u8>,
        mut tags: Vec<(u32, (u32, Vec<u32>))>,
        doubles: &[(u32, Vec<f64>)],
        blocks: &[(u32, u32)],
        link: usize,
    ) -> usize {
        tags.push((256, (4, vec![self.size.0])));
        tags.push((257, (4, vec![self.size.1])));
        tags.push((259, (3, vec![1])));
        tags.push((273, (4, blocks.iter().map(|block| block.0).collect())));
        tags.push((278, (4, vec![self.size.1])));
        tags.push((279, (4, blocks.iter().map(|block| block.1).collect())));
        let mut all: Vec<(u32, u32, usize, Vec<u8>)> = Vec::new();
        for (tag, (kind, values)) in tags {
            let width = match kind {
                2 => 1,
                3 => 2,
                _ => 4,
            };
            let bytes = values.iter().flat_map(|value| value.to_le_bytes()[..width].to_vec()).collect();
            all.push((tag, kind, values.len(), bytes));
        }
        for (tag, values) in doubles {
            all.push((*tag, 12, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect()));
        }
        all.sort_by_key(|entry| entry.0);
        // Values first, then the directory.
        let mut entries = (all.len() as u16).to_le_bytes().to_vec();
        for (tag, kind, count, mut bytes) in all {
            entries.extend((tag as u16).to_le_bytes());
            entries.extend((kind as u16).to_le_bytes());
            entries.extend((count as u32).to_le_bytes());
            if bytes.len() > 4 {
                file.resize(file.len().next_multiple_of(2), 0);
                let place = file.len() as u32;
                file.append(&mut bytes);
                bytes = place.to_le_bytes().to_vec();
            }
            bytes.resize(4, 0);
            entries.extend(bytes);
        }
        file.resize(file.len().next_multiple_of(2), 0);
        let place = file.len();
        file[link..link + 4].copy_from_slice(&(place as u32).to_le_bytes());
        file.extend(&entries);
        file.extend([0; 4]);
        place + entries.len()
    }
}

/// Appends blocks; gives their places and lengths.
fn append(file: &mut Vec<u8>, blocks: Vec<Vec<u8>>) -> Vec<(u32, u32)> {
    let mut places = Vec::new();
    for mut block in blocks {
        file.resize(file.len().next_multiple_of(8), 0);
        places.push((file.len() as u32, block.len() as u32));
        file.append(&mut block);
    }
    places
}
