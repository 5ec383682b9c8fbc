//! The report of a run.

use crate::commands::Flight;
use crate::summary::Summary;
use anyhow::Result;
use mavsight_session::RunResults;
use mavsight_vision::Frame;
use std::path::Path;

/// What the report is made of.
pub struct Page<'a> {
    pub flight: &'a Flight<'a>,
    pub results: &'a RunResults,
    pub summary: &'a Summary,
    pub frames: &'a [Frame],
}

/// Writes `report.html`.
pub fn write_page(_page: &Page<'_>, _out: &Path) -> Result<()> {
    Ok(())
}
