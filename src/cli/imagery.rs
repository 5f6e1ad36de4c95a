//! Arguments that `build` and `add` share: pictures to lay over the heights.

use std::path::PathBuf;

use relevo::Error;
use relevo::geo::Crs;
use relevo::imagery::Resolution;
use relevo::limits::Limits;
use relevo::source::picture::{self, Picture, PictureOptions, Stretch};

use crate::cli::warnings::{print_warnings, refuse, with_options};

/// The pictures, and how they are read and stored.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Imagery")]
pub struct Imagery {
    /// Lay these pictures over the heights, the last on top: TIFF, PNG, JPEG or WebP (with GDAL
    /// built in, any raster that it reads)
    #[arg(long = "imagery", id = "imagery", value_name = "FILE", num_args = 1..)]
    pub files: Vec<PathBuf>,
    /// Make imagery tiles with this many texels along a side: a multiple of 4, 64 to 4096
    #[arg(long = "imagery-tile", id = "imagery-tile", value_name = "N", default_value_t = 512)]
    pub tile: u32,
    /// Take these bands, counted from 1, as grey, or as red, green and blue; one more is alpha
    /// [default: as the file says]
    #[arg(long = "imagery-bands", id = "imagery-bands", value_name = "R,G,B[,A]", value_delimiter = ',')]
    pub bands: Option<Vec<u32>>,
    /// Turn samples into 8 bits by this rule: none, minmax, percent:LOW,HIGH or range:MIN,MAX
    /// [default: percent:2,98 for samples wider than 8 bits]
    #[arg(long = "imagery-stretch", id = "imagery-stretch", value_name = "RULE", value_parser = stretch)]
    pub stretch: Option<Stretch>,
    /// Store a picture at the level whose texels are closest to its pixels in size, or at the next
    /// finer or coarser one
    #[arg(long = "imagery-resolution", id = "imagery-resolution", value_name = "closest|finer|coarser", default_value = "closest", value_parser = resolution)]
    pub resolution: Resolution,
    /// Store imagery tiles in this codec
    #[arg(long = "imagery-codec", id = "imagery-codec", value_name = "CODEC", default_value = "jpeg", value_parser = ["jpeg", "webp", "png", "bc7", "bc1"])]
    pub codec: String,
    /// Set the quality of a lossy codec, 1 to 100
    #[arg(long = "imagery-quality", id = "imagery-quality", value_name = "Q", default_value_t = 85, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub quality: u8,
}

impl Imagery {
    /// Opens the pictures as one mosaic in the coordinate system of the heights, within `memory`
    /// bytes. Prints their warnings, and fails if there are any and `is_strict` is set.
    pub fn open(
        &self,
        crs: &Crs,
        memory: Option<u64>,
        is_strict: bool,
    ) -> Result<Vec<Box<dyn Picture>>, Error> {
        let options = PictureOptions { bands: self.bands.clone(), stretch: self.stretch };
        let mut limits = Limits::default();
        limits.opening_bytes = memory.unwrap_or(u64::MAX);
        let pictures = picture::open_all(&self.files, &options, crs, &limits)?;
        let warnings: Vec<String> =
            pictures.iter().flat_map(|picture| with_options(&picture.info().warnings)).collect();
        print_warnings(&warnings);
        refuse(&warnings, is_strict)?;
        Ok(pictures)
    }
}

fn resolution(word: &str) -> Result<Resolution, String> {
    match word {
        "closest" => Ok(Resolution::Closest),
        "finer" => Ok(Resolution::Finer),
        "coarser" => Ok(Resolution::Coarser),
        _ => Err("expected closest, finer or coarser".to_owned()),
    }
}

fn stretch(text: &str) -> Result<Stretch, String> {
    let (rule, numbers) = text.split_once(':').unwrap_or((text, ""));
    let pair = || {
        let (low, high) = numbers.split_once(',').ok_or("expected two numbers, as in percent:2,98")?;
        let number = |word: &str| word.trim().parse::<f64>().map_err(|_| format!("{word} is not a number"));
        Ok::<_, String>((number(low)?, number(high)?))
    };
    match rule {
        "none" => Ok(Stretch::None),
        "minmax" => Ok(Stretch::MinMax),
        "percent" => pair().map(|(low, high)| Stretch::Percent(low, high)),
        "range" => pair().map(|(low, high)| Stretch::Range(low, high)),
        _ => Err("expected none, minmax, percent:LOW,HIGH or range:MIN,MAX".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        imagery: Imagery,
    }

    #[test]
    fn a_line_of_options() {
        let line = "x --imagery a.tif b.tif --imagery-bands 4,3,2 --imagery-stretch percent:1,99.5 --imagery-resolution finer";
        let imagery = Line::try_parse_from(line.split(' ')).expect("good").imagery;
        assert_eq!((imagery.files.len(), imagery.bands), (2, Some(vec![4, 3, 2])));
        assert_eq!(
            (imagery.stretch, imagery.resolution),
            (Some(Stretch::Percent(1.0, 99.5)), Resolution::Finer)
        );
        assert_eq!((imagery.tile, &*imagery.codec, imagery.quality), (512, "jpeg", 85));
        assert_eq!(stretch("range:-5,1e3"), Ok(Stretch::Range(-5.0, 1000.0)));
        for wrong in ["percent", "range:1", "percent:a,b", "linear"] {
            assert!(stretch(wrong).is_err(), "{wrong}");
        }
        assert!(Line::try_parse_from(["x", "--imagery"]).is_err());
        assert!(Line::try_parse_from(["x", "--imagery-quality", "0"]).is_err());
    }
}
