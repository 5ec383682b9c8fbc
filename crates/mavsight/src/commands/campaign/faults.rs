//! Thousands of simulated flights with faults.

use crate::cli::{Campaign as Args, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_pipeline::Progress;
use mavsight_score::{Fault, FaultCampaign, FaultSummary};
use mavsight_session::{RESULTS_SCHEMA, make_folder, write_json, write_whole};
use serde_json::json;

pub(super) fn campaign(args: &Args) -> Result<()> {
    let campaign = FaultCampaign::new(args.seed, args.flights, args.only.as_deref().map(named).transpose()?);
    make_folder(&args.out)?;
    let bars = Bars::new();
    bars.start("flying", Some(campaign.flights()));
    let table =
        campaign.run(&args.out.join("flights.part"), &|flights| (0..flights).for_each(|_| bars.step()))?;
    bars.done();
    write_whole(&args.out.join("flights.csv"), table.as_bytes())?;
    let summary = campaign.summary(&table);
    let json = json!({
        "schema": RESULTS_SCHEMA, "seed": args.seed, "flights": campaign.flights(), "faults": summary,
    });
    write_json(&args.out.join("summary.json"), &json)?;
    out!("{}", text(&summary));
    outln!("\nResults: {}", args.out.display());
    Ok(())
}

fn named(name: &str) -> Result<Fault> {
    let key = |fault: &Fault| fault.words().replace(' ', "-");
    let found = Fault::ALL.into_iter().find(|fault| key(fault) == name);
    found.ok_or_else(|| {
        let all: Vec<String> = Fault::ALL.iter().map(key).collect();
        WrongCall(format!("--only {name}: no such fault: take {}", all.join(", "))).into()
    })
}

fn text(summary: &[FaultSummary]) -> String {
    let mut out = format!(
        "{:<18} {:>7} {:>7} {:>8} {:>8} {:>8} {:>9} {:>6} {:>7} {:>7} {:>7} {:>9}\n",
        "",
        "flights",
        "refused",
        "RMS mm",
        "RMS °",
        "given %",
        "inside %",
        "beyond",
        "in",
        "right %",
        "wrong %",
        "out after"
    );
    let mut is_in_pairs = false;
    for row in summary {
        if row.in_pairs && !is_in_pairs {
            out += "beside another:\n";
            is_in_pairs = true;
        }
        let right = row.right.map_or("-".to_owned(), |r| format!("{:.1}", 100.0 * r));
        let after = row.left_out_after_frames.map_or("-".to_owned(), |n| format!("{n:.0}"));
        out += &format!(
            "{:<18} {:>7} {:>7} {:>8.2} {:>8.3} {:>8.1} {:>9.1} {:>6} {:>7} {:>7} {:>7.1} {:>9}\n",
            row.fault.map_or("nothing", Fault::words),
            row.flights,
            row.refused,
            row.position_rms_mm,
            row.attitude_rms_deg,
            100.0 * row.given,
            100.0 * row.inside,
            row.beyond,
            row.flights_beyond,
            right,
            100.0 * row.wrong,
            after
        );
    }
    out + "\nbeyond: rows of motion beyond 5 of their standard deviations, and in how many flights; right: flights in which the fault\n\
           is named; wrong: in which a cause is named that is none; out after: frames until a camera is left out, the middle flight\n"
}
