//! Thousands of simulated flights.

use super::demo::scenario_of;
use super::named;
use super::plan::planner_of;
use crate::cli::{Campaign as Args, WrongCall};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_flight::{Scenario, Vehicle};
use mavsight_pipeline::Progress;
use mavsight_plan::Planner;
use mavsight_score::{Campaign, CampaignFile, CellSummary, ScoreError, Sources};
use mavsight_session::{RESULTS_SCHEMA, make_folder, read_toml, write_whole};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Files named in a campaign, relative to it.
struct Files(PathBuf);

fn refused(path: &Path, error: &anyhow::Error) -> ScoreError {
    ScoreError::Campaign { key: path.display().to_string(), detail: format!("{error:#}") }
}

impl Sources for Files {
    fn planner(&self, path: &Path) -> Result<(Planner, Vehicle), ScoreError> {
        planner_of(&self.0.join(path)).map_err(|e| refused(path, &e))
    }

    fn scenario(&self, path: &Path) -> Result<Scenario, ScoreError> {
        scenario_of(Some(&self.0.join(path))).map_err(|e| refused(path, &e))
    }
}

/// `mavsight campaign`
pub(crate) fn campaign(args: &Args) -> Result<()> {
    let file: CampaignFile = named(read_toml(&args.campaign, "campaign file"))?;
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    let folder = args.campaign.parent().unwrap_or(Path::new("")).to_owned();
    let campaign = Campaign::new(file, &Files(folder)).map_err(|e| match e {
        ScoreError::Campaign { .. } => {
            anyhow::Error::new(WrongCall(format!("{}: {e}", args.campaign.display())))
        }
        other => other.into(),
    })?;
    make_folder(&args.out)?;
    let bars = Bars::new();
    bars.start("flying", Some(campaign.flights()));
    let begin = Instant::now();
    let fresh = std::sync::atomic::AtomicU64::new(0);
    let table = campaign.run(&args.out.join("flights.part"), &|flights| {
        fresh.fetch_add(flights, std::sync::atomic::Ordering::Relaxed);
        (0..flights).for_each(|_| bars.step());
    })?;
    bars.done();
    let (seconds, fresh) = (begin.elapsed().as_secs_f64(), fresh.into_inner());
    write_whole(&args.out.join("flights.csv"), table.as_bytes())?;
    let summary = campaign.summary(&table);
    let json = json!({ "schema": RESULTS_SCHEMA, "flights": campaign.flights(), "cells": summary });
    write_whole(&args.out.join("summary.json"), serde_json::to_string_pretty(&json)?.as_bytes())?;
    println!(
        "{} flights, {fresh} of them flown now in {seconds:.2} s: {:.0} a second\n",
        campaign.flights(),
        fresh as f64 / seconds.max(1e-9)
    );
    print!("{}", text(&summary));
    println!("\nResults: {}", args.out.display());
    Ok(())
}

fn text(summary: &[CellSummary]) -> String {
    let mut out = String::new();
    let mut before: Option<&[String; 3]> = None;
    for c in summary {
        if before != Some(&c.cell) {
            out += &format!("{}, {}, {}: {} flights\n", c.cell[0], c.cell[1], c.cell[2], c.flights);
            out += &format!(
                "  {:<14} {:>12} {:>12} {:>12} {:>9} {:>9}\n",
                "parameter", "truth", "predicted", "achieved", "ratio", "inside %"
            );
            before = Some(&c.cell);
        }
        out += &format!(
            "  {:<14} {:>12.4e} {:>12.4e} {:>12.4e} {:>9.3} {:>9.1}\n",
            c.parameter,
            c.truth,
            c.predicted_std,
            c.achieved_std,
            c.predicted_std / c.achieved_std,
            100.0 * c.inside
        );
    }
    out
}
