//! Thousands of simulated flights.

mod faults;

use super::plan::wrong_call;
use crate::cli::{Campaign as Args, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_pipeline::Progress;
use mavsight_score::{Campaign, CellSummary, ScoreError};
use mavsight_session::{RESULTS_SCHEMA, make_folder, write_json, write_whole};
use serde_json::json;
use std::time::Instant;

pub(crate) fn campaign(args: &Args) -> Result<()> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    let Some(file) = &args.campaign else { return faults::campaign(args) };
    let campaign = Campaign::load(file).map_err(|e| match e {
        ScoreError::Campaign { .. } => WrongCall(format!("{}: {e}", file.display())).into(),
        ScoreError::Session(e) => WrongCall(e.to_string()).into(),
        ScoreError::Plan(e) => wrong_call(e),
        other => anyhow::Error::new(other),
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
    write_json(&args.out.join("summary.json"), &json)?;
    outln!(
        "{} flights, {fresh} of them flown now in {seconds:.2} s: {:.0} a second\n",
        campaign.flights(),
        fresh as f64 / seconds.max(1e-9)
    );
    out!("{}", text(&summary));
    if summary.iter().all(|c| c.flights == 0) {
        anyhow::bail!(
            "no flight of {} could be solved: look at noise, rooms and manoeuvres",
            campaign.flights()
        );
    }
    outln!("\nResults: {}", args.out.display());
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
