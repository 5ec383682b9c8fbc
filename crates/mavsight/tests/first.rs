//! From videos, stills and a tape measure's distances to poses in three commands.

mod common;

use common::{Session, mavsight};
use mavsight::geometry::Vector3;
use mavsight::session::{self, Y4mWriter, read_control_points};
use std::fmt::Write;

/// The short flight as two videos and a table of distances; the flags of `new` but for the folder.
fn recorded(flight: &Session) -> Vec<String> {
    let loaded = session::Session::load(&flight.path("session.toml")).expect("a session");
    let (mut films, mut stills) = (vec!["--from".to_owned()], vec!["--still".to_owned()]);
    for (k, camera) in loaded.cameras().iter().enumerate() {
        let path = flight.path(&format!("{}.y4m", camera.name));
        let mut film = Y4mWriter::create(&path, 30.0).expect("a film");
        for frame in loaded.open_camera(k).expect("a camera") {
            let (t_ns, frame) = frame.expect("a frame");
            film.push(t_ns, &frame).expect("written");
        }
        films.push(path.display().to_string());
        stills.push(camera.still.as_ref().expect("a still").display().to_string());
    }
    let control = &loaded.file.control.as_ref().expect("control").points;
    let mut points = read_control_points(control).expect("points");
    // The first three counter-clockwise as seen from above.
    let away = |k: usize| Vector3::from(points[k].position_m) - Vector3::from(points[0].position_m);
    if away(1).cross(&away(2)).z < 0.0 {
        points.swap(0, 1);
    }
    let mut table = "from,to,distance_m,std_m\n".to_owned();
    for (k, a) in points.iter().enumerate() {
        writeln!(table, "{},floor,{:.4},", a.name, a.position_m[2]).expect("a row");
        for b in &points[..k] {
            let apart_m = (Vector3::from(a.position_m) - Vector3::from(b.position_m)).norm();
            writeln!(table, "{},{},{apart_m:.4},", a.name, b.name).expect("a row");
        }
    }
    std::fs::write(flight.path("distances.csv"), table).expect("written");
    let mut flags = films;
    flags.extend(stills);
    flags.extend(
        ["--model", "coaxial", "--mass", "0.8", "--inertia", "6.1e-3,6.26e-3,0.93e-3"].map(str::to_owned),
    );
    for marker in &loaded.vehicle.marker {
        let [x, y, z] = marker.position_m.map(|m| 1e3 * m);
        flags.extend(["--ball".to_owned(), format!("{},{x},{y},{z},{}", marker.name, marker.color)]);
    }
    for point in &points {
        flags.extend(["--control-color".to_owned(), format!("{}={}", point.name, point.color)]);
    }
    let distances = flight.path("distances.csv").display().to_string();
    flags.extend(["--distances".to_owned(), distances]);
    flags.extend(["--inputs".to_owned(), loaded.file.inputs.display().to_string()]);
    flags
}

#[test]
fn three_commands_lead_from_videos_and_distances_to_poses() {
    let flight = Session::new();
    let mut flags = recorded(&flight);
    let dir = flight.path("new");
    let refused = mavsight().arg("new").arg(&dir).args(&flags).assert().failure().code(2);
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(said.contains("--ball-diameter, --control-diameter"), "{said}");
    assert!(!dir.exists(), "nothing is written of what is not whole");
    flags.extend(["--ball-diameter", "50", "--control-diameter", "60"].map(str::to_owned));
    let made = mavsight().arg("new").arg(&dir).args(&flags).assert().success();
    let said = String::from_utf8_lossy(&made.get_output().stdout).into_owned();
    assert!(
        said.contains("8 control points by 36 measured distances")
            && said.contains("Next: mavsight check")
            && said.contains("mavsight pick"),
        "{said}"
    );
    let checked = mavsight().arg("check").arg(&dir).assert().success();
    let said = String::from_utf8_lossy(&checked.get_output().stdout).into_owned();
    assert!(said.contains("poses at 12 of 12 instants") && said.contains("Next: mavsight run"), "{said}");
    let page = std::fs::read_to_string(dir.join("check.html")).expect("a page");
    assert!(page.contains("All is ready") && page.matches("data:image/jpeg").count() > 12, "{}", page.len());
    let results = dir.join("results");
    mavsight().arg("run").arg(dir.join("session.toml")).arg("--out").arg(&results).assert().success();
    // Once more it would write over what may have been edited.
    mavsight().arg("new").arg(&dir).args(&flags).assert().failure().code(2);
}

#[test]
fn a_wrong_answer_of_a_script_names_its_flag() {
    let flight = Session::new();
    let mut flags = recorded(&flight);
    flags.extend(["--ball-diameter", "fifty", "--control-diameter", "60"].map(str::to_owned));
    let refused = mavsight().arg("new").arg(flight.path("new")).args(&flags).assert().failure().code(2);
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(said.contains("--ball-diameter: \"fifty\""), "{said}");
}
