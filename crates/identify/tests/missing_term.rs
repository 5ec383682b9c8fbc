//! Structure search on flights whose aircraft has a drag of 0.1 N s/m that the model lacks, flown by an
//! independent simulator.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{EulerAngles, Matrix6, Vector3, world_from_body};
use mavsight_identify::output_error::{
    FittedParameter, FlightModel, InitialStates, Measurements, NotAdded, OutputErrorOptions,
    StateMeasurement, StructureSearch, search_structure,
};
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("MAVSIGHT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let folder = data.join("missing-term");
    if !folder.is_dir() {
        println!("skipped: {} is not there (set MAVSIGHT_DATA)", folder.display());
        return None;
    }
    Some(folder)
}

/// Names of the columns, and rows.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).expect("a table");
    let mut lines = text.lines();
    let names = lines.next().expect("names").split(',').map(str::to_owned).collect();
    let row = |line: &str| line.split(',').map(|cell| cell.parse().expect("a number")).collect();
    (names, lines.map(row).collect())
}

/// A row has time, then value and standard deviation of each coordinate.
fn pose(row: &[f64]) -> StateMeasurement {
    let angles = EulerAngles { phi_rad: row[7], theta_rad: row[9], psi_rad: row[11] };
    let pose = world_from_body(Vector3::new(row[1], row[3], row[5]), angles);
    let variances = [2, 4, 6, 8, 10, 12].map(|k| row[k] * row[k]);
    StateMeasurement::of_pose((row[0] * 1e9).round() as i64, pose, Matrix6::from_diagonal(&variances.into()))
}

fn search(flight: usize, initial: InitialStates) -> Option<StructureSearch> {
    let folder = folder()?;
    let text = std::fs::read_to_string(folder.join("vehicle.toml")).expect("a vehicle");
    let vehicle: Vehicle = toml::from_str(&text).expect("a vehicle");
    let (names, rows) = table(&folder.join(format!("inputs-{flight}.csv")));
    let times_s = rows.iter().map(|r| r[0]).collect();
    let values = rows.iter().flat_map(|r| &r[1..]).copied().collect();
    let inputs = InputSeries::new(names[1..].to_vec(), times_s, values).expect("inputs");
    let (_, rows) = table(&folder.join(format!("poses-{flight}.csv")));
    let poses = rows.iter().filter(|row| row[0] <= inputs.end_s()).map(|row| pose(row)).collect();
    let model = FlightModel::new(&vehicle, &inputs).expect("a model").with_free_lag();
    let options = OutputErrorOptions { initial, ..OutputErrorOptions::default() };
    Some(search_structure(&model, &inputs, &Measurements::States(poses), &options).expect("a search"))
}

/// That the drag was found and nothing else, and that the intervals hold the truth.
fn check(search: &StructureSearch) {
    let mut names: Vec<&str> = search.added.iter().map(|a| a.fitted.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["d_xy", "d_z"], "{:?}", search.notes());
    let holds = |p: &FittedParameter, truth: f64| (p.ci_low..=p.ci_high).contains(&truth);
    for term in &search.added {
        assert!(holds(&term.fitted, 0.1), "{term}");
        assert!(term.test.p_value < 0.01 && term.held_out_gain > 0.0, "{term}");
        assert!(term.explains.contains("drag"), "{term}");
    }
    let flybar = search.fit.parameter("tau_f").expect("the fly-bar's time constant");
    assert!(holds(flybar, 3.0) && flybar.std < 0.3, "{flybar:?}");
}

#[test]
fn a_drag_that_the_model_lacks_is_found_and_nothing_else() {
    let Some(search) = search(18, InitialStates::Free) else { return };
    check(&search);
    assert_eq!(search.not_added.len(), 3, "{:?}", search.not_added);
    assert!(search.not_added.iter().all(|t| t.reason == NotAdded::NoEvidence), "{:?}", search.not_added);
}

#[test]
fn what_was_added_is_what_the_final_fit_has() {
    let Some(search) = search(20, InitialStates::Free) else { return };
    check(&search);
    for term in &search.added {
        assert_eq!(search.fit.parameter(&term.fitted.name), Some(&term.fitted));
        assert!(search.model.free().contains(&term.fitted.parameter));
    }
    let notes = search.notes();
    assert!(notes[0].starts_with("Added d_xy, drag along x and y: "), "{notes:?}");
    assert!(notes[2].starts_with("Not added: C_m,hub, hub stiffness: chi-square "), "{notes:?}");
}

/// The discs do not begin in trim. Where the fit takes them to, speed stability stands for the drag at first.
#[test]
fn a_first_choice_that_a_later_one_replaces_is_taken_back() {
    let Some(search) = search(12, InitialStates::AsModelled) else { return };
    let added: Vec<&str> = search.added.iter().map(|a| a.fitted.name.as_str()).collect();
    assert_eq!(added, ["d_z", "d_xy"], "{:?}", search.notes());
    let replaced: Vec<&str> =
        search.not_added.iter().filter(|t| t.reason == NotAdded::Replaced).map(|t| t.name.as_str()).collect();
    assert_eq!(replaced, ["C_m,u"], "{:?}", search.notes());
}
