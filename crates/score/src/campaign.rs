//! Thousands of simulated flights over a grid of rigs, noise and manoeuvres.

use crate::chunks::checksum;
use crate::{
    CAMPAIGN_SCHEMA, CampaignCamera, CampaignFile, CampaignRig, ChunkFile, FitKind, NoiseLevel, ScoreError,
};
use mavsight_flight::{Vehicle, VehicleFile};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Matrix2, Point3, Vector2, Vector3};
use mavsight_identify::output_error::{
    ExpectedParameter, FlightModel, Measurements, OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_plan::{FlightLimits, FlightPlanner, Placed, PlannedManoeuvre, Planner};
use mavsight_pose::{MarkerObservation, NORMAL_95, PoseEstimator, Rig, RigCamera};
use mavsight_random::Random;
use mavsight_session::{ns_from_s, read_toml};
use mavsight_simulator::Scenario;
use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::Path;

/// The estimate and the truth of one parameter in one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueParameter {
    /// Name.
    pub name: String,
    /// Truth.
    pub truth: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation of the estimate: predicted for `first_order`, of the fit for `output_error`.
    pub std: f64,
}

/// Accuracy of one parameter over the flights of one combination.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CellSummary {
    /// Rig, noise and manoeuvre.
    pub cell: [String; 3],
    /// Parameter.
    pub parameter: String,
    /// Flights with an estimate.
    pub flights: usize,
    /// Truth.
    pub truth: f64,
    /// Predicted standard deviation, before any flight.
    pub predicted_std: f64,
    /// Root mean square error.
    pub achieved_std: f64,
    /// Part of the flights whose 95 % interval holds the truth.
    pub inside: f64,
}

struct Cell {
    names: [String; 3],
    planner: Planner,
    placed: Vec<Placed>,
    rig: Rig,
    estimator: PoseEstimator,
    plan: PlannedManoeuvre,
    model: FlightModel,
}

/// A campaign whose combinations are planned and simulated once; each flight draws its own noise.
pub struct Campaign {
    file: CampaignFile,
    cells: Vec<Cell>,
    job: u64,
}

impl Campaign {
    /// Reads a campaign file and the rooms and scenarios that it names, relative to it, and plans every
    /// combination.
    ///
    /// # Errors
    /// [`ScoreError::Session`] and [`ScoreError::Plan`] for a file; [`ScoreError::Campaign`] names the key; a
    /// combination that cannot be flown or seen.
    pub fn load(path: &Path) -> Result<Self, ScoreError> {
        let file: CampaignFile = read_toml(path, "campaign file")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let refuse = |key: &str, detail: String| Err(ScoreError::Campaign { key: key.to_owned(), detail });
        if file.schema != CAMPAIGN_SCHEMA {
            let detail = format!("{} is not known: this version reads {CAMPAIGN_SCHEMA}", file.schema);
            return refuse("schema", detail);
        }
        if file.flights == 0 || file.flights > 10_000_000 {
            return refuse("flights", format!("{} is not from 1 to 10 000 000", file.flights));
        }
        if file.rig.is_empty() || file.noise.is_empty() || file.manoeuvre.is_empty() {
            return refuse("rig, noise, manoeuvre", "need one entry each at least".to_owned());
        }
        Self::check_names("rig", file.rig.iter().map(|r| &*r.name))?;
        Self::check_names("noise", file.noise.iter().map(|n| &*n.name))?;
        Self::check_names("manoeuvre", file.manoeuvre.iter().map(|m| &*m.name))?;
        let mut combinations = Vec::new();
        let mut inputs = format!("{file:?}");
        for rig in &file.rig {
            let (planner, vehicle) = Planner::load(&folder.join(&rig.room))?;
            // A model as its text: what it is made of in memory has no order.
            let (flown, model) = (VehicleFile::from(vehicle.clone()), &vehicle.model.definition);
            inputs += &format!("{:?}{flown:?}{model}{:?}", planner.room(), planner.control());
            for noise in &file.noise {
                for steered in &file.manoeuvre {
                    let scenario: Scenario = read_toml(&folder.join(&steered.scenario), "scenario file")?;
                    inputs += &format!("{scenario:?}");
                    let names = [rig.name.clone(), noise.name.clone(), steered.name.clone()];
                    let (planner, vehicle) = (planner.clone(), vehicle.clone());
                    combinations.push(Combination { names, rig, noise, planner, vehicle, scenario });
                }
            }
        }
        let cells = combinations.into_par_iter().map(Combination::planned);
        let cells = cells.collect::<Result<Vec<Cell>, ScoreError>>()?;
        let job = checksum(inputs.as_bytes());
        Ok(Self { file, cells, job })
    }

    /// Number of flights in all.
    pub fn flights(&self) -> u64 {
        self.file.flights * self.cells.len() as u64
    }

    /// Rig, noise and manoeuvre of each combination, with the names of its free parameters and their truth.
    pub fn combinations(&self) -> impl Iterator<Item = (&[String; 3], Vec<(String, f64)>)> {
        self.cells.iter().map(|c| {
            let parameters = c.plan.fit.parameters.iter().map(|p| (p.name.to_owned(), p.value));
            (&c.names, parameters.collect())
        })
    }

    /// One flight, by its number from 0: the index of its combination, and the estimates of its free
    /// parameters; none if the fit was refused. The result depends on neither the machine nor the order of
    /// flights.
    pub fn fly(&self, number: u64) -> (usize, Option<Vec<TrueParameter>>) {
        let index = ((number / self.file.flights) as usize).min(self.cells.len() - 1);
        let cell = &self.cells[index];
        let mut random = Random::new(self.file.seed, number);
        let estimates = cell.poses(&mut random).and_then(|poses| cell.estimate(&poses, self.file.fit));
        (index, estimates)
    }

    /// Rows of the table of some flights: rig, noise, manoeuvre, flight, parameter, truth, estimate, std.
    pub fn rows(&self, flights: std::ops::Range<u64>) -> String {
        let mut out = String::new();
        for number in flights {
            let (index, estimates) = self.fly(number);
            let start = format!("{},{}", self.cells[index].names.join(","), number % self.file.flights);
            for p in estimates.iter().flatten() {
                // A comma in a name would be a column.
                let name = p.name.replace(',', ":");
                out += &format!("{start},{name},{:e},{:e},{:e}\n", p.truth, p.estimate, p.std);
            }
            if estimates.is_none() {
                out += &format!("{start},,,,\n");
            }
        }
        out
    }

    /// Header of the table.
    pub const HEADER: &'static str = "rig,noise,manoeuvre,flight,parameter,truth,estimate,std\n";

    /// Flies the flights that `file` does not hold yet, on all threads, and returns the whole table; `step`
    /// is called with the number of flights of each finished piece.
    ///
    /// # Errors
    /// A file of another campaign, or what the file system refuses.
    pub fn run(&self, file: &Path, step: &(dyn Fn(u64) + Sync)) -> Result<String, ScoreError> {
        let rows = |flights| self.rows(flights);
        Ok(Self::HEADER.to_owned()
            + &ChunkFile::open(file, self.job)?.completed(self.flights(), &rows, step)?)
    }

    fn check_names<'a>(key: &str, names: impl Iterator<Item = &'a str>) -> Result<(), ScoreError> {
        let refuse = |detail: String| Err(ScoreError::Campaign { key: key.to_owned(), detail });
        let mut known = BTreeSet::new();
        for name in names {
            if !known.insert(name) {
                return refuse(format!("{name:?} is there twice: give each a name of its own"));
            }
            if name.contains([',', '"', '\n', '\r']) {
                return refuse(format!(
                    "{name:?} cannot stand in a table: leave out commas, quotes and line breaks"
                ));
            }
        }
        Ok(())
    }

    /// Accuracy by combination and parameter from a table.
    pub fn summary(&self, table: &str) -> Vec<CellSummary> {
        let mut out = Vec::new();
        for cell in &self.cells {
            let start = format!("{},", cell.names.join(","));
            let rows: Vec<Vec<&str>> =
                table.lines().filter_map(|l| Some(l.strip_prefix(&start)?.split(',').collect())).collect();
            for p in &cell.plan.fit.parameters {
                let name = p.name.replace(',', ":");
                let (mut flights, mut inside, mut squares) = (0, 0, 0.0);
                for row in rows.iter().filter(|r| r[1] == name) {
                    let number = |k: usize| row.get(k)?.parse::<f64>().ok();
                    let (Some(truth), Some(estimate), Some(std)) = (number(2), number(3), number(4)) else {
                        continue;
                    };
                    flights += 1;
                    inside += usize::from((estimate - truth).abs() <= NORMAL_95 * std);
                    squares += (estimate - truth).powi(2);
                }
                let n = flights.max(1) as f64;
                out.push(CellSummary {
                    cell: cell.names.clone(),
                    parameter: p.name.to_owned(),
                    flights,
                    truth: p.value,
                    predicted_std: p.std,
                    achieved_std: (squares / n).sqrt(),
                    inside: inside as f64 / n,
                });
            }
        }
        out
    }
}

struct Combination<'a> {
    names: [String; 3],
    rig: &'a CampaignRig,
    noise: &'a NoiseLevel,
    planner: Planner,
    vehicle: Vehicle,
    scenario: Scenario,
}

impl Combination<'_> {
    fn planned(self) -> Result<Cell, ScoreError> {
        let Self { names, rig, noise, planner, vehicle, scenario } = self;
        let mut room = planner.room().clone();
        room.centre_bias_px = noise.centre_bias_px.unwrap_or(room.centre_bias_px);
        room.markers_std_m = noise.markers_std_m.unwrap_or(room.markers_std_m);
        for kind in &mut room.camera {
            kind.centre_std_px = noise.centre_std_px.clone().or(kind.centre_std_px.take());
        }
        let place = |c: &CampaignCamera| {
            let kind = room.camera.iter().position(|k| k.name == c.kind);
            let kind = kind.ok_or_else(|| ScoreError::Campaign {
                key: format!("rig {}: type", rig.name),
                detail: format!("{:?} is no camera of {}", c.kind, rig.room.display()),
            })?;
            let aim_m = c.aim_m.map_or(room.middle_m(), Vector3::from);
            Ok(Placed { kind, centre_m: c.centre_m.into(), aim_m })
        };
        let placed = rig.camera.iter().map(place).collect::<Result<Vec<Placed>, ScoreError>>()?;
        let planner = Planner::new(room, planner.markers().to_vec(), planner.control().to_vec())?;
        let limits = FlightLimits {
            volume: planner.room().room.clone(),
            tilt_deg: 80.0,
            deflection_deg: 80.0,
            input_percent: 80.0,
        };
        let rig = planner.rig(&placed)?;
        let plan = FlightPlanner::new(&planner, &placed, &vehicle, limits)?.predict_here(&scenario)?;
        // The start of a whole fit is the vehicle file, not the truth.
        let model = FlightModel::new(&vehicle, &plan.inputs).map_err(mavsight_plan::PlanError::from)?;
        let estimator = planner.estimator(&rig)?;
        Ok(Cell { names, rig, estimator, placed, model, plan, planner })
    }
}

impl Cell {
    /// The poses that are estimated from one flight's images: cameras, markers and centres have systematic
    /// errors, each centre its own noise. None if one pose is refused.
    fn poses(&self, random: &mut Random) -> Option<Vec<Isometry3<f64>>> {
        let room = self.planner.room();
        let normal = DVector::from_fn(self.rig.uncertainty.ncols(), |_, _| random.normal());
        let off = &self.rig.uncertainty * normal;
        let moved = |(k, c): (usize, &RigCamera)| {
            c.camera.moved(&off.fixed_rows::<CAMERA_PARAMETERS>(k * CAMERA_PARAMETERS).into_owned())
        };
        let real: Vec<Camera> = self.rig.cameras.iter().enumerate().map(moved).collect();
        let mut normal3 = |std: f64| Vector3::from_fn(|_, _| std * random.normal());
        let mut markers = self.planner.markers().to_vec();
        markers.iter_mut().for_each(|m| m.marker_in_body_m += normal3(room.markers_std_m));
        let mut normal2 = |std: f64| Vector2::new(std * random.normal(), std * random.normal());
        let bias: Vec<Vector2<f64>> =
            (0..real.len() * markers.len()).map(|_| normal2(room.centre_bias_px)).collect();
        // What a camera sees is judged as the plan judges it.
        let nominal: Vec<Camera> = self.placed.iter().map(|p| self.planner.camera(p)).collect();
        let mut previous: Option<Isometry3<f64>> = None;
        let mut seen = Vec::with_capacity(real.len() * markers.len());
        let mut out = Vec::with_capacity(self.plan.states.len());
        for s in &self.plan.states {
            let (pose, t_ns) = (s.pose(), ns_from_s(s.t_s));
            seen.clear();
            for (camera, view) in real.iter().enumerate() {
                let kind = &room.camera[self.placed[camera].kind];
                for (marker, ball) in markers.iter().enumerate() {
                    let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
                    let seen_px = self.planner.seen(kind, &nominal[camera], &centre, ball.radius_m);
                    let Ok(diameter_px) = seen_px else { continue };
                    let Ok(exact) = view.project_ball(&centre, ball.radius_m) else { continue };
                    let std_px = kind.centre_std_px_at(diameter_px, &centre, camera, marker);
                    let pixel = exact.pixel + normal2(std_px) + bias[camera * markers.len() + marker];
                    let covariance_px2 = Matrix2::identity() * std_px * std_px;
                    seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                }
            }
            let estimate = self.estimator.estimate(t_ns, &seen, previous.as_ref()).ok()?;
            previous = Some(estimate.world_from_body);
            out.push(estimate.world_from_body);
        }
        Some(out)
    }

    fn estimate(&self, poses: &[Isometry3<f64>], kind: FitKind) -> Option<Vec<TrueParameter>> {
        let plan = &self.plan;
        let planned = plan.fit.parameters.iter();
        if kind == FitKind::FirstOrder {
            let got = plan.fit.first_order(poses).ok()?;
            let of = |(p, e): (&ExpectedParameter, &f64)| TrueParameter {
                name: p.name.clone(),
                truth: p.value,
                estimate: *e,
                std: p.std,
            };
            return Some(planned.zip(got.iter()).map(of).collect());
        }
        let measured = plan.states.iter().zip(poses).zip(&plan.pose_covariance);
        let measured = measured.map(|((s, pose), c)| StateMeasurement::of_pose(ns_from_s(s.t_s), *pose, *c));
        let measured = Measurements::States(measured.collect());
        let fit = output_error(&self.model, &plan.inputs, &measured, &OutputErrorOptions::default()).ok()?;
        let flown = fit.parameters.iter().zip(planned);
        let flown = flown.map(|(f, p)| TrueParameter {
            name: f.name.clone(),
            truth: p.value,
            estimate: f.value,
            std: f.std,
        });
        Some(flown.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_pipeline::body_markers;
    use mavsight_plan::Room;

    const ROOM: &str = r#"
schema = 1
name = "a wall before the third camera"
room = { low_m = [-5.0, -5.0, 0.0], high_m = [5.0, 2.0, 3.2] }
volume = { low_m = [-1.0, -1.0, 0.6], high_m = [1.0, 1.0, 2.4] }
[[camera]]
name = "camcorder"
count = 3
width_px = 640
height_px = 480
horizontal_fov_deg = 53.0
centre_std_px = 0.05
[[block]]
name = "wall"
low_m = [3.2, -0.5, 0.0]
high_m = [3.5, 2.0, 3.2]
"#;

    const DOUBLET: &str = include_str!("../tests/doublet.toml");

    fn cell() -> Cell {
        let room: Room = toml::from_str(ROOM).expect("a room");
        let vehicle = Vehicle::paper();
        let planner = Planner::new(room, body_markers(&vehicle), vec![]).expect("a planner");
        let camera = [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5], [4.5, 1.5, 1.5]].map(|centre_m| CampaignCamera {
            kind: "camcorder".to_owned(),
            centre_m,
            aim_m: None,
        });
        let rig = CampaignRig { name: "three".to_owned(), room: "".into(), camera: camera.to_vec() };
        let noise = NoiseLevel {
            name: "fine".to_owned(),
            centre_std_px: None,
            centre_bias_px: None,
            markers_std_m: None,
        };
        let scenario: Scenario = toml::from_str(DOUBLET).expect("a scenario");
        let names = ["three", "fine", "doublet"].map(str::to_owned);
        let combination = Combination { names, rig: &rig, noise: &noise, planner, vehicle, scenario };
        combination.planned().expect("a plan")
    }

    /// A camera that saw through the wall would make the errors a fraction of those planned.
    #[test]
    fn a_camera_behind_a_wall_sees_as_little_in_flight_as_in_the_plan() {
        let (cell, flights) = (cell(), 100);
        let mut squares = vec![0.0; cell.plan.fit.parameters.len()];
        for flight in 0..flights {
            let poses = cell.poses(&mut Random::new(7, flight)).expect("poses");
            let estimates = cell.estimate(&poses, FitKind::FirstOrder).expect("an estimate");
            for (sum, p) in squares.iter_mut().zip(&estimates) {
                *sum += (p.estimate - p.truth).powi(2) / flights as f64;
            }
        }
        for (p, square) in cell.plan.fit.parameters.iter().zip(&squares) {
            let ratio = p.std / square.sqrt();
            assert!((0.75..1.35).contains(&ratio), "{}: predicted over achieved {ratio}", p.name);
        }
    }
}
