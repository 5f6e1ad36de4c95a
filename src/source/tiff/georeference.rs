//! The georeference and other properties in the tags of a TIFF, by GDAL's rules.

use tiff::tags::Tag;

use super::directory::{Directory, GDAL_METADATA, Reader};
use crate::crs::geokeys;
use crate::error::Result;
use crate::geo::GeoKeys;
use crate::source::account::Tags;

/// The tags about place, coordinate system and heights.
pub(super) fn read(reader: &mut Reader<'_>, image: &Directory) -> Result<Tags> {
    let keys = GeoKeys {
        directory: reader
            .integers(image, Tag::GeoKeyDirectoryTag)?
            .unwrap_or_default()
            .into_iter()
            .map(|value| u16::try_from(value).unwrap_or(0))
            .collect(),
        doubles: reader.doubles(image, Tag::GeoDoubleParamsTag)?.unwrap_or_default(),
        ascii: reader.text(image, Tag::GeoAsciiParamsTag)?.unwrap_or_default(),
    };
    let has_keys = !keys.directory.is_empty();
    // A feature of GeoTIFF 1.1. In older files GDAL ignores vertical systems except for their unit.
    let has_heights = keys.directory.get(..3).is_some_and(|head| head[..2] == [1, 1] && head[2] >= 1);
    let reference = geokeys::read(keys);
    let scale = reader.doubles(image, Tag::ModelPixelScaleTag)?.unwrap_or_default();
    let ties = reader.doubles(image, Tag::ModelTiepointTag)?.unwrap_or_default();
    let matrix = reader.doubles(image, Tag::ModelTransformationTag)?.unwrap_or_default();
    let transform = transform(&scale, &ties, &matrix, reference.pixel_is_point);
    let vertical = reference.vertical_unit.as_ref().filter(|_| has_heights);
    Ok(Tags {
        transform,
        control_points: transform.is_none() && ties.len() >= 6,
        has_keys,
        scale_offset: vertical.and_then(|_| scale_offset(&scale, &ties)),
        crs: reference.crs,
        pixel_is_point: reference.pixel_is_point,
        vertical_unit: reference.vertical_unit,
        nodata: reader.text(image, Tag::GdalNodata)?,
        metadata: reader.text(image, GDAL_METADATA)?,
        warnings: reference.warnings,
    })
}

/// The geotransform as GDAL computes it. Pixel scale wins over the matrix, only the first tie point
/// counts, and a negative y scale is taken for a mistake: GDAL reads such files north up. Tie
/// points without a scale are control points.
fn transform(scale: &[f64], ties: &[f64], matrix: &[f64], pixel_is_point: bool) -> Option<([f64; 6], u16)> {
    let (mut found, tag) = match (scale, ties, matrix) {
        (&[sx, sy, ..], _, _) if sx != 0.0 && sy != 0.0 => {
            let &[i, j, _, x, y, ..] = ties else { return None };
            ([x - i * sx, sx, 0.0, y + j * sy.abs(), 0.0, -sy.abs()], Tag::ModelPixelScaleTag)
        }
        (_, _, &[a, b, _, x, d, e, _, y, ..]) if matrix.len() == 16 => {
            ([x, a, b, y, d, e], Tag::ModelTransformationTag)
        }
        _ => return None,
    };
    if pixel_is_point {
        found[0] -= found[1] * 0.5 + found[2] * 0.5;
        found[3] -= found[4] * 0.5 + found[5] * 0.5;
    }
    found.iter().all(|value| value.is_finite()).then_some((found, tag.to_u16()))
}

/// Scale and offset of heights, from the third dimension of pixel scale and tie point.
fn scale_offset(scale: &[f64], ties: &[f64]) -> Option<(f64, f64)> {
    let (&[_, _, sz, ..], &[_, _, k, _, _, z, ..]) = (scale, ties) else { return None };
    let both = (sz, z - k * sz);
    (sz != 0.0 && both.0.is_finite() && both.1.is_finite()).then_some(both)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tie_points_anywhere_and_pixels_as_points() {
        let ties = [10.0, 20.0, 0.0, 500.0, 900.0, 0.0];
        let area = transform(&[2.0, 3.0, 0.0], &ties, &[], false);
        assert_eq!(area, Some(([480.0, 2.0, 0.0, 960.0, 0.0, -3.0], 33550)));
        let point = transform(&[2.0, -3.0, 0.0], &ties, &[], true);
        assert_eq!(point, Some(([479.0, 2.0, 0.0, 961.5, 0.0, -3.0], 33550)));
    }

    #[test]
    fn matrix_only_without_scale() {
        let mut matrix = [0.0; 16];
        (matrix[0], matrix[1], matrix[3]) = (1.0, 0.5, 100.0);
        (matrix[4], matrix[5], matrix[7]) = (0.25, -1.0, 200.0);
        assert_eq!(transform(&[], &[], &matrix, false), Some(([100.0, 1.0, 0.5, 200.0, 0.25, -1.0], 34264)));
        assert_eq!(transform(&[], &[], &matrix, true), Some(([99.25, 1.0, 0.5, 200.375, 0.25, -1.0], 34264)));
        assert_eq!(transform(&[], &[0.0; 24], &[], false), None);
        assert_eq!(transform(&[1.0, 1.0], &[], &[], false), None);
        assert_eq!(transform(&[f64::NAN, 1.0], &[0.0; 6], &[], false), None);
    }
}
