//! Pictures over the heights: the arguments that `build` and `add` share.

use std::path::PathBuf;

use relevo::Error;
use relevo::geo::Crs;
use relevo::imagery::Resolution;
use relevo::limits::Limits;
use relevo::source::picture::{self, Picture, PictureOptions, Stretch};

use crate::cli::warnings::{refuse, say, told};

/// Pictures, how they are read and how their tiles are stored.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Imagery")]
pub struct Imagery {
    /// Pictures to lay over the heights, of which the last lies on top: TIFF, PNG, JPEG and WebP
    /// files (any rasters of GDAL's if built with --features gdal)
    #[arg(long = "imagery", id = "imagery", value_name = "FILE", num_args = 1..)]
    pub files: Vec<PathBuf>,
    /// Texels along the side of an imagery tile: a multiple of 4, 64 to 4096
    #[arg(long = "imagery-tile", id = "imagery-tile", value_name = "N", default_value_t = 512)]
    pub tile: u32,
    /// Bands that become grey, or red, green and blue, and one more for alpha, counted from 1
    /// [default: as the file says]
    #[arg(long = "imagery-bands", id = "imagery-bands", value_name = "R,G,B[,A]", value_delimiter = ',')]
    pub bands: Option<Vec<u32>>,
    /// How samples become 8 bits: none, minmax, percent:LOW,HIGH or range:MIN,MAX [default:
    /// percent:2,98 for samples wider than 8 bits]
    #[arg(long = "imagery-stretch", id = "imagery-stretch", value_name = "RULE", value_parser = stretch)]
    pub stretch: Option<Stretch>,
    /// Level of a picture: the one with texels nearest to its pixels in size, or the next finer or
    /// coarser one
    #[arg(long = "imagery-resolution", id = "imagery-resolution", value_name = "closest|finer|coarser", default_value = "closest", value_parser = resolution)]
    pub resolution: Resolution,
    /// How imagery tiles are stored
    #[arg(long = "imagery-codec", id = "imagery-codec", value_name = "CODEC", default_value = "jpeg", value_parser = ["jpeg", "webp", "png", "bc7", "bc1"])]
    pub codec: String,
    /// Quality of a lossy codec, 1 to 100
    #[arg(long = "imagery-quality", id = "imagery-quality", value_name = "Q", default_value_t = 85, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub quality: u8,
}

impl Imagery {
    /// Opens the pictures, which become one mosaic in the coordinate system of the heights, within
    /// so many bytes of memory; says what is to be warned of, and fails of it if `is_strict`.
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
            pictures.iter().flat_map(|picture| told(&picture.info().warnings)).collect();
        say(&warnings);
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
