//! Session files and tables: what is read, and what is refused with file, row and column.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Folder, data};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::ImageSize;
use mavsight_model::Model;
use mavsight_pipeline::{ControlPointRow, Refinement};
use mavsight_session::tables::{read_control_pixels, read_control_points, read_inputs};
use mavsight_session::{
    ControlSection, Session, SessionCamera, SessionFile, load_equations, load_vehicle, write_control_points,
    write_inputs, write_toml, write_vehicle,
};
use std::path::{Path, PathBuf};

/// Images of the board in a phone's other mode were taken for what it films in: "cam2 was moved by 242 px".
#[test]
fn a_board_of_another_size_than_the_flight_is_refused() {
    let folder = Folder::new();
    let path = session(&folder);
    let still = |width_px, height_px| {
        let size = ImageSize { width_px, height_px };
        let frame = mavsight_vision::Frame::from_rgb(size, vec![128; 3 * size.area_px()]).unwrap();
        mavsight_session::write_png(&folder.path("still.png"), &frame).unwrap();
        size
    };
    still(1280, 720);
    let mut session = Session::load(&path).unwrap();
    session.file.camera[0].video = PathBuf::new();
    let size = |width_px, height_px| ImageSize { width_px, height_px };
    session.require_size_of("board", 0, size(1280, 720)).unwrap();
    let why = session.require_size_of("board", 0, size(640, 360)).unwrap_err().to_string();
    assert!(why.contains("cam1") && why.contains("640×360") && why.contains("1280×720"), "{why}");
}

const POINTS: &str = "name,x_m,y_m,z_m,diameter_m,color\na,0,0,0,0.06,#c83030\nb,1,0,0,0.06,#2c9030\n";

fn inputs() -> InputSeries {
    let names = ["omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"].map(str::to_owned);
    let row = |k: usize| [214.5 + 0.125 * k as f64, 214.25, 0.01 * k as f64, -0.5];
    let times_s = (0..30).map(|k| 0.01 * k as f64).collect();
    InputSeries::new(names, times_s, (0..30).flat_map(row).collect()).unwrap()
}

fn session(folder: &Folder) -> PathBuf {
    let camera = |name: &str| SessionCamera {
        name: name.into(),
        video: format!("{name}/frame_%05d.png").into(),
        still: Some("still.png".into()),
        wand: None,
        board: None,
        frame_rate_hz: Some(30.0),
        ..SessionCamera::default()
    };
    let file = SessionFile {
        schema: 1,
        name: "test".into(),
        vehicle: "vehicle.toml".into(),
        inputs: "inputs.csv".into(),
        log: None,
        sensors: None,
        model: None,
        truth: None,
        control: Some(ControlSection { points: "points.csv".into(), observations: None }),
        wand: None,
        board: None,
        rig: None,
        flash: false,
        clap: false,
        refine: Some(Refinement { markers_std_m: Some(0.002), ..Refinement::default() }),
        live: None,
        camera: vec![camera("cam1"), camera("cam2")],
    };
    folder.write("points.csv", POINTS);
    folder.write("still.png", "");
    write_inputs(&folder.path("inputs.csv"), &inputs()).unwrap();
    write_toml(&folder.path("vehicle.toml"), &Vehicle::paper()).unwrap();
    write_toml(&folder.path("session.toml"), &file).unwrap();
    folder.path("session.toml")
}

/// The message that a session ends with when some text of one of its files is replaced.
fn spoilt(file: &str, from: &str, to: &str) -> String {
    let folder = Folder::new();
    let path = session(&folder);
    let text = std::fs::read_to_string(folder.path(file)).unwrap();
    assert!(text.contains(from), "{file} has no {from:?}:\n{text}");
    folder.write(file, text.replacen(from, to, 1));
    Session::load(&path).unwrap_err().to_string()
}

fn has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
fn paper_flight_is_read() {
    let Some(flight) = data("paper-flight") else { return };
    let session = Session::load(&flight.join("session.toml")).unwrap();
    assert_eq!((session.file.name.as_str(), session.cameras().len()), ("paper-flight", 2));
    assert_eq!(session.vehicle.marker[3].color.rgb(), [0xd8, 0xbc, 0x30]);
    let points = session.control_points().unwrap();
    assert_eq!((points.len(), points[7].name.as_str()), (8, "violet"));
    assert_eq!(points[7].position_m, [-1.5, 1.5, 3.0]);
    let inputs = session.inputs().unwrap().unwrap();
    assert_eq!(inputs.column("omega_u_rad_s").unwrap()[0], 214.719989849);
}

#[test]
fn what_is_written_is_read() {
    let folder = Folder::new();
    let file = session(&folder);
    let session = Session::load(&file).unwrap();
    assert_eq!(Session::load(file.parent().unwrap()).unwrap(), session, "a folder is its session.toml");
    assert_eq!(session.vehicle, Vehicle::paper());
    assert_eq!(session.cameras()[1].video, folder.path("cam2/frame_%05d.png"));
    let (got, want) = (session.inputs().unwrap().unwrap(), inputs());
    assert_eq!((got.names(), got.times_s().len()), (want.names(), 30));
    for k in 0..30 {
        let values = got.row(k).iter().zip(want.row(k)).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(values && (got.times_s()[k] - want.times_s()[k]).abs() < 1e-12);
    }
    assert_eq!(load_vehicle(&folder.path("vehicle.toml")).unwrap(), Vehicle::paper());
}

#[test]
fn a_session_takes_its_inputs_from_a_log() {
    let folder = Folder::new();
    let path = session(&folder);
    let text = std::fs::read_to_string(&path).unwrap();
    let map = inputs()
        .names()
        .iter()
        .map(|c| format!("{{ column = \"{c}\", field = \"{c}\" }}"))
        .collect::<Vec<_>>();
    let log = format!("log = {{ file = \"inputs.csv\", input = [{}] }}", map.join(", "));
    let with = |log: &str| folder.write("session.toml", text.replacen("inputs = \"inputs.csv\"", log, 1));
    with(&log);
    let got = Session::load(&path).unwrap().inputs().unwrap().unwrap();
    assert_eq!((got.names(), got.times_s().len(), got.row(7)), (inputs().names(), 30, inputs().row(7)));
    let refusal = |log: &str| {
        with(log);
        Session::load(&path).unwrap_err().to_string()
    };
    has(
        &refusal(&format!("inputs = \"inputs.csv\"\n{log}")),
        &["session.toml: inputs", "leave one of them out"],
    );
    has(&refusal("log = { file = \"none.ulg\" }"), &["none.ulg", "log.file in"]);
    has(&refusal("log = { file = \"inputs.csv\", preset = \"px5\" }"), &["px5", "px4-motors"]);
    let twice = log.replace("column = \"omega_l_rad_s\"", "column = \"omega_u_rad_s\"");
    has(&refusal(&twice), &["log.input 2: column", "taken"]);
}

#[test]
fn a_vehicle_is_read_and_written_with_the_model_beside_it() {
    let folder = Folder::new();
    let text = "schema = 2\nname = \"sphere\"\n[parameters]\nc = { value = 1 }\n[forces]\nx = \"-c*u\"\n";
    // A name of the shelf does not make it the shelf's.
    for name in ["own.toml", "coaxial.toml"] {
        let model = Model::parse(&format!("../models/{name}"), text).unwrap().into();
        let parameters = [("c".to_owned(), 0.5)].into();
        let vehicle = Vehicle { model, parameters, simulation: Default::default(), ..Vehicle::paper() };
        write_vehicle(&folder.path("own-vehicle.toml"), &vehicle).unwrap();
        assert_eq!(std::fs::read_to_string(folder.path(name)).unwrap(), text);
        let read = load_vehicle(&folder.path("own-vehicle.toml")).unwrap();
        assert_eq!(read, vehicle);
        assert_eq!(read.model.name, "sphere");
        std::fs::write(folder.path(name), text.replace("-c*u", "-c*b")).unwrap();
        let refused = load_vehicle(&folder.path("own-vehicle.toml")).unwrap_err().to_string();
        assert!(refused.contains(&format!("{name}, line 6, column")), "{refused}");
        std::fs::remove_file(folder.path(name)).unwrap();
        let refused = load_vehicle(&folder.path("own-vehicle.toml")).unwrap_err().to_string();
        assert!(refused.contains(name) && refused.contains("own-vehicle.toml"), "{refused}");
    }
}

#[test]
fn names_with_commas_quotes_and_what_makes_comments_are_read_back() {
    let folder = Folder::new();
    let point = |name: &str| ControlPointRow {
        name: name.into(),
        position_m: [1.0, 2.0, 3.0],
        diameter_m: 0.06,
        color: "#c83030".to_owned().try_into().unwrap(),
        std_m: 0.0,
    };
    let points = ["left, upper", "#1", "the \"near\" one", "plain"].map(point);
    write_control_points(&folder.path("p.csv"), &points).unwrap();
    assert_eq!(read_control_points(&folder.path("p.csv")).unwrap(), points);
}

#[test]
fn missing_files_are_named_with_their_key() {
    let folder = Folder::new();
    has(
        &Session::load(&folder.path("session.toml")).unwrap_err().to_string(),
        &["session.toml", "no such file"],
    );
    for (file, key) in [("inputs.csv", "inputs"), ("points.csv", "control.points"), ("still.png", "cam1")] {
        let folder = Folder::new();
        let path = session(&folder);
        std::fs::remove_file(folder.path(file)).unwrap();
        has(&Session::load(&path).unwrap_err().to_string(), &[file, key, "session.toml"]);
    }
    has(&spoilt("session.toml", "cam2/frame_%05d.png", "cam2.mp4"), &["cam2.mp4", "camera cam2"]);
}

#[test]
fn unknown_and_senseless_keys_are_named() {
    has(&spoilt("session.toml", "vehicle =", "vehicel ="), &["session.toml", "line 3", "vehicel"]);
    has(&spoilt("session.toml", "still =", "stil ="), &["session.toml", "stil", "line"]);
    has(&spoilt("vehicle.toml", "mass_kg", "weight_kg"), &["vehicle.toml", "line 2", "weight_kg"]);
    has(&spoilt("vehicle.toml", "mass_kg = 0.8", "mass_kg = -0.8"), &["vehicle.toml", "mass_kg", "-0.8"]);
    has(&spoilt("vehicle.toml", "#db1212", "reddish"), &["vehicle.toml", "line", "reddish", "#rrggbb"]);
    has(&spoilt("session.toml", "schema = 1", "schema = 9"), &["session.toml", "schema", "9", "1"]);
    has(&spoilt("session.toml", "\"cam2\"", "\"cam1\""), &["session.toml", "camera 2", "cam1"]);
    has(&spoilt("session.toml", "= 0.002", "= 0.0"), &["refine.markers_std_m", "ruler"]);
    has(&spoilt("session.toml", "30.0", "-3.0"), &["frame_rate_hz", "-3", "cam1"]);
    has(&spoilt("session.toml", "still = \"still.png\"", ""), &["still", "cam1", "control.observations"]);
}

/// A session with a section more, and something more for each camera.
fn with(section: &str, of_camera: &str) -> Result<Session, String> {
    let folder = Folder::new();
    let path = session(&folder);
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text.replace("[refine]", &format!("{section}\n[refine]"));
    let text = text.replace("still = ", &format!("{of_camera}\nstill = "));
    std::fs::write(&path, text).unwrap();
    Session::load(&path).map_err(|e| e.to_string())
}

#[test]
fn wands_and_boards_are_read_and_senseless_ones_named() {
    let wand = |length: &str, balls: usize| {
        let ball = ["{ color = \"#db1212\", diameter_m = 0.04 }"; 3][..balls].join(", ");
        format!("[wand]\nlength_m = {length}\nball = [{ball}]")
    };
    let own = "wand = \"still.png\"";
    let session = with(&wand("0.5", 2), own).unwrap();
    let read = session.file.wand.as_ref().unwrap();
    assert_eq!((read.length_m, read.length_std_m, read.ball.len()), (0.5, 0.0, 2));
    assert_eq!(session.cameras()[1].wand, session.cameras()[1].still);
    has(&with(&wand("0.0", 2), own).unwrap_err(), &["wand.length_m", "0 is no length"]);
    has(
        &with(&format!("{}\nlength_std_m = 0.7", wand("0.5", 2)), own).unwrap_err(),
        &["wand.length_std_m", "0.7"],
    );
    has(&with(&wand("0.5", 3), own).unwrap_err(), &["wand.ball", "3 given", "two balls"]);
    has(&with(&wand("0.5", 2), "").unwrap_err(), &["camera: wand", "fewer than two"]);
    has(&with(&wand("0.5", 2), "wand = \"none.mp4\"").unwrap_err(), &["wand of camera cam1", "none.mp4"]);
    let board = |columns: usize, rest: &str| format!("[board]\ncolumns = {columns}\nrows = 6\n{rest}");
    let own = "board = \"still.png\"";
    assert_eq!(with(&board(9, "square_m = 0.03"), own).unwrap().file.board.unwrap().columns, 9);
    has(&with(&board(6, "square_m = 0.03"), own).unwrap_err(), &["board.columns", "6 by 6"]);
    has(&with(&board(9, "square_m = -1"), own).unwrap_err(), &["board.square_m", "-1"]);
    has(
        &with(&board(8, "square_m = 0.03\ntogether = true"), own).unwrap_err(),
        &["board.together", "9 by 6"],
    );
    has(&with(&board(9, "square_m = 0.03"), "").unwrap_err(), &["camera: board", "no camera"]);
    let markers = |rest: &str| with(&board(6, &format!("square_m = 0.03\n{rest}")), own);
    let name = "dictionary = \"DICT_4X4_50\"";
    let file = markers(&format!("{name}\nmarker_m = 0.022\ntogether = true")).unwrap();
    assert!(file.file.board.unwrap().coded().unwrap().is_some());
    has(&markers(name).unwrap_err(), &["board.marker_m", "side of a marker"]);
    has(&markers("marker_m = 0.022").unwrap_err(), &["board.dictionary", "DICT_4X4_50"]);
    has(&markers(&format!("{name}\nmarker_m = 0.03")).unwrap_err(), &["board.marker_m", "1.00 of a square"]);
    has(&markers("dictionary = \"ARUCO\"\nmarker_m = 0.02").unwrap_err(), &["`ARUCO`", "DICT_5X5"]);
    has(&spoilt("session.toml", "[control]\npoints = \"points.csv\"", ""), &["control", "[wand]", "[rig]"]);
    has(&with("[rig]\nfile = \"rig.toml\"", "").unwrap_err(), &["rig", "the cameras already"]);
    let rig = |file: &str| {
        spoilt("session.toml", "[control]\npoints = \"points.csv\"", &format!("[rig]\nfile = \"{file}\""))
    };
    has(&rig("none.toml"), &["rig.file", "none.toml"]);
    has(&spoilt("session.toml", "markers_std_m = 0.002", ""), &["refine", "asks for nothing"]);
    let [asks, diameters] = ["markers_std_m = 0.002\ndiameters = false", "rig = false\ndiameters = true"];
    has(&spoilt("session.toml", asks, diameters), &["refine", "asks for nothing"]);
}

#[test]
fn one_camera_is_too_few() {
    let folder = Folder::new();
    let path = session(&folder);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &text[..text.rfind("[[camera]]").unwrap()]).unwrap();
    has(&Session::load(&path).unwrap_err().to_string(), &["session.toml", "camera", "1 found", "at least 2"]);
}

#[test]
fn a_nan_in_row_17_is_found() {
    let folder = Folder::new();
    session(&folder);
    let text = std::fs::read_to_string(folder.path("inputs.csv")).unwrap();
    for bad in ["NaN", "inf", "fast", ""] {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let mut cells: Vec<&str> = lines[17].split(',').collect();
        cells[3] = bad;
        lines[17] = cells.join(",");
        let error = read_inputs(&folder.write("spoilt.csv", lines.join("\n")), &Vehicle::paper())
            .unwrap_err()
            .to_string();
        has(&error, &["spoilt.csv", "row 17", "line 18", "delta_lon_rad"]);
    }
}

#[test]
fn tables_that_are_none_are_refused() {
    let folder = Folder::new();
    let read = |content: &str| {
        read_inputs(&folder.write("t.csv", content), &Vehicle::paper()).unwrap_err().to_string()
    };
    let header = "t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad";
    has(
        &read("t_s,omega_u_rad_s,omega_l_rad_s,delta_long_rad,delta_lat_rad\n0,1,1,0,0\n"),
        &["t.csv", "\"delta_lon_rad\"", "delta_long_rad"],
    );
    has(&read(&format!("{header}\n")), &["t.csv", "no rows"]);
    has(&read(""), &["t.csv", "t_s"]);
    has(&read(&format!("{header}\n0,1,1,0,0\n1,1,1\n")), &["t.csv", "line 3", "3 cells", "5"]);
    has(&read(&format!("{header}\n0,1,1,0,0\n0,1,1,0,0\n")), &["t.csv", "row 2"]);
    let reordered =
        "delta_lat_rad, t_s ,omega_u_rad_s,note,omega_l_rad_s,delta_lon_rad\n5,0,1,x,2,3\n6,1,1,,2,3\n";
    let series =
        read_inputs(&folder.write("t.csv", format!("\u{feff}{reordered}")), &Vehicle::paper()).unwrap();
    assert_eq!((series.times_s()[1], series.column("delta_lat_rad").unwrap()[1]), (1.0, 6.0));
}

#[test]
fn control_tables_are_checked() {
    let folder = Folder::new();
    let read = |content: &str| read_control_points(&folder.write("p.csv", content)).unwrap_err().to_string();
    has(&read(&POINTS.replace("#2c9030", "greenish")), &["p.csv", "row 2", "color", "greenish", "#rrggbb"]);
    has(&read(&POINTS.replace("b,1", "a,1")), &["p.csv", "row 2", "name", "\"a\""]);
    has(&read(&POINTS.replace("0.06,#2", "-0.06,#2")), &["p.csv", "row 2", "diameter_m", "-0.06"]);
    has(&read(&POINTS.replace("0.06,#2", "60,#2")), &["p.csv", "row 2", "60 m", "in metres"]);
    let read = |content: &str| {
        let path = folder.write("x.csv", format!("camera,name,u_px,v_px\n{content}"));
        read_control_pixels(&path, &["cam1"], &["a", "b"])
    };
    assert_eq!(read("cam1,a,1.5,2\ncam1,b,3,4\n").unwrap()[0].u_px, 1.5);
    has(&read("cam9,a,1,2\n").unwrap_err().to_string(), &["x.csv", "row 1", "camera", "cam9", "cam1"]);
    has(&read("cam1,c,1,2\n").unwrap_err().to_string(), &["x.csv", "row 1", "name", "\"c\"", "a, b"]);
    has(&read("cam1,a,1,2\ncam1,a,1,2\n").unwrap_err().to_string(), &["x.csv", "row 2", "twice"]);
}

#[test]
fn every_column_of_numbers_is_an_input() {
    let folder = Folder::new();
    let read = |content: &str| read_inputs(&folder.write("t.csv", content), &Vehicle::paper());
    let own = "t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad";
    let series = read(&format!("{own},aileron,remark\n0,1,2,3,4,0.5,go\n1,1,2,3,4,0.7,\n")).unwrap();
    assert_eq!(series.names().len(), 5, "words are no input");
    assert_eq!((series.names()[4].as_str(), series.row(1)[4]), ("aileron", 0.7));
    write_inputs(&folder.path("again.csv"), &series).unwrap();
    assert_eq!(read_inputs(&folder.path("again.csv"), &Vehicle::paper()).unwrap(), series);
    // Another aircraft's table has none of the helicopter's columns.
    let series = read("t_s,omega_1,omega_2\n0,1,2\n0.5,3,4\n").unwrap();
    assert_eq!((series.names().len(), series.column("omega_2").unwrap()), (2, vec![2.0, 4.0]));
    has(&read("t_s,a,a\n0,1,2\n1,2,3\n").unwrap_err().to_string(), &["t.csv", "two columns", "named a"]);
    // With some of them, the others are missed; with nothing else, all are.
    for header in ["t_s,omega_u_rad_s,omega_1\n0,1,2\n1,2,3\n", "t_s\n0\n1\n"] {
        let error = read(header).unwrap_err().to_string();
        assert!(error.contains("omega_l_rad_s") || error.contains("omega_u_rad_s"), "{error}");
    }
}

#[test]
fn a_model_file_is_named_when_it_is_wrong() {
    let folder = Folder::new();
    let model = folder.write("model.toml", "schema = 3\nname = \"m\"\noutput = []");
    let error = load_equations(&model).unwrap_err().to_string();
    assert!(error.contains("model.toml") && error.contains("schema is 3"), "{error}");
    let error = load_equations(&folder.path("none.toml")).unwrap_err().to_string();
    assert!(error.contains("none.toml"), "{error}");
}

/// In one a column has a negative length, in the other a page needs a dictionary that is not there.
#[cfg(feature = "parquet")]
#[test]
fn parquet_files_whose_parts_contradict_each_other_are_refused() {
    let files =
        [("negative-length.parquet", "holds more than the file"), ("no-dictionary.parquet", "contradict")];
    for (name, why) in files {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
        let said = read_control_points(&path).unwrap_err().to_string();
        assert!(said.contains(name) && said.contains(why) && said.contains("convert it to CSV"), "{said}");
    }
}
