//! Whether the printed intervals are true, for one's own rig.

use super::demo::FilmedFlight;
use super::named;
use crate::cli::{BuiltInRig, Selftest};
use crate::lab;
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::{Result, bail};
use mavsight_engine::camera_feeds;
use mavsight_pipeline::{NoProgress, Progress};
use mavsight_random::Random;
use mavsight_scene::Room;
use mavsight_score::{Coverage, TOO_FEW, Tally, VirtualFlight, VirtualLab};
use mavsight_session::{RESULTS_SCHEMA, Session, make_folder, write_csv, write_json};
use mavsight_simulator::Staging;
use rayon::prelude::*;
use serde_json::json;

/// Flights by sets of observations, and films, where no number is given.
const FLIGHTS: u64 = 200;
const FILMS: u64 = 3;

/// Flights that are measured before they are counted: bounds the memory.
const AT_ONCE: u64 = 16;

pub(crate) fn selftest(args: &Selftest) -> Result<()> {
    let bars = Bars::new();
    let (name, lab) = lab_of(args, &bars)?;
    let flights = args.flights.unwrap_or(if args.film { FILMS } else { FLIGHTS });
    let gravity_m_s2 = lab.vehicle.environment.gravity_m_s2;
    let mut tally = Tally::default();
    bars.start("flying", Some(flights));
    for first in (0..flights).step_by(AT_ONCE as usize) {
        let some = first..flights.min(first + AT_ONCE);
        let measured: Vec<Result<VirtualFlight>> = if args.film {
            some.map(|k| film(&lab, args.seed, k).inspect(|_| bars.step())).collect()
        } else {
            some.into_par_iter()
                .map(|k| Ok(lab.fly(&mut Random::new(args.seed, k)).inspect(|_| bars.step())?))
                .collect()
        };
        for flight in measured {
            tally.add(&flight?, gravity_m_s2);
        }
    }
    bars.done();
    let coverage = tally.coverage();
    outln!("{}", setting(&name, &lab, &tally, args));
    out!("{}", table(&coverage));
    if let Some(out) = &args.out {
        make_folder(out)?;
        let header = "quantity,unit,share,share_low,share_high,nees,nees_low,nees_high,rms,verdict,accepted";
        write_csv(&out.join("selftest.csv"), header.split(','), &coverage)?;
        let summary = json!({
            "schema": RESULTS_SCHEMA,
            "laboratory": name,
            "seed": args.seed,
            "filmed": args.film,
            "flights": tally.flights(),
            "instants": tally.instants().0,
            "instants_without_pose": tally.instants().1,
            "claimed_std_px": lab.stated_std_px(),
            "noise_over_claim": lab.noise_over_stated,
            "bias_px": lab.bias_px,
            "quantities": coverage,
        });
        write_json(&out.join("selftest.json"), &summary)?;
        outln!("\nResults: {}", out.display());
    }
    let wrong: Vec<String> = coverage
        .iter()
        .filter(|c| !c.is_accepted)
        .map(|c| format!("{} {} ({:.1} %)", c.quantity, c.verdict, 100.0 * c.share))
        .collect();
    if coverage.iter().any(|c| c.verdict == TOO_FEW) {
        eprintln!("mavsight: {flights} flights are too few for some quantities: give more by --flights");
    }
    if !wrong.is_empty() {
        bail!("the 95 % intervals are not true here: {}", wrong.join(", "));
    }
    Ok(())
}

fn lab_of(args: &Selftest, bars: &Bars) -> Result<(String, VirtualLab)> {
    let Some(path) = &args.session else {
        return Ok(match args.rig.unwrap_or(BuiltInRig::Paper) {
            BuiltInRig::Paper => ("paper".to_owned(), VirtualLab::paper()),
            BuiltInRig::Wide => ("wide".to_owned(), VirtualLab::wide()),
            BuiltInRig::Three => ("three".to_owned(), VirtualLab::three()),
        });
    };
    let session = named(Session::load(path))?;
    let control = named(session.control_points())?;
    let rig = mavsight_engine::calibrate(&session, bars)?;
    let tracked = mavsight_pipeline::track(camera_feeds(&session)?, &rig, &session.vehicle, bars)?;
    let mut lab = VirtualLab::of_session(&rig, control, session.vehicle.clone(), &tracked)?;
    lab.refines = session.file.refine.is_some_and(|how| how.is_asked_for());
    Ok((session.file.name, lab))
}

fn film(lab: &VirtualLab, seed: u64, index: u64) -> Result<VirtualFlight> {
    let mut random = Random::new(seed, index);
    let truth = lab.flight(&mut random)?;
    let mut as_built = lab.control.clone();
    for row in &mut as_built {
        row.position_m.iter_mut().for_each(|x| *x += row.std_m * random.normal());
    }
    let (room, aircraft) = (Room::meeting_room(), lab::aircraft(&lab.vehicle));
    let films = lab::staged_films(&room, &lab.cameras, seed + index, &Staging::default());
    let interval_s = 1.0 / lab.frame_rate_hz;
    let filmed = FilmedFlight { films: &films, aircraft: &aircraft, truth: &truth, interval_s };
    let (rig, tracked) = filmed.track(&as_built, &lab.control, &lab.vehicle, &NoProgress)?;
    Ok(lab.measured(truth, rig, tracked)?)
}

fn setting(name: &str, lab: &VirtualLab, tally: &Tally, args: &Selftest) -> String {
    let (instants, without) = tally.instants();
    let seen = if args.film {
        "filmed in the virtual room, without a codec".to_owned()
    } else {
        format!(
            "centres claimed to {:.3} px with {:.2} of that as noise, {:.3} px systematic",
            lab.stated_std_px(),
            lab.noise_over_stated,
            lab.bias_px
        )
    };
    format!(
        "{name}: {} cameras, {} markers, {:.2} frames a second; {seen}\n{} flights, calibrated anew for each; {instants} instants, {without} without a pose of their own\n",
        lab.cameras.len(),
        lab.vehicle.marker.len(),
        lab.frame_rate_hz,
        tally.flights(),
    )
}

fn table(coverage: &[Coverage]) -> String {
    let mut out = format!(
        "{:<23} {:>8} {:>15} {:>6} {:>13} {:>10} {:<7} {}\n",
        "quantity", "inside %", "(95 %)", "NEES", "(if true)", "RMS", "", "95 % intervals"
    );
    for c in coverage {
        let [low, high] = c.share_interval.map(|s| 100.0 * s);
        let [least, most] = c.nees_interval;
        out += &format!(
            "{:<23} {:>8.1} {:>15} {:>6.2} {:>13} {:>10.3} {:<7} {}\n",
            c.quantity,
            100.0 * c.share,
            format!("({low:.1} to {high:.1})"),
            c.nees,
            format!("({least:.2}-{most:.2})"),
            c.rms,
            c.unit,
            c.verdict
        );
    }
    out
}
