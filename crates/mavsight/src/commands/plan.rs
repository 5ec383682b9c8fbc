//! What to expect before flying.

use crate::cli::{PlanCameras, WrongCall};
use crate::out::{out, outln};
use crate::progress::Bars;
use anyhow::Result;
use mavsight_flight::Vehicle;
use mavsight_plan::{
    CameraPair, EXAMPLE, Placed, PlanError, Planner, Prediction, Ranked, SearchOptions, StudyRow,
};
use mavsight_report::{CameraPlan, angle_deg, least, write_plan_report};
use mavsight_session::{
    ControlSection, RESULTS_SCHEMA, SESSION_SCHEMA, SessionCamera, SessionError, SessionFile, make_folder,
    write_control_points, write_csv, write_json, write_toml, write_vehicle, write_whole,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

const ANGLES_DEG: std::ops::RangeInclusive<u32> = 8..=30;
const ANGLE_STEP_DEG: f64 = 5.0;
const DISTANCES: std::ops::RangeInclusive<u32> = 6..=20;
const DISTANCE_STEP_M: f64 = 0.5;
const RIGHT_ANGLE_DEG: f64 = 90.0;

pub(crate) fn cameras(args: &PlanCameras) -> Result<()> {
    if let Some(folder) = &args.example {
        make_folder(folder)?;
        for (name, text) in EXAMPLE {
            write_whole(&folder.join(name), text.as_bytes())?;
        }
        outln!("{}", folder.join(EXAMPLE[0].0).display());
    }
    let Some(path) = args.room.as_deref() else { return Ok(()) };
    let (planner, vehicle) = Planner::load(path).map_err(wrong_call)?;
    let options = SearchOptions { step_m: args.step, free_aim: args.free_aim, best: args.best };
    let begin = Instant::now();
    let bars = Bars::new();
    bars.start("placing", None);
    let ranked = planner.search(&options)?;
    let seconds = begin.elapsed().as_secs_f64();
    let study = if args.study { study(&planner, &ranked[0]) } else { [vec![], vec![]] };
    bars.done();
    let plan = CameraPlan { planner: &planner, ranked: &ranked, study };
    let cameras = ranked[0].placed.len();
    outln!(
        "{}: {cameras} cameras, {} of the placements found in {seconds:.1} s\n",
        planner.room().name,
        ranked.len()
    );
    out!("{}{}", placement_table(&plan), study_text(&plan));
    if let Some(out) = &args.out {
        make_folder(out)?;
        write_placements(&plan, &out.join("placements.csv"))?;
        write_json(&out.join("plan.json"), &plan_json(&plan, seconds))?;
        write_plan_report(&plan, out)?;
        write_start(&plan, &vehicle, out)?;
        outln!("\nResults: {}", out.display());
    }
    Ok(())
}

/// A file that cannot be planned with is a wrong call, all else a failure.
pub(crate) fn wrong_call(error: PlanError) -> anyhow::Error {
    match error {
        PlanError::Session(_) | PlanError::Room { .. } => WrongCall(error.to_string()).into(),
        other => other.into(),
    }
}

/// Two cameras of the first type, at the mean distance of the best placement, and at a right angle.
fn study(planner: &Planner, best: &Ranked) -> [Vec<StudyRow>; 2] {
    let middle = planner.room().middle_m();
    let n = best.placed.len() as f64;
    let distance_m = best.placed.iter().map(|p| (p.centre_m - middle).norm()).sum::<f64>() / n;
    let at_angle = |k: u32| CameraPair { angle_deg: ANGLE_STEP_DEG * f64::from(k), distance_m };
    let at_distance =
        |k: u32| CameraPair { angle_deg: RIGHT_ANGLE_DEG, distance_m: DISTANCE_STEP_M * f64::from(k) };
    let pairs: [Vec<CameraPair>; 2] =
        [ANGLES_DEG.map(at_angle).collect(), DISTANCES.map(at_distance).collect()];
    pairs.map(|pairs| planner.study(0, &pairs))
}

fn placement_table(plan: &CameraPlan<'_>) -> String {
    let mut out = format!(
        "{:>4} {:>9} {:>9} {:>9} {:>9} {:>9} {:>7}  cameras at X Y Z, m\n",
        "rank", "mean mm", "worst mm", "new mm", "mean °", "least px", "angle °"
    );
    for (k, r) in plan.ranked.iter().enumerate() {
        let p = &r.prediction;
        out += &format!(
            "{:>4} {:>9.3} {:>9.3} {:>9.3} {:>9.4} {:>9.1} {:>7.1} ",
            k + 1,
            p.mean.position_std_mm,
            p.worst.position_std_mm,
            p.mean.new_position_std_mm,
            p.mean.attitude_std_deg,
            p.least_diameter_px,
            angle_deg(r)
        );
        for Placed { centre_m: c, .. } in &r.placed {
            out += &format!(" ({:.2} {:.2} {:.2})", c.x, c.y, c.z);
        }
        out.push('\n');
    }
    out
}

fn study_text(plan: &CameraPlan<'_>) -> String {
    let [angles, distances] = &plan.study;
    let mut out = String::new();
    if let Some(best) = least(angles) {
        out += &format!(
            "\nTwo cameras {:.2} m from the middle: least error at {:.0}°, {:.3} mm\n",
            best.pair.distance_m, best.pair.angle_deg, best.prediction.mean.position_std_mm
        );
    }
    if let Some(near) = least(distances) {
        out += &format!(
            "At a right angle: least error {:.1} m from the middle, {:.3} mm{}\n",
            near.pair.distance_m,
            near.prediction.mean.position_std_mm,
            why_not_nearer(distances, near)
        );
    }
    out
}

/// What the next nearer pair of a study lacks; empty where it lacks nothing, or none is nearer.
fn why_not_nearer(distances: &[StudyRow], least: &StudyRow) -> String {
    let is_nearer = |row: &&StudyRow| row.pair.distance_m < least.pair.distance_m;
    let next =
        distances.iter().filter(is_nearer).max_by(|a, b| a.pair.distance_m.total_cmp(&b.pair.distance_m));
    match next.map(|row| &row.prediction) {
        Some(Prediction { refused: Some(refused), .. }) => format!("; nearer, {refused}"),
        Some(prediction) if prediction.share_seen < 1.0 => "; nearer, not all is seen".to_owned(),
        _ => String::new(),
    }
}

fn write_placements(plan: &CameraPlan<'_>, path: &Path) -> Result<(), SessionError> {
    let header = "rank,camera,type,x_m,y_m,z_m,aim_x_m,aim_y_m,aim_z_m,mean_position_std_mm,worst_position_std_mm,new_position_std_mm,mean_attitude_std_deg,least_diameter_px";
    let of_rank = |(rank, r): (usize, &Ranked)| -> Vec<_> {
        let p = &r.prediction;
        let errors = [p.mean.position_std_mm, p.worst.position_std_mm, p.mean.new_position_std_mm];
        let seen = (p.mean.attitude_std_deg, p.least_diameter_px);
        let row = |(k, c): (usize, &Placed)| {
            let places: [[f64; 3]; 2] = [c.centre_m.into(), c.aim_m.into()];
            (rank + 1, plan.planner.name(k), kind_of(plan, c), places, errors, seen)
        };
        r.placed.iter().enumerate().map(row).collect()
    };
    write_csv(path, header.split(','), plan.ranked.iter().enumerate().flat_map(of_rank))
}

fn kind_of(plan: &CameraPlan<'_>, placed: &Placed) -> String {
    plan.planner.room().camera[placed.kind].name.clone()
}

#[derive(Serialize, Deserialize)]
struct CameraEntry {
    name: String,
    #[serde(rename = "type")]
    kind: String,
    centre_m: [f64; 3],
    aim_m: [f64; 3],
}

#[derive(Deserialize)]
struct PlanFile {
    placements: Vec<Placement>,
}

#[derive(Deserialize)]
struct Placement {
    cameras: Vec<CameraEntry>,
}

pub(super) fn best_placement(planner: &Planner, path: &Path) -> Result<Vec<Placed>, WrongCall> {
    let wrong = |detail: &str| {
        WrongCall(format!("{}: {detail}: give the plan.json of `mavsight plan cameras`", path.display()))
    };
    let text = std::fs::read_to_string(path).map_err(|e| wrong(&e.to_string()))?;
    let plan: PlanFile = serde_json::from_str(&text).map_err(|e| wrong(&e.to_string()))?;
    let best = plan.placements.into_iter().next().ok_or_else(|| wrong("holds no placement"))?;
    let placed = best.cameras.iter().map(|c| {
        let kind = planner.room().camera.iter().position(|k| k.name == c.kind)?;
        Some(Placed { kind, centre_m: c.centre_m.into(), aim_m: c.aim_m.into() })
    });
    let placed: Option<Vec<Placed>> = placed.collect();
    placed.filter(|p| p.len() >= 2).ok_or_else(|| wrong("has cameras that the room has not"))
}

fn plan_json(plan: &CameraPlan<'_>, seconds: f64) -> serde_json::Value {
    let entry = |(k, c): (usize, &Placed)| CameraEntry {
        name: plan.planner.name(k),
        kind: kind_of(plan, c),
        centre_m: c.centre_m.into(),
        aim_m: c.aim_m.into(),
    };
    let placement = |r: &Ranked| {
        let cameras: Vec<_> = r.placed.iter().enumerate().map(entry).collect();
        json!({ "cameras": cameras, "angle_deg": angle_deg(r), "prediction": r.prediction })
    };
    json!({
        "schema": RESULTS_SCHEMA,
        "room": plan.planner.room(),
        "seconds": seconds,
        "placements": plan.ranked.iter().map(placement).collect::<Vec<_>>(),
        "angle_study": plan.study[0],
        "distance_study": plan.study[1],
    })
}

/// The session to start from: its videos, stills and inputs are yet to be recorded.
fn write_start(plan: &CameraPlan<'_>, vehicle: &Vehicle, out: &Path) -> Result<()> {
    let folder = out.join("session");
    make_folder(&folder)?;
    let camera = |k: usize| {
        let name = plan.planner.name(k);
        SessionCamera {
            video: format!("{name}.mp4").into(),
            still: Some(format!("{name}-control.png").into()),
            name,
            ..SessionCamera::default()
        }
    };
    let session = SessionFile {
        schema: SESSION_SCHEMA,
        name: plan.planner.room().name.clone(),
        vehicle: "vehicle.toml".into(),
        inputs: "inputs.csv".into(),
        control: Some(ControlSection { points: "control_points.csv".into(), observations: None }),
        camera: (0..plan.ranked[0].placed.len()).map(camera).collect(),
        ..SessionFile::default()
    };
    write_toml(&folder.join("session.toml"), &session)?;
    write_control_points(&folder.join("control_points.csv"), plan.planner.control())?;
    Ok(write_vehicle(&folder.join("vehicle.toml"), vehicle)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_plan::PosePrecision;

    fn row(distance_m: f64, share_seen: f64, refused: Option<&str>) -> StudyRow {
        let prediction = Prediction {
            figure: 1.0,
            mean: PosePrecision::default(),
            worst: PosePrecision::default(),
            worst_at_m: [0.0; 3],
            share_seen,
            limit: None,
            least_diameter_px: 5.0,
            refused: refused.map(str::to_owned),
        };
        StudyRow { pair: CameraPair { angle_deg: 90.0, distance_m }, is_allowed: true, prediction }
    }

    #[test]
    fn a_study_says_what_the_next_nearer_pair_lacks() {
        let least = row(3.5, 1.0, None);
        let said = |nearer: StudyRow| {
            why_not_nearer(&[row(2.5, 0.2, None), nearer, least.clone(), row(4.0, 1.0, None)], &least)
        };
        assert_eq!(said(row(3.0, 0.9, None)), "; nearer, not all is seen");
        assert_eq!(
            said(row(3.0, 1.0, Some("2 control points were seen"))),
            "; nearer, 2 control points were seen"
        );
        assert_eq!(said(row(3.0, 1.0, None)), "");
        assert_eq!(why_not_nearer(&[least.clone(), row(4.0, 1.0, None)], &least), "");
    }
}
