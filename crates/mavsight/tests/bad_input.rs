//! Input that a user may get wrong ends the program with one message that names the file and the place, and with no results.
//! What is wrong with a file by itself is refused by its reader, and tested there.

mod common;

use common::{Session, mavsight};

#[test]
fn the_unspoilt_session_runs() {
    let session = Session::new();
    let out = session.path("results");
    mavsight().arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
    for file in ["rig.toml", "markers.csv", "pose.csv", "motion.csv", "summary.json", "report.html"] {
        assert!(out.join(file).is_file(), "{file} is missing");
    }
}

/// What an earlier flight left is not this one's.
#[test]
fn nothing_of_an_earlier_run_remains() {
    let session = Session::new();
    let (out, parameters) = (session.path("results"), session.path("results/parameters.csv"));
    std::fs::create_dir(&out).expect("a folder");
    std::fs::write(&parameters, "of another flight").expect("written");
    session.replace("session.toml", "inputs = \"inputs.csv\"\n", "");
    mavsight().arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
    assert!(!parameters.exists() && out.join("motion.csv").is_file());
}

#[test]
fn who_stops_reading_ends_no_command_with_a_panic() {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_mavsight"))
        .args(["simulate", "--print-scenario"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the program");
    drop(child.stdout.take());
    let ended = child.wait_with_output().expect("it ends");
    assert!(ended.status.success() && ended.stderr.is_empty(), "{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn results_into_a_file() {
    let session = Session::new();
    std::fs::write(session.path("taken"), "").expect("written");
    let assert = mavsight()
        .arg("run")
        .arg(session.path("session.toml"))
        .arg("--out")
        .arg(session.path("taken"))
        .assert()
        .code(2);
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("taken: is a file"), "{said}");
}

#[test]
fn a_recording_of_another_size_than_the_still() {
    let session = Session::new();
    let size = mavsight_geometry::ImageSize { width_px: 64, height_px: 48 };
    let small = mavsight_vision::Frame::from_rgb(size, vec![90; 64 * 48 * 3]).expect("a frame");
    for frame in std::fs::read_dir(session.path("cam1")).expect("frames") {
        mavsight_session::write_png(&frame.expect("a frame").path(), &small).expect("written");
    }
    session.is_refused(&["cam1", "64×48", "calibrate it at the size it films in"]);
}

#[test]
fn a_missing_session_file() {
    let assert = mavsight().args(["run", "nowhere/session.toml", "--out", "never"]).assert().code(2);
    let message = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(message.contains("nowhere/session.toml"), "{message}");
}

#[test]
fn a_nan_in_row_17() {
    let session = Session::new();
    session.edit_lines("inputs.csv", |lines| {
        let mut cells: Vec<&str> = lines[17].split(',').collect();
        cells[3] = "NaN";
        lines[17] = cells.join(",");
    });
    session.is_refused(&["inputs.csv", "17", "delta_lon_rad"]);
}

#[test]
fn fewer_than_six_control_points() {
    let session = Session::new();
    session.edit_lines("control_points.csv", |lines| lines.truncate(6));
    session.is_refused(&["5", "6", "control"]);
}

#[test]
fn coplanar_control_points() {
    let session = Session::new();
    let pixels =
        [(100.0, 100.0), (300.0, 90.0), (500.0, 110.0), (120.0, 300.0), (310.0, 330.0), (520.0, 310.0)];
    let mut points = String::from("name,x_m,y_m,z_m,diameter_m,color\n");
    let mut seen = String::from("camera,name,u_px,v_px\n");
    for (k, (u, v)) in pixels.iter().enumerate() {
        points += &format!("p{k},{},{},0.0,0.06,#20{k}080\n", k % 3, k / 3);
        seen += &format!("cam1,p{k},{u},{v}\ncam2,p{k},{u},{v}\n");
    }
    std::fs::write(session.path("control_points.csv"), points).expect("written");
    std::fs::write(session.path("control_pixels.csv"), seen).expect("written");
    session.replace("session.toml", "[control]", "[control]\nobservations = \"control_pixels.csv\"");
    session.is_refused(&["coplanar", "cam1"]);
}

/// They were to check colours and positions in the table, whichever it was.
#[test]
fn a_left_handed_table_and_a_mirrored_image() {
    let session = Session::new();
    session.edit_lines("control_points.csv", |lines| {
        for line in &mut lines[1..] {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            cells[2] = (-cells[2].parse::<f64>().expect("a number")).to_string();
            *line = cells.join(",");
        }
    });
    session.is_refused(&["left-handed"]);
    let session = Session::new();
    let still = session.path("cam2-control.png");
    let image = mavsight::session::read_image(&still).expect("an image");
    let width = image.size.width_px as usize;
    let rows = image.to_rgb();
    let mirrored = rows.chunks(3 * width).flat_map(|row| row.chunks(3).rev().flatten().copied()).collect();
    let mirrored = mavsight::vision::Frame::from_rgb(image.size, mirrored).expect("an image");
    mavsight::session::write_png(&still, &mirrored).expect("written");
    session.is_refused(&["cam2", "mirrored"]);
}

#[test]
fn a_camera_without_frames() {
    let session = Session::new();
    for entry in std::fs::read_dir(session.path("cam2")).expect("a folder").flatten() {
        std::fs::remove_file(entry.path()).expect("removed");
    }
    session.is_refused(&["cam2"]);
}

#[test]
fn two_markers_of_one_name() {
    let session = Session::new();
    session.replace("vehicle.toml", "name = \"green\"", "name = \"red\"");
    session.is_refused(&["markers 1 and 2", "red", "its own name"]);
}

#[test]
fn markers_on_one_line() {
    let session = Session::new();
    let vehicle = std::fs::read_to_string(session.path("vehicle.toml")).expect("the file is there");
    let places = vehicle.lines().filter(|line| line.starts_with("position_m"));
    for (k, place) in places.enumerate() {
        session.replace("vehicle.toml", place, &format!("position_m = [{k}.0, 0.5, 0.0]"));
    }
    session.is_refused(&["on one line", "position_m"]);
}

#[test]
fn a_truncated_mp4() {
    let session = Session::new();
    let Some(clip) = fixture_mp4() else {
        println!("skipped: the MP4 fixture is missing");
        return;
    };
    std::fs::write(session.path("cam1.mp4"), &clip[..clip.len() / 2]).expect("written");
    session.replace("session.toml", "cam1/frame_%05d.png", "cam1.mp4");
    drop_frame_rate_of_cam1(&session);
    session.is_refused(&["cam1.mp4"]);
}

#[test]
fn a_container_that_needs_ffmpeg_without_it() {
    let session = Session::new();
    std::fs::write(session.path("cam1.avi"), b"RIFF\x00\x00\x00\x00AVI LIST").expect("written");
    session.replace("session.toml", "cam1/frame_%05d.png", "cam1.avi");
    drop_frame_rate_of_cam1(&session);
    session.is_refused_with(&["cam1.avi", "ffmpeg", "apt-get install ffmpeg"], |c| {
        c.env("MAVSIGHT_FFMPEG", "no-such-program")
    });
}

fn fixture_mp4() -> Option<Vec<u8>> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../session/tests/fixtures");
    let entry = std::fs::read_dir(folder)
        .ok()?
        .flatten()
        .find(|e| e.path().extension().is_some_and(|x| x == "mp4"))?;
    std::fs::read(entry.path()).ok()
}

fn drop_frame_rate_of_cam1(session: &Session) {
    session.edit_lines("session.toml", |lines| {
        if let Some(at) = lines.iter().position(|line| line.starts_with("frame_rate_hz")) {
            lines.remove(at);
        }
    });
}
