//! [`Assembly`]: the last step of a build, when all tiles are finished. It makes the imagery layer,
//! metadata and statistics, and lets the writer put the file together.

use std::time::Instant;

use super::imagery::{self, Imagery};
use super::metadata::metadata;
use super::options::BuildOptions;
use super::plan::Plan;
use super::report::Report;
use super::run::Done;
use super::{odd, outcome};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::source::SourceInfo;

/// What a file is made of beside its tiles.
pub struct Assembly<'a> {
    /// What the raster says of itself.
    pub info: &'a SourceInfo,
    /// The plan of the build.
    pub plan: &'a Plan,
    /// What the build was asked for.
    pub options: &'a BuildOptions,
    /// The imagery layer, which is made here.
    pub imagery: Option<&'a Imagery<'a>>,
    /// Hears how far it is.
    pub progress: &'a dyn Progress,
    /// When the build began.
    pub start: Instant,
}

impl Assembly<'_> {
    /// Puts the file together.
    pub fn finish(self, done: Done) -> Result<Report> {
        let Self { info, plan, options, imagery, progress, start } = self;
        let Done { mut writer, statistics, .. } = done;
        if writer.tile_count() == 0 {
            writer.store_mut().folder_mut().discard();
            return Err(all_void(info, plan));
        }
        let header = plan.header(info, writer.tile_count());
        let [all, rest] = statistics.values();
        let mut warnings = info.warnings.clone();
        warnings.extend(odd::warnings(all, rest, plan, info, &header));
        if let Err(error) = outcome::check_warnings(&warnings, options.strict) {
            writer.store_mut().folder_mut().discard();
            return Err(error);
        }
        let statistics = statistics.statistics(&header);
        outcome::check_heights(info, &statistics)?;
        let mut metadata = metadata(info, options, plan.recipe.nodata, &statistics);
        let mut layer_report = None;
        if let Some(imagery) = imagery {
            let layer = imagery::layer(imagery, &plan.ground(), writer.store().folder().folder(), progress)?;
            layer_report = Some(layer.report());
            metadata.imagery = Some(layer.note);
            writer.attach(layer.sections);
        }
        let file = writer.finish_while(&header, &metadata, &statistics, &outcome::inspect, progress)?;
        let origins = info.origins.texts();
        Ok(Report {
            header,
            statistics,
            file,
            imagery: layer_report,
            warnings,
            origins,
            elapsed: start.elapsed(),
        })
    }
}

fn all_void(info: &SourceInfo, plan: &Plan) -> Error {
    let nodata = plan.recipe.nodata.value().map_or_else(|| "none".to_owned(), |v| info.sample_type.text(v));
    Error::format(
        "elevation band",
        "at least one valid sample",
        format!(
            "{} x {} samples that are all void (nodata value: {nodata}); if that value is wrong, give `nodata`",
            info.width, info.height
        ),
    )
}
