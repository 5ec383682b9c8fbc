//! The whole pipeline on a recorded session.

use super::flights::{Fitted, distinct, heading, pool};
use super::{named, require_folder};
use crate::cli::Run;
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_engine::{Options, recorded_inputs};
use mavsight_report::{FlightReport, Summary, brief, write_report};
use mavsight_score::{Scores, score_identity, score_motion, score_poses, truth_of, visibility_of};
use mavsight_session::{RunResults, Session, results::names, write_results};
use mavsight_simulator::FlightState;
use std::path::Path;

pub(crate) fn run(args: &Run) -> Result<()> {
    require_folder(&args.out)?;
    if let [session] = args.sessions.as_slice() {
        return run_one(args, &named(Session::load(session))?, &args.out).map(drop);
    }
    let sessions = args.sessions.iter().map(|path| named(Session::load(path))).collect::<Result<Vec<_>>>()?;
    let names = distinct(sessions.iter().map(|s| s.file.name.clone()).collect());
    let mut fitted = Vec::new();
    for (session, name) in sessions.iter().zip(&names) {
        heading(name)?;
        fitted.push(Fitted::of(run_one(args, session, &args.out.join(name))?));
    }
    let title = sessions.first().map_or("", |s| s.vehicle.name.as_str());
    pool(title, &names, &fitted, Some(&args.out))
}

fn run_one(args: &Run, session: &Session, out: &Path) -> Result<RunResults> {
    require_folder(out)?;
    let (inputs, truth) = (recorded_inputs(session)?, named(truth_of(session))?);
    let bars = Bars::new();
    let options = Options {
        equation_error_only: args.equation_error_only,
        lag_s: args.lag,
        held_out_s: args.hold_out,
        search: args.search,
        results_folder: Some(out),
    };
    let mut results = mavsight_engine::run(session, &options, &bars)?;
    let mut scores = truth.as_deref().map(|t| scores_of(&results, t));
    if let (Some(scores), Some(truth), Some(visible)) =
        (scores.as_mut(), truth.as_deref(), named(visibility_of(session))?)
    {
        let markers = super::demo::markers_of(&session.vehicle);
        scores.identity = Some(score_identity(&results.poses, truth, &markers, &visible));
    }
    bars.done();
    let report = FlightReport {
        vehicle: &session.vehicle,
        inputs: inputs.as_ref(),
        truth: truth.as_deref(),
        session: Some(&session.path),
    };
    finish(&mut results, scores.as_ref(), &report, out, args.verbose)?;
    Ok(results)
}

pub(crate) fn scores_of(results: &RunResults, truth: &[FlightState]) -> Scores {
    Scores {
        poses: score_poses(&results.poses, truth),
        motion: results.motion.as_ref().and_then(|m| score_motion(m, truth)),
        ..Scores::default()
    }
}

/// Writes every result file and the report, and prints the summary: on one screen, or all figures, verdicts and notes.
pub(crate) fn finish(
    results: &mut RunResults,
    scores: Option<&Scores>,
    report: &FlightReport<'_>,
    out: &Path,
    is_verbose: bool,
) -> Result<()> {
    let summary = Summary::of(results, scores);
    results.summary = summary.json();
    write_results(out, results)?;
    remove_stale(results, out)?;
    write_report(report, results, &summary, out)?;
    if is_verbose {
        return print_summary(&summary, results, out);
    }
    out!("{}", brief(report.vehicle, results, &summary));
    outln!("\nResults: {} ({}; every figure with --verbose)", out.display(), names::REPORT);
    require_a_pose(results)
}

/// Prints the summary and where the results are. A flight of which nothing was measured is refused.
pub(crate) fn print_summary(summary: &Summary, results: &RunResults, out: &Path) -> Result<()> {
    out!("{}", summary.text());
    outln!("\nResults: {}", out.display());
    require_a_pose(results)
}

/// Removes what an earlier run left in the folder of which this one has nothing.
fn remove_stale(results: &RunResults, out: &Path) -> Result<()> {
    let has_parameters = results.identification.is_some() || results.output_error.named().next().is_some();
    let files = [
        (names::BODY, !results.body.is_empty()),
        (names::MOTION, results.motion.is_some()),
        (names::COEFFICIENTS, results.coefficients.is_some()),
        (names::PARAMETERS, has_parameters),
    ];
    remove_absent(out, &files)
}

/// Removes from a folder the files of which there is nothing now.
pub(super) fn remove_absent(out: &Path, files: &[(&str, bool)]) -> Result<()> {
    for (name, is_there) in files {
        let path = out.join(name);
        if !is_there && path.exists() {
            std::fs::remove_file(&path).with_context(|| format!("{}", path.display()))?;
        }
    }
    Ok(())
}

pub(crate) fn require_a_pose(results: &RunResults) -> Result<()> {
    match results.poses.first().map(|p| &p.estimate) {
        Some(Err(reason)) if results.poses.iter().all(|p| p.estimate.is_err()) => {
            anyhow::bail!("none of {} instants has a pose; the first: {reason}", results.poses.len())
        }
        _ => Ok(()),
    }
}
