//! Predicted parameters against fits of noisy poses, and multisines against the doublet.

use mavsight_flight::Vehicle;
use mavsight_geometry::{Isometry3, UnitQuaternion};
use mavsight_identify::output_error::{Measurements, OutputErrorOptions, StateMeasurement, output_error};
use mavsight_pipeline::body_markers;
use mavsight_plan::{
    CameraPair, FlightLimits, FlightPlanner, MultisineOptions, Optimality, PlanError, PlannedManoeuvre,
    Planner, Room, Solid, true_model,
};
use mavsight_random::Random;
use mavsight_simulator::{Maneuver, Scenario};

const C_M: [&str; 4] = ["C_m,0", "C_m,alpha_u", "C_m,alpha_l", "C_m,q"];

fn planner() -> Planner {
    let room: Room = toml::from_str(
        r#"
schema = 1
name = "meeting room"
room = { low_m = [-5.0, -5.0, 0.0], high_m = [5.0, 2.0, 3.2] }
volume = { low_m = [-1.0, -1.0, 0.6], high_m = [1.0, 1.0, 2.4] }
[[camera]]
name = "camcorder"
count = 2
width_px = 640
height_px = 480
horizontal_fov_deg = 53.0
centre_std_px = 0.05
"#,
    )
    .expect("a room");
    Planner::new(room, body_markers(&Vehicle::paper()), vec![]).expect("a planner")
}

fn limits() -> FlightLimits {
    let volume = Solid { name: None, low_m: [-1.0, -1.0, 0.6], high_m: [1.0, 1.0, 2.4] };
    FlightLimits { volume, tilt_deg: 25.0, deflection_deg: 5.0, input_percent: 5.0 }
}

fn flights<'a>(planner: &'a Planner) -> FlightPlanner<'a> {
    FlightPlanner::new(
        planner,
        &planner.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 }),
        &Vehicle::paper(),
        limits(),
    )
    .expect("a rig")
}

/// Poses with errors of the planned covariance.
fn noisy(plan: &PlannedManoeuvre, random: &mut Random) -> Vec<Isometry3<f64>> {
    let measured = plan.states.iter().zip(&plan.pose_covariance).map(|(s, covariance)| {
        let (pose, factor) = (s.pose(), covariance.cholesky().expect("positive").l());
        let error = factor * nalgebra::Vector6::from(random.normals());
        let turn = UnitQuaternion::from_scaled_axis(error.fixed_rows::<3>(3).into_owned());
        let place = pose.translation.vector + error.fixed_rows::<3>(0);
        Isometry3::from_parts(place.into(), pose.rotation * turn)
    });
    measured.collect()
}

/// The scatter of first-order estimates over 200 noisy flights is the prediction, and whole fits give what
/// they give.
#[test]
fn estimates_scatter_as_predicted_and_one_step_is_the_whole_fit() {
    let planner = planner();
    let flights = flights(&planner);
    let plan = flights.predict(&Scenario::paper(), true).expect("a plan");
    assert!((0.9..=1.0).contains(&plan.used), "{}", plan.used);
    let (mut random, trials) = (Random::new(11, 0), 200);
    let mut squares = vec![0.0; plan.fit.parameters.len()];
    for _ in 0..trials {
        let estimate = plan.fit.first_order(&noisy(&plan, &mut random)).expect("an estimate");
        for ((sum, p), got) in squares.iter_mut().zip(&plan.fit.parameters).zip(estimate.iter()) {
            *sum += (got - p.value).powi(2) / f64::from(trials);
        }
    }
    for (p, square) in plan.fit.parameters.iter().zip(&squares) {
        let ratio = p.std / square.sqrt();
        assert!((0.85..1.15).contains(&ratio), "{}: predicted over achieved {ratio}", p.name);
    }
    let poses = noisy(&plan, &mut random);
    let samples = plan.states.iter().zip(&poses).zip(&plan.pose_covariance).map(|((s, pose), covariance)| {
        let t_ns = mavsight_session::ns_from_s(s.t_s);
        StateMeasurement::of_pose(t_ns, *pose, *covariance)
    });
    let model = true_model(flights.vehicle(), &plan.inputs).expect("a model");
    let measured = Measurements::States(samples.collect());
    let whole = output_error(&model, &plan.inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    let step = plan.fit.first_order(&poses).expect("an estimate");
    for ((fitted, one), p) in whole.parameters.iter().zip(step.iter()).zip(&plan.fit.parameters) {
        println!(
            "{:12} whole {:+.5e} one step {one:+.5e} predicted std {:.2e} fitted {:.2e}",
            p.name, fitted.value, p.std, fitted.std
        );
        assert!((fitted.value - one).abs() < 0.7 * p.std, "{}: {} against {one}", p.name, fitted.value);
        assert!((fitted.std / p.std - 1.0).abs() < 0.25, "{}: {} against {}", p.name, fitted.std, p.std);
    }
}

#[test]
fn an_optimised_multisine_determines_the_moment_much_better_than_the_doublet() {
    let planner = planner();
    let flights = flights(&planner);
    let base = Scenario { frame_rate_hz: 15.0, ..Scenario::paper() };
    let doublet = flights.predict(&base, true).expect("a doublet");
    let options = MultisineOptions {
        channels: vec!["delta_lon".into()],
        harmonics: vec![2, 3, 5, 7, 10, 14],
        start_s: 0.5,
        parameters: C_M.map(str::to_owned).to_vec(),
        optimality: Optimality::D,
        generations: 4,
        seed: 1,
    };
    let best = flights.optimise(&base, &options).expect("a multisine");
    assert!(best.used <= 1.0);
    let [from, to] = [&doublet, &best].map(|p| p.fit.log_generalised_variance(&C_M).expect("a covariance"));
    println!("doublet {from}, multisine {to}: ratio {:.1}", (from - to).exp());
    for p in doublet.fit.parameters.iter().zip(&best.fit.parameters) {
        println!(
            "{:12} {:+.4e} doublet {:.3e} {} multisine {:.3e}",
            p.0.name, p.0.value, p.0.std, p.0.identifiable, p.1.std
        );
    }
    println!("{:?} used {} {}", doublet.fit.undetermined, doublet.used, best.used);
    assert!((from - to).exp() > 5.0, "ratio of generalised variances {}", (from - to).exp());
    let again = flights.optimise(&base, &options).expect("a multisine");
    assert_eq!(again.scenario, best.scenario, "the same seed finds the same");
}

/// A systematic error of 0.1 mm along X in every pose moves the estimates by its effect, and the covariance
/// by the square of it.
#[test]
fn systematic_errors_enter_by_their_effect_on_the_estimates() {
    let planner = planner();
    let plan = flights(&planner).predict(&Scenario::paper(), true).expect("a plan");
    let shift = nalgebra::Vector6::new(1e-4, 0.0, 0.0, 0.0, 0.0, 3e-4);
    let poses = plan.states.iter().map(|s| {
        let pose = s.pose();
        let turn = UnitQuaternion::from_scaled_axis(shift.fixed_rows::<3>(3).into_owned());
        Isometry3::from_parts(
            (pose.translation.vector + shift.fixed_rows::<3>(0)).into(),
            pose.rotation * turn,
        )
    });
    let moved = plan.fit.first_order(&poses.collect::<Vec<_>>()).expect("estimates");
    let column = nalgebra::Matrix6xX::from_column_slice(shift.as_slice()).map(|v: f64| v as f32);
    let systematic =
        plan.fit.clone().with_systematic(&vec![column; plan.states.len()]).expect("a covariance");
    for (k, (before, after)) in plan.fit.parameters.iter().zip(&systematic.parameters).enumerate() {
        let wanted = before.std.hypot(moved[k] - before.value);
        assert!((after.std / wanted - 1.0).abs() < 1e-3, "{}: {} against {wanted}", before.name, after.std);
    }
}

#[test]
fn what_cannot_be_flown_is_refused() {
    let planner = planner();
    let flights = flights(&planner);
    let still = Scenario { maneuver: vec![], ..Scenario::paper() };
    assert!(matches!(flights.predict(&still, true), Err(PlanError::Value { .. })));
    let mut far = limits();
    far.volume = Solid { name: None, low_m: [-1.0, 5.0, 0.6], high_m: [1.0, 7.0, 2.4] };
    let rig = planner.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 });
    let away = FlightPlanner::new(&planner, &rig, &Vehicle::paper(), far).expect("a rig");
    assert!(matches!(away.predict(&Scenario::paper(), true), Err(PlanError::OutOfView { .. })));
    let none = FlightLimits { tilt_deg: 0.0, ..limits() };
    assert!(FlightPlanner::new(&planner, &rig, &Vehicle::paper(), none).is_err());
    let nan = Scenario { duration_s: f64::NAN, ..Scenario::paper() };
    assert!(matches!(flights.predict(&nan, false), Err(PlanError::Flight(_))));
    let nothing = MultisineOptions {
        channels: vec!["delta_lon".into()],
        harmonics: vec![],
        start_s: 0.5,
        parameters: C_M.map(str::to_owned).to_vec(),
        optimality: Optimality::A,
        generations: 1,
        seed: 1,
    };
    assert!(matches!(flights.optimise(&Scenario::paper(), &nothing), Err(PlanError::Value { .. })));
    let plan = flights.predict(&Scenario::paper(), true).expect("a plan");
    assert!(plan.fit.first_order(&[]).is_err());
    assert!(plan.fit.clone().with_systematic(&[]).is_err());
    let step = Maneuver::Step { channel: "delta_lon".into(), start_s: 1.0, amplitude: 80.0 };
    let plan = flights.predict(&Scenario { maneuver: vec![step], ..Scenario::paper() }, false);
    assert!(plan.is_err() || plan.is_ok_and(|p| p.used <= 1.0));
}

/// A model of another aircraft: its doublet is as large as the first limit allows, which of an input without
/// trim and angle is the range in the model's file.
#[test]
fn a_manoeuvre_of_another_model_is_as_large_as_its_input_allows() {
    let model = |unit: &str, trim: f64| {
        let text = format!(
            "schema = 2\nname = \"hovers\"\n[inputs]\npush = {{ unit = \"{unit}\", min = -0.5, max = 1, trim = {trim} }}\n\
             [parameters]\nc = {{ value = 0.02, free = true }}\nd = {{ value = 0.1, free = true }}\n\
             [forces]\nz = \"-mass*g - d*w\"\n[moments]\ny = \"c*(push - {trim}) - d*q\"\n"
        );
        let model = mavsight_model::Model::parse("hovers.toml", &text).expect("a model").into();
        let (parameters, simulation) = Default::default();
        Vehicle { model, parameters, simulation, ..Vehicle::paper() }
    };
    let planner = planner();
    let rig = planner.pair(0, CameraPair { angle_deg: 90.0, distance_m: 6.36 });
    let wide = FlightLimits { tilt_deg: 85.0, ..limits() };
    let doublet = Maneuver::Doublet { channel: "push".into(), start_s: 0.5, pulse_s: 0.2, amplitude: 0.01 };
    let base = Scenario { duration_s: 1.2, maneuver: vec![doublet], ..Scenario::paper() };
    for (unit, trim, largest) in [("rad", 0.0, 5.0_f64.to_radians()), ("1", 0.4, 0.02), ("N", 0.0, 0.5)] {
        let vehicle = model(unit, trim);
        let flights = FlightPlanner::new(&planner, &rig, &vehicle, wide.clone()).expect("a rig");
        let plan = flights.predict(&base, true).expect("a plan");
        let moved = (0..plan.inputs.times_s().len()).map(|k| (plan.inputs.row(k)[0] - trim).abs());
        let most = moved.fold(0.0, f64::max);
        assert!((0.95..=1.0).contains(&(most / largest)), "{unit}: {most} of {largest}");
        let names: Vec<&str> = plan.fit.parameters.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names, ["c", "d"]);
    }
}
