//! Inputs of a log whose clock and whose gyroscope's axes are its own.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_engine::{Flight, identify_from_poses};
use mavsight_flight::{InputSeries, SensorSeries, Vehicle, VehicleFile};
use mavsight_geometry::{Matrix6, UnitQuaternion, Vector3};
use mavsight_identify::output_error::MotionFits;
use mavsight_model::SHELF;
use mavsight_pipeline::{IdentifyOptions, NoProgress};
use mavsight_pose::{PoseEstimate, PoseSample};
use mavsight_random::Random;
use mavsight_session::logs::LogGyroscope;
use mavsight_session::{RunResults, write_results};
use mavsight_simulator::{Maneuver, Scenario, sensed, simulate, true_values};

/// The log's clock shows this at the first pose.
const OFFSET_S: f64 = 812.345;
const DRIFT: f64 = 8e-5;
const GYROSCOPE_HZ: f64 = 400.0;

/// What an accelerometer and a gyroscope of the log show.
const OUTPUTS: &str = r#"
[parameters.bias_q]
unit = "rad/s"
value = 0
free = true
[outputs]
acc_x = { column = "acc_x_m_s2", unit = "m/s^2", std = 0.05, value = "a_x" }
gyro_y = { column = "gyro_y_rad_s", unit = "rad/s", std = 0.002, value = "q + bias_q" }
"#;
const BIAS_RAD_S: f64 = 0.02;

struct Recorded {
    poses: Vec<PoseSample>,
    gyroscope: LogGyroscope,
    inputs: InputSeries,
    sensors: Option<SensorSeries>,
}

fn log_s(t_s: f64) -> f64 {
    OFFSET_S + t_s * (1.0 + DRIFT)
}

fn recorded(vehicle: &Vehicle, amplitude_deg: f64) -> Recorded {
    let sine = |channel: &str, harmonics: [u32; 4]| Maneuver::Multisine {
        channel: channel.to_owned(),
        start_s: 0.0,
        length_s: 10.0,
        harmonics: harmonics.to_vec(),
        amplitude: amplitude_deg,
    };
    let maneuver = vec![sine("delta_lon", [3, 7, 11, 15]), sine("delta_lat", [4, 8, 12, 16])];
    let scenario = Scenario { maneuver, ..Scenario::paper() };
    let inputs = scenario.inputs(vehicle).unwrap();
    let start = scenario.start(vehicle).unwrap();
    let mut random = Random::new(35, 0);
    let (position_m, turn_rad) = (5e-4, 1e-3);
    let variances = [position_m, position_m, position_m, turn_rad, turn_rad, turn_rad].map(|s: f64| s * s);
    let covariance = Matrix6::from_diagonal(&variances.into());
    let filmed = simulate(vehicle, &inputs, &start, &scenario.frame_times_s()).unwrap();
    let poses = filmed.iter().map(|s| {
        let mut pose = s.pose();
        pose.translation.vector += Vector3::from(random.normals()) * position_m;
        pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * turn_rad);
        PoseSample { t_ns: (s.t_s * 1e9).round() as i64, estimate: Ok(PoseEstimate::new(pose, &covariance)) }
    });
    let poses = poses.collect();
    let times_s: Vec<f64> = (0..(9.9 * GYROSCOPE_HZ) as usize).map(|k| k as f64 / GYROSCOPE_HZ).collect();
    let body_from_sensor = UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.1, 0.45));
    let measured = simulate(vehicle, &inputs, &start, &times_s).unwrap();
    let rates_rad_s = measured
        .iter()
        .map(|s| body_from_sensor.inverse() * s.rates_rad_s + Vector3::from(random.normals()) * 2e-3);
    let gyroscope = LogGyroscope {
        source: "sensor_gyro".into(),
        times_ns: times_s.iter().map(|t_s| (log_s(*t_s) * 1e9).round() as i64).collect(),
        rates_rad_s: rates_rad_s.collect(),
    };
    let has_sensors = !vehicle.model.sensors.is_empty();
    let sensors = has_sensors.then(|| {
        let exact = sensed(vehicle, &inputs, &measured).unwrap();
        let rows = 0..exact.times_ns().len();
        let noisy = rows.flat_map(|k| {
            let row = exact.row(k);
            [row[0] + 0.05 * random.normal(), row[1] + BIAS_RAD_S + 2e-3 * random.normal()]
        });
        let noisy = noisy.collect();
        SensorSeries::new(exact.columns().to_vec(), exact.times_ns().to_vec(), noisy)
            .unwrap()
            .at_times(log_s)
            .unwrap()
    });
    Recorded { poses, gyroscope, inputs: inputs.at_times(log_s).unwrap(), sensors }
}

/// The paper's helicopter with sensors.
fn sensing() -> Vehicle {
    let coaxial = SHELF.iter().find(|(name, _)| *name == "coaxial").unwrap().1;
    let mut file = VehicleFile::from(Vehicle::paper());
    file.model = Some("sensing.toml".to_owned());
    // What the model leaves out unless it is asked for.
    file.simulation.retain(|name, _| !["C_m_hub", "C_n_r", "d_xy", "d_z"].contains(&name.as_str()));
    file.vehicle(|_| Ok(format!("{coaxial}{OUTPUTS}"))).unwrap()
}

fn identified(vehicle: &Vehicle, recorded: &Recorded) -> RunResults {
    let motion_fits = MotionFits { output_error: true, filter_error: false };
    let options = IdentifyOptions { motion_fits, ..IdentifyOptions::default() };
    let flight = Flight {
        name: "log",
        vehicle,
        inputs: Some(&recorded.inputs),
        sensors: None,
        gyroscope: Some(&recorded.gyroscope),
        log_sensors: recorded.sensors.as_ref(),
        options,
    };
    let mut results = RunResults { poses: recorded.poses.clone(), ..RunResults::default() };
    identify_from_poses(&mut results, &flight, &NoProgress).unwrap();
    results
}

#[test]
fn inputs_of_a_log_are_moved_to_the_clock_of_the_poses() {
    let vehicle = Vehicle::paper();
    let results = identified(&vehicle, &recorded(&vehicle, 2.0));
    let note = results.notes.iter().find(|n| n.contains("by its gyroscope (sensor_gyro)")).unwrap();
    assert!(note.contains("s of the poses it shows 817.29"), "{note}");
    let fit = results.output_error.poses.as_ref().unwrap();
    // No lag is left beyond what the inputs themselves can show.
    let lag = fit.parameters.iter().find(|p| p.name == "input_lag_s").unwrap();
    assert!(lag.value.abs() < 4.0 * lag.std && lag.std < 5e-3, "{lag:?}");
    // The motion follows the gyroscope, and its table has times by the log's clock.
    assert!(results.notes.iter().any(|n| n.contains("follow the log's gyroscope")), "{:?}", results.notes);
    let motion = results.motion.as_ref().unwrap();
    let rate_std = motion.samples[150].covariance.quantity(3).trace().sqrt();
    assert!(rate_std < 5e-3, "{rate_std}");
    let folder = std::env::temp_dir().join(format!("mavsight-log-clock-{}", std::process::id()));
    write_results(&folder, &results).unwrap();
    let table = std::fs::read_to_string(folder.join("motion.csv")).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(table.lines().next().unwrap().ends_with(",log_t_s"));
    let cells: Vec<f64> = table.lines().nth(151).unwrap().split(',').map(|c| c.parse().unwrap()).collect();
    assert!((cells[cells.len() - 1] - log_s(cells[0])).abs() < 2e-3, "{cells:?}");
    let time_constant = fit.parameter("tau_l").unwrap();
    assert!((time_constant.value - 0.05).abs() < 4.0 * time_constant.std, "{time_constant:?}");
}

#[test]
fn sensors_of_a_log_narrow_the_intervals_and_these_hold_the_truth() {
    let vehicle = sensing();
    let mut recorded = recorded(&vehicle, 2.0);
    let both = identified(&vehicle, &recorded);
    recorded.sensors = None;
    let alone = identified(&vehicle, &recorded);
    let said = |results: &RunResults, words: &str| results.notes.iter().any(|note| note.contains(words));
    assert!(said(&both, "has the log's sensors too (acc_x_m_s2, gyro_y_rad_s)"), "{:?}", both.notes);
    assert!(said(&alone, "The sensors of the model (acc_x, gyro_y) are not used"), "{:?}", alone.notes);
    let [both, alone] = [both, alone].map(|results| results.output_error.poses.unwrap());
    let truth = true_values(&vehicle);
    let mut ratios = Vec::new();
    for p in &both.parameters {
        let truth = match p.name.as_str() {
            "input_lag_s" => 0.0,
            "bias_q" => BIAS_RAD_S,
            name => truth[name],
        };
        println!("{} {} ± {} ({truth})", p.name, p.value, p.std);
        assert!((p.value - truth).abs() < 3.5 * p.std, "{}: {} ± {}, {truth}", p.name, p.value, p.std);
        let shown = ["C_X,alpha", "C_m,", "tau_", "input_lag"].iter().any(|of| p.name.starts_with(of));
        if let Some(before) = alone.parameter(&p.name).filter(|_| shown && p.name != "C_m,0") {
            println!("    ± {} alone", before.std);
            assert!(p.std < 0.9 * before.std, "{}: {} from {}", p.name, p.std, before.std);
            ratios.push((p.std / before.std).ln());
        }
    }
    let mean = (ratios.iter().sum::<f64>() / ratios.len() as f64).exp();
    assert!(ratios.len() == 8 && mean < 0.5, "{mean} of {}", ratios.len());
}

#[test]
fn a_log_of_a_flight_that_hardly_turns_gives_no_inputs_and_says_why() {
    let vehicle = Vehicle::paper();
    let results = identified(&vehicle, &recorded(&vehicle, 1e-6));
    let note = results.notes.iter().find(|n| n.contains("The log's clock is not known")).unwrap();
    assert!(note.contains("turn the aircraft by hand"), "{note}");
    assert!(results.identification.is_none() && results.output_error.poses.is_none());
}
