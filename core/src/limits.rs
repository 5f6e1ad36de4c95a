//! Limits of what this program accepts: numbers from a file are checked against them before they
//! are used.

/// Limits of a reader. Real data stays below the defaults, and any machine can bear them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Columns or rows of a source raster (2^30).
    pub raster_side: u64,
    /// Bytes of one decoded TIFF strip or tile (1 GiB).
    pub block_bytes: u64,
    /// Bytes of a GDAL virtual raster (64 MiB).
    pub vrt_bytes: u64,
    /// Files of a mosaic, those of VRTs within it included (131 072).
    pub mosaic_files: u64,
    /// Values of a TIFF tag, or bytes of a text tag (16 Mi).
    pub tag_entries: u64,
    /// Bytes of the content of a gzipped raster (64 GiB).
    pub unpacked_bytes: u64,
    /// Bytes of the metadata section of a container, decoded (64 MiB).
    pub metadata_bytes: u64,
    /// Bytes of one index page, decoded (1 MiB).
    pub page_bytes: u64,
    /// Bytes of the statistics section, decoded (64 MiB).
    pub statistics_bytes: u64,
    /// Bytes of memory that opening pictures may take (no limit).
    pub opening_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            raster_side: 1 << 30,
            block_bytes: 1 << 30,
            vrt_bytes: 64 << 20,
            mosaic_files: 1 << 17,
            tag_entries: 16 << 20,
            unpacked_bytes: 64 << 30,
            metadata_bytes: 64 << 20,
            page_bytes: 1 << 20,
            statistics_bytes: 64 << 20,
            opening_bytes: u64::MAX,
        }
    }
}
