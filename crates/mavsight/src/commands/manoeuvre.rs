//! Which manoeuvre has most information.

use super::demo::scenario_of;
use super::plan::{best_placement, wrong_call};
use crate::cli::{Criterion, PlanManoeuvre, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::{Context, Result};
use mavsight_flight::Vehicle;
use mavsight_identify::output_error::FlightModel;
use mavsight_plan::{
    FlightLimits, FlightPlanner, MultisineOptions, Optimality, PlannedManoeuvre, Planner, SearchOptions,
    Solid,
};
use mavsight_session::{RESULTS_SCHEMA, make_folder, write_csv, write_json, write_toml};
use mavsight_simulator::{Maneuver, Scenario};
use serde_json::json;

/// Nothing is done before, so that the start can be determined.
const QUIET_S: f64 = 0.5;
/// The paper's doublet begins after two seconds, with pulses of one.
const DOUBLET: (f64, f64) = (2.0, 1.0);
/// Unit of the 3-2-1-1 whose band is that of the doublet.
const UNIT_S: f64 = 0.5;
/// Frequencies of the multisines: from what a volume allows to what rotors answer to.
const BAND_HZ: (f64, f64) = (0.25, 2.5);
const HARMONICS: usize = 10;
/// Largest change of an input that is no angle, of its value in steady flight.
const INPUT_PERCENT: f64 = 5.0;
/// What a manoeuvre determines where the vehicle has it.
const USUAL_PARAMETERS: [&str; 4] = ["C_m,0", "C_m,alpha_u", "C_m,alpha_l", "C_m,q"];

pub(crate) fn manoeuvre(args: &PlanManoeuvre) -> Result<()> {
    let (planner, vehicle) = Planner::load(&args.room).map_err(wrong_call)?;
    let moved = moved(&vehicle, &args.input)?;
    let bars = Bars::new();
    bars.start("planning", None);
    let placed = match &args.cameras {
        Some(path) => best_placement(&planner, path)?,
        None => planner.search(&SearchOptions { best: 1, ..Default::default() })?.swap_remove(0).placed,
    };
    let volume = &planner.room().volume;
    let limits = FlightLimits {
        volume: Solid { name: None, low_m: volume.low_m, high_m: volume.high_m },
        tilt_deg: args.max_tilt,
        deflection_deg: args.max_deflection,
        input_percent: INPUT_PERCENT,
    };
    let flights = FlightPlanner::new(&planner, &placed, &vehicle, limits)?;
    let base = Scenario {
        duration_s: args.duration,
        position_m: planner.room().middle_m().into(),
        ..Scenario::paper()
    };
    let mut plans = Vec::new();
    for (name, maneuver) in built_in(&moved[0], args.duration) {
        let scenario = Scenario { maneuver: vec![maneuver], ..base.clone() };
        plans.push((name.to_owned(), flights.predict(&scenario, true).with_context(|| name)?));
    }
    for path in &args.scenario {
        let name = path.file_stem().map_or_else(|| "own".to_owned(), |s| s.to_string_lossy().into_owned());
        plans.push((name.clone(), flights.predict(&scenario_of(Some(path))?, false).context(name)?));
    }
    let names = parameters(&plans[0].1, &args.parameters)?;
    let options = MultisineOptions {
        channels: moved.clone(),
        harmonics: harmonics(args.duration - QUIET_S),
        start_s: QUIET_S,
        parameters: names.clone(),
        optimality: if args.criterion == Criterion::D { Optimality::D } else { Optimality::A },
        generations: args.generations,
        seed: args.seed,
    };
    plans.push(("optimised".to_owned(), flights.optimise(&base, &options)?));
    bars.done();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    out!("{}", table(&plans, &names));
    let held = FlightModel::new(&vehicle, &plans[0].1.inputs)?.held();
    for line in verdicts(&plans, &moved[0], &held) {
        outln!("{line}");
    }
    if let Some(out) = &args.out {
        make_folder(out)?;
        let header = ["manoeuvre", "parameter", "value", "std", "identifiable"];
        let rows = |(name, plan): &(String, PlannedManoeuvre)| -> Vec<_> {
            let parameters = plan.fit.parameters.iter();
            parameters.map(|p| (name.clone(), p.name.clone(), p.value, p.std, p.identifiable)).collect()
        };
        write_csv(&out.join("manoeuvres.csv"), header, plans.iter().flat_map(rows))?;
        write_json(&out.join("manoeuvres.json"), &json(&plans, &names))?;
        for (name, plan) in &plans {
            write_toml(&out.join(format!("scenario-{name}.toml")), &plan.scenario)?;
        }
        outln!("\nResults: {}", out.display());
    }
    Ok(())
}

/// The inputs that are moved: those asked for; or the first angle that goes as far to either side, as that of
/// an elevator or a swash-plate does; or the first.
fn moved(vehicle: &Vehicle, asked: &[String]) -> Result<Vec<String>, WrongCall> {
    let model = &vehicle.model;
    if let Some(unknown) = asked.iter().find(|name| model.input(name).is_none()) {
        let known = model.inputs.iter().map(|i| i.name.as_str()).collect::<Vec<&str>>().join(" ");
        return Err(WrongCall(format!("--input {unknown}: the model {} has {known}", model.name)));
    }
    if !asked.is_empty() {
        return Ok(asked.to_vec());
    }
    let steering = model.inputs.iter().find(|i| i.is_angle && i.min == -i.max);
    let first = steering.or(model.inputs.first());
    let none = || WrongCall(format!("the model {} has no input: there is nothing to plan", model.name));
    first.map(|input| vec![input.name.clone()]).ok_or_else(none)
}

/// The parameters that count: those asked for, the usual ones, or all that a plan frees.
fn parameters(plan: &PlannedManoeuvre, asked: &[String]) -> Result<Vec<String>, WrongCall> {
    let free: Vec<String> = plan.fit.parameters.iter().map(|p| p.name.clone()).collect();
    if asked.is_empty() {
        let usual = USUAL_PARAMETERS.map(str::to_owned);
        return Ok(if usual.iter().all(|name| free.contains(name)) { usual.to_vec() } else { free });
    }
    if asked.iter().all(|name| free.contains(name)) {
        return Ok(asked.to_vec());
    }
    let (asked, free) = (asked.join(" "), free.join(" "));
    Err(WrongCall(format!("--parameters {asked}: not all are free: use some of {free}")))
}

fn built_in(input: &str, duration_s: f64) -> [(&'static str, Maneuver); 3] {
    let channel = input.to_owned();
    let length_s = duration_s - QUIET_S;
    [
        (
            "doublet",
            Maneuver::Doublet {
                channel: channel.clone(),
                start_s: DOUBLET.0,
                pulse_s: DOUBLET.1,
                amplitude: -5.0,
            },
        ),
        (
            "3-2-1-1",
            Maneuver::ThreeTwoOneOne {
                channel: channel.clone(),
                start_s: DOUBLET.0,
                unit_s: UNIT_S,
                amplitude: 2.0,
            },
        ),
        (
            "multisine",
            Maneuver::Multisine {
                channel,
                start_s: QUIET_S,
                length_s,
                harmonics: harmonics(length_s),
                amplitude: 1.0,
            },
        ),
    ]
}

/// Harmonics of one over a length, spread over the band.
fn harmonics(length_s: f64) -> Vec<u32> {
    let (low, high) = BAND_HZ;
    let mut out: Vec<u32> = (0..HARMONICS)
        .map(|k| {
            let share = k as f64 / (HARMONICS - 1) as f64;
            ((low * (high / low).powf(share)) * length_s).round().max(1.0) as u32
        })
        .collect();
    out.dedup();
    out
}

type Plans = [(String, PlannedManoeuvre)];

fn table(plans: &Plans, names: &[&str]) -> String {
    let mut out = "Standard deviations for a known clock of the inputs (--lag):\n".to_owned();
    out += &format!("{:<14} {:>12}", "std of", "value");
    plans.iter().for_each(|(name, _)| out += &format!(" {name:>12}"));
    out.push('\n');
    for p in &plans[0].1.fit.parameters {
        out += &format!("{:<14} {:>12.4e}", p.name, p.value);
        for (_, plan) in plans {
            match plan.fit.parameters.iter().find(|q| q.name == p.name) {
                Some(q) if q.identifiable => out += &format!(" {:>12.3e}", q.std),
                Some(q) => out += &format!(" {:>11.3e}?", q.std),
                None => out += &format!(" {:>12}", "-"),
            }
        }
        out.push('\n');
    }
    out += &format!("{:<27}", format!("variance of {}", names.len()));
    plans.iter().for_each(|(_, plan)| out += &format!(" {:>12.3e}", ratio(plans, plan, names)));
    out += "  (generalised, over the doublet's)\n";
    out += &format!("{:<27}", "largest share of a limit");
    plans.iter().for_each(|(_, plan)| out += &format!(" {:>12.2}", plan.used));
    out.push('\n');
    out
}

/// Generalised variance over that of the doublet.
fn ratio(plans: &Plans, plan: &PlannedManoeuvre, names: &[&str]) -> f64 {
    let log = |p: &PlannedManoeuvre| p.fit.log_generalised_variance(names);
    log(plan).zip(log(&plans[0].1)).map_or(f64::INFINITY, |(own, doublet)| (own - doublet).exp())
}

fn verdicts(plans: &Plans, input: &str, held: &[String]) -> Vec<String> {
    let mut out = Vec::new();
    for (name, plan) in plans {
        let vague: Vec<&str> =
            plan.fit.parameters.iter().filter(|p| !p.identifiable).map(|p| p.name.as_str()).collect();
        if let Some(combination) = &plan.fit.undetermined {
            out.push(format!("The {name}: {combination}."));
        } else if !vague.is_empty() {
            out.push(format!("The {name} hardly determines {}.", vague.join(", ")));
        }
    }
    if !held.is_empty() {
        let held = held.join(", ");
        out.push(format!(
            "No manoeuvre of {input} alone determines {held}: they are held at the vehicle file's values."
        ));
    }
    out
}

fn json(plans: &Plans, names: &[&str]) -> serde_json::Value {
    let all: Vec<_> = plans
        .iter()
        .map(|(name, plan)| {
            let parameters: Vec<_> = plan
                .fit
                .parameters
                .iter()
                .map(|p| json!({ "name": p.name, "value": p.value, "std": p.std, "identifiable": p.identifiable }))
                .collect();
            json!({
                "name": name,
                "scenario": plan.scenario,
                "used_share_of_limits": plan.used,
                "parameters": parameters,
                "generalised_variance_over_doublet": ratio(plans, plan, names),
                "undetermined": plan.fit.undetermined,
            })
        })
        .collect();
    json!({ "schema": RESULTS_SCHEMA, "optimised_for": names, "manoeuvres": all })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::VehicleFile;

    #[test]
    fn what_steers_is_moved_where_nothing_is_asked_for() {
        for (model, wanted) in [
            ("coaxial", Some("delta_lon")),
            ("helicopter", Some("delta_lon")),
            ("fixed-wing-longitudinal", Some("delta_e")),
            ("attas-lateral", Some("delta_a")),
            ("quadrotor", Some("omega_c_1")),
            ("thrown-body", None),
        ] {
            let mut file = VehicleFile::from(Vehicle::paper());
            file.model = Some(model.to_owned());
            let vehicle = file.vehicle(|_| Err("a shelf model".to_owned())).expect("a model");
            let moved = moved(&vehicle, &[]).ok();
            assert_eq!(moved, wanted.map(|name| vec![name.to_owned()]), "{model}");
        }
    }
}
