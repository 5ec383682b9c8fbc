use super::image::{markers, rig, samples, seen};
use super::support::{flown, multisine};
use crate::output_error::{
    FlightFitOptions, FlightFits, ImageMeasurements, Images, InputClock, Measurements,
};
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector2;
use mavsight_random::Random;

/// A drag that the vehicle has and its model not.
const DRAG_N_S_M: f64 = 0.15;

#[test]
fn a_term_that_poses_show_is_in_the_fit_to_the_images_too() {
    let mut vehicle = Vehicle::paper();
    vehicle.simulation.insert("d_xy".to_owned(), DRAG_N_S_M);
    let (inputs, states) = flown(&vehicle, &multisine(5.0));
    let mut random = Random::new(12, 0);
    let poses = samples(&states, &mut random);
    let (rig, markers) = (rig(), markers(&vehicle));
    let observations = seen(&states, (&rig, &markers), 0.1, &mut random, |_, _| Vector2::zeros());
    let images = Images { rig: &rig, markers: &markers, markers_std_m: 5e-4, observations: &observations };
    let options = FlightFitOptions { clock: InputClock::Known, search: true, ..FlightFitOptions::default() };
    let fits = FlightFits::of_flight(&vehicle, &inputs, &poses, Some(images), &options).expect("fits");
    assert!(fits.refusals.is_empty(), "{:?}", fits.refusals);
    for (name, fit) in fits.named() {
        let drag = fit.parameter("d_xy").unwrap_or_else(|| panic!("{name}: {:?}", fit.notes));
        assert!((drag.value - DRAG_N_S_M).abs() < 3.5 * drag.std && drag.std < 0.02, "{name}: {drag:?}");
    }
    let notes = &fits.poses.as_ref().expect("a fit").notes;
    assert!(notes[0].starts_with("Added d_xy, drag along x and y"), "{notes:?}");
    let image = &fits.image.as_ref().expect("a fit").notes;
    assert!(image.iter().all(|note| !note.contains("dded")), "{image:?}");
}

#[test]
fn some_instants_of_images_see_what_all_of_them_do_there() {
    let vehicle = Vehicle::paper();
    let (_, states) = flown(&vehicle, &multisine(1.0));
    let (rig, markers) = (rig(), markers(&vehicle));
    let mut random = Random::new(3, 0);
    let mut observations = seen(&states, (&rig, &markers), 0.1, &mut random, |_, _| Vector2::zeros());
    // Instants that hold unlike numbers of observations.
    observations.retain(|o| o.marker != 1 || o.t_ns % 4 != 0);
    let all = ImageMeasurements::new(&rig, &markers, &observations).expect("images");
    let all = Measurements::Image(all.with_marker_positions(5e-4));
    let instants = [2, 3, 7, 11, 20];
    let part = all.at(&instants);
    let times_s = all.times_s();
    assert_eq!(part.times_s(), instants.map(|i| times_s[i]));
    assert_eq!(part.nuisances(), all.nuisances());
    assert!(matches!(part, Measurements::Image(_)));
    let y = [0.0, 0.0, 1.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for (k, instant) in instants.into_iter().enumerate() {
        let (own, whole) = (part.rows(k, &y).expect("rows"), all.rows(instant, &y).expect("rows"));
        assert!(!own.is_empty() && own.len() == whole.len());
        for (a, b) in own.iter().zip(&whole) {
            assert_eq!((a.residual, a.channel, a.directions), (b.residual, b.channel, b.directions));
        }
    }
}
