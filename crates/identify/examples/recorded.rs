//! Output error on a recorded flight, from its poses and straight from the images of its markers.
//!
//! `cargo run --release -p mavsight-identify --example recorded -- SESSION.toml RESULTS`, where the results are
//! those of `mavsight run SESSION.toml --out RESULTS`.

use mavsight_flight::InputSeries;
use mavsight_geometry::Vector3;
use mavsight_identify::output_error::{
    Correlation, FlightModel, ImageMeasurements, Measurements, OutputErrorFit, OutputErrorOptions,
    StateMeasurement, disagreement, output_error,
};
use mavsight_pose::BodyMarker;
use mavsight_session::{Session, read_markers, read_poses, read_rig};
use nalgebra::DVector;
use std::path::PathBuf;

type Failure = Box<dyn std::error::Error>;

fn show(title: &str, fit: &OutputErrorFit, seconds: f64) {
    println!(
        "\n{title}: {seconds:.2} s, {} iterations, reduced chi-square {:.3}, factors {:?}",
        fit.iterations, fit.reduced_chi_square, fit.variance_factors
    );
    for p in &fit.parameters {
        println!(
            "  {:14} {:+.5e} ± {:.1e} (bound {:.1e}), 95 % [{:+.4e}, {:+.4e}]{}",
            p.name,
            p.value,
            p.std,
            p.bound_std,
            p.ci_low,
            p.ci_high,
            if p.identifiable { "" } else { "  hardly told" }
        );
    }
    for note in &fit.notes {
        println!("  {note}");
    }
    if std::env::var_os("RESIDUALS").is_some() {
        for r in &fit.residuals {
            println!(
                "    {:24} mean {:+.3} rms {:.3} neighbours {:+.3}",
                r.name, r.mean, r.rms, r.autocorrelation
            );
        }
    }
}

fn timed(
    title: &str,
    model: &FlightModel,
    inputs: &InputSeries,
    measured: &Measurements,
) -> Option<OutputErrorFit> {
    let begin = std::time::Instant::now();
    match output_error(model, inputs, measured, &OutputErrorOptions::default()) {
        Ok(fit) => {
            show(title, &fit, begin.elapsed().as_secs_f64());
            Some(fit)
        }
        Err(error) => {
            println!("\n{title}: {error}");
            None
        }
    }
}

fn main() -> Result<(), Failure> {
    let mut words = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(session), Some(results)) = (words.next(), words.next()) else {
        return Err("name the session's file and the results' folder".into());
    };
    let session = Session::load(&session)?;
    let (vehicle, inputs) = (&session.vehicle, session.inputs()?);
    let rig = read_rig(&results.join("rig.toml"))?;
    let cameras: Vec<String> = rig.cameras.iter().map(|c| c.name.clone()).collect();
    let names: Vec<String> = vehicle.marker.iter().map(|m| m.name.clone()).collect();
    let markers: Vec<BodyMarker> = vehicle
        .marker
        .iter()
        .map(|m| BodyMarker {
            name: m.name.clone(),
            marker_in_body_m: Vector3::from(m.position_m),
            radius_m: 0.5 * m.diameter_m,
        })
        .collect();
    let poses = read_poses(&results.join("pose.csv"), &names)?;
    let seen = read_markers(&results.join("markers.csv"), &cameras, &names)?;
    let mut model = FlightModel::new(vehicle, &inputs)?;
    // With LAG set, the clock of the inputs is free.
    if std::env::var_os("LAG").is_some() {
        let names: Vec<_> = model.free().iter().map(|p| p.name()).chain(["input_lag_s"]).collect();
        model = model.clone().with_free(&names)?;
    }
    let states = Measurements::States(poses.iter().map(StateMeasurement::from_pose).collect());
    let from_poses = timed("from poses", &model, &inputs, &states);
    let plain = ImageMeasurements::new(&rig, &markers, &seen)?;
    timed("straight from the image, nothing uncertain", &model, &inputs, &Measurements::Image(plain.clone()));
    let calibrated = plain.with_cameras(&rig)?.with_marker_positions(5e-4);
    timed("cameras and markers uncertain", &model, &inputs, &Measurements::Image(calibrated.clone()));
    let biased = calibrated.clone().with_marker_biases(0.1, None);
    timed("centres off by 0.1 px", &model, &inputs, &Measurements::Image(biased));
    let turning = calibrated.with_marker_biases(0.1, Some(1.0));
    let from_image =
        timed("centres off by 0.1 px and 0.1 px per rad", &model, &inputs, &Measurements::Image(turning));
    if let (Some(a), Some(b)) = (from_poses, from_image) {
        let take = |f: &OutputErrorFit| {
            (
                DVector::from_iterator(4, f.parameters.iter().take(4).map(|p| p.value)),
                f.covariance.view((0, 0), (4, 4)).into_owned(),
            )
        };
        let ((x, c), (y, d)) = (take(&a), take(&b));
        let test = disagreement((&x, &c), (&y, &d), Correlation::IndependentOrAlike)?;
        println!(
            "\nposes against image, four coefficients: chi-square {:.2}, p = {:.3}",
            test.chi_square, test.p_value
        );
    }
    Ok(())
}
