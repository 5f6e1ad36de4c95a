//! Rasters of 4 x 3 float32 samples with any tags, written byte by byte, and files beside them.

use std::path::{Path, PathBuf};

/// Values of a tag.
pub enum Tag {
    Short(Vec<u16>),
    Double(Vec<f64>),
    Text(String),
}

/// A folder of its own with a raster in it.
pub struct Raster {
    folder: tempfile::TempDir,
    path: PathBuf,
}

/// What a raster is written with.
#[derive(Default)]
pub struct Spec {
    tags: Vec<(u16, Tag)>,
    picture: Option<Picture>,
}

/// Whole numbers instead of heights.
struct Picture {
    bits: u16,
    photometric: u16,
    /// Of each pixel its bands.
    samples: Vec<[u16; 4]>,
    bands: usize,
}

impl Spec {
    /// A tag.
    pub fn tag(mut self, number: u16, tag: Tag) -> Self {
        self.tags.push((number, tag));
        self
    }

    /// 12 pixels of some bands of 8 or 16 bits: sample `value(pixel, band)`.
    pub fn picture(
        mut self,
        bits: u16,
        bands: usize,
        photometric: u16,
        value: impl Fn(usize, usize) -> u16,
    ) -> Self {
        let samples = (0..12).map(|pixel| [0, 1, 2, 3].map(|band| value(pixel, band))).collect();
        self.picture = Some(Picture { bits, photometric, samples, bands });
        self
    }

    /// Pixel scale and tie point: the corner at (100, 200), steps of 2.
    pub fn placed(self) -> Self {
        let tie = vec![0.0, 0.0, 0.0, 100.0, 200.0, 0.0];
        self.tag(33550, Tag::Double(vec![2.0, 2.0, 0.0])).tag(33922, Tag::Double(tie))
    }

    /// GeoKeys of revision 1.`minor`: pairs of key and value.
    pub fn keys(self, minor: u16, keys: &[(u16, u16)]) -> Self {
        let mut directory = vec![1, 1, minor, keys.len() as u16];
        directory.extend(keys.iter().flat_map(|&(key, value)| [key, 0, 1, value]));
        self.tag(34735, Tag::Short(directory))
    }

    /// The keys of a projected system.
    pub fn projected(self, code: u16) -> Self {
        self.keys(1, &[(1024, 1), (1025, 1), (3072, code)])
    }

    /// Items of GDAL's metadata of the first band: role and value.
    pub fn items(self, items: &[(&str, &str)]) -> Self {
        let item = |(role, value): &(&str, &str)| {
            format!("<Item name=\"{role}\" sample=\"0\" role=\"{role}\">{value}</Item>")
        };
        let items: String = items.iter().map(item).collect();
        self.tag(42112, Tag::Text(format!("<GDALMetadata>{items}</GDALMetadata>")))
    }

    /// GDAL's nodata tag.
    pub fn nodata(self, text: &str) -> Self {
        self.tag(42113, Tag::Text(text.to_owned()))
    }

    /// Writes `dem.tif`.
    pub fn write(self) -> Raster {
        self.write_as("dem.tif")
    }

    /// Writes it under a name.
    pub fn write_as(self, name: &str) -> Raster {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join(name);
        std::fs::write(&path, self.bytes()).expect("write");
        Raster { folder, path }
    }

    fn bytes(self) -> Vec<u8> {
        let short = |value| Tag::Short(vec![value]);
        let mut out = b"II*\0\0\0\0\0".to_vec();
        let mut tags = self.tags;
        match self.picture {
            None => {
                (0..12_u8).for_each(|sample| out.extend(f32::from(sample).to_le_bytes()));
                tags.extend([(258, short(32)), (262, short(1)), (277, short(1)), (339, short(3))]);
            }
            Some(Picture { bits, photometric, samples, bands }) => {
                for sample in samples.iter().flat_map(|pixel| &pixel[..bands]) {
                    out.extend(&sample.to_le_bytes()[..usize::from(bits / 8)]);
                }
                let bits = Tag::Short(vec![bits; bands]);
                tags.extend([(258, bits), (262, short(photometric)), (277, short(bands as u16))]);
            }
        }
        tags.extend([(256, short(4)), (257, short(3)), (259, short(1))]);
        tags.extend([(273, short(8)), (278, short(3)), (279, short(out.len() as u16 - 8))]);
        tags.sort_by_key(|tag| tag.0);
        let mut entries = Vec::new();
        for (number, tag) in tags {
            let (kind, count, mut bytes) = match tag {
                Tag::Short(values) => {
                    (3_u16, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect())
                }
                Tag::Double(values) => {
                    (12, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect())
                }
                Tag::Text(text) => (2, text.len() + 1, [text.as_bytes(), &[0]].concat()),
            };
            if bytes.len() > 4 {
                let at = out.len() as u32;
                out.append(&mut bytes);
                out.resize(out.len().next_multiple_of(2), 0);
                bytes = at.to_le_bytes().to_vec();
            }
            bytes.resize(4, 0);
            entries.push(
                [&number.to_le_bytes()[..], &kind.to_le_bytes(), &(count as u32).to_le_bytes(), &bytes]
                    .concat(),
            );
        }
        let place = out.len() as u32;
        out[4..8].copy_from_slice(&place.to_le_bytes());
        out.extend((entries.len() as u16).to_le_bytes());
        out.extend(entries.concat());
        out.extend([0; 4]);
        out
    }
}

impl Raster {
    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts a file into its folder.
    pub fn with(self, name: &str, text: &str) -> Self {
        std::fs::write(self.folder.path().join(name), text).expect("write");
        self
    }

    /// Puts `.aux.xml` beside it: what stands in the dataset, and in its first band.
    pub fn aux(self, dataset: &str, band: &str) -> Self {
        let name = format!("{}.aux.xml", self.path.file_name().expect("name").to_string_lossy());
        let band = format!("<PAMRasterBand band=\"1\">{band}</PAMRasterBand>");
        self.with(&name, &format!("<PAMDataset>{dataset}{band}</PAMDataset>"))
    }
}
