//! Boards with markers, printed and found by OpenCV, of which bent lenses see a part.

use crate::lab::Lab;
use crate::python::check;
use mavsight::geometry::{BrownConrady, Vector2};
use mavsight::session::{read_image, read_rig};
use mavsight::vision::{CodedBoard, find_coded_board};
use serde_json::{Value, json};

const FOCAL_PX: f64 = 457.0;
const SQUARE_M: f64 = 0.04;
const APART_M: [f64; 3] = [-0.25, 0.01, 0.05];

fn printed(name: &str, corners: (usize, usize), dictionary: &str, share: f64, legacy: bool) -> Value {
    json!({
        "name": name, "columns": corners.0, "rows": corners.1, "dictionary": dictionary, "legacy": legacy,
        "square_m": SQUARE_M, "marker_m": share * SQUARE_M,
    })
}

#[test]
fn boards_of_opencv_calibrate_two_cameras_that_see_a_part_of_them() {
    let lab = Lab::new(BrownConrady::default());
    let boards = [
        printed("small", (8, 5), "DICT_5X5_100", 0.75, false),
        printed("tags", (8, 6), "DICT_APRILTAG_36h11", 0.8, false),
        printed("old", (7, 7), "DICT_4X4_50", 0.7, true),
        printed("six", (8, 6), "DICT_6X6_250", 0.78, false),
    ];
    let film = json!({
        "size": [640, 480], "camera": [[FOCAL_PX, 0, 322.0], [0, FOCAL_PX, 236.0], [0, 0, 1]],
        "lens": [-0.25, 0.08, 0, 0, 0], "boards": boards, "apart_turn": [0.02, 0.3, -0.01], "apart_m": APART_M,
    });
    if !check("boards", &lab, &film) {
        return;
    }
    let theirs: Value = serde_json::from_str(&lab.read("corners.json")).expect("their corners");
    for board in &boards {
        let text = |key: &str| board[key].as_str().expect("text").to_owned();
        let number = |key: &str| board[key].as_u64().expect("a number") as usize;
        let share = board["marker_m"].as_f64().expect("a length") / SQUARE_M;
        let own = CodedBoard::new((number("columns"), number("rows")), share, &text("dictionary"))
            .expect("a board");
        let name = text("name");
        let found = find_coded_board(&read_image(&lab.path(&format!("{name}.png"))).expect("an image"), &own);
        let theirs: Vec<Vec<f64>> = serde_json::from_value(theirs[&name].clone()).expect("their corners");
        let apart = theirs.iter().filter_map(|corner| {
            let [k, u, v] = corner[..] else { return None };
            let same = found.iter().find(|(n, _)| *n == k as usize)?;
            Some((same.1.pixel - Vector2::new(u, v)).norm())
        });
        let apart: Vec<f64> = apart.collect();
        let worst_px = apart.iter().copied().fold(0.0, f64::max);
        println!(
            "{name}: {} corners, OpenCV {}, {} in common, {worst_px:.2} px",
            found.len(),
            theirs.len(),
            apart.len()
        );
        assert!(apart.len() >= 10 && 10 * apart.len() >= 8 * theirs.len() && worst_px < 1.0, "{name}");
    }
    calibrates(&lab);
}

/// Both cameras at once, of a board seen in part, through the session file.
fn calibrates(lab: &Lab) {
    let camera = |k: usize| {
        format!(
            "[[camera]]\nname = \"cam{k}\"\nvideo = \"cam{k}-%02d.png\"\nframe_rate_hz = 1.0\nboard = \"cam{k}-%02d.png\"\n"
        )
    };
    let board = format!(
        "[board]\ncolumns = 8\nrows = 5\nsquare_m = {SQUARE_M}\ntogether = true\ndictionary = \"DICT_5X5_100\"\nmarker_m = 0.03\n"
    );
    let head = "schema = 1\nname = \"boards\"\nvehicle = \"vehicle.toml\"\n";
    lab.write("session.toml", format!("{head}{board}{}{}", camera(1), camera(2)));
    let output = lab.stage("calibrate session.toml --out .");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let rig = read_rig(&lab.path("rig.toml")).expect("a rig");
    for c in &rig.cameras {
        let (focal_px, lens) = (c.camera.intrinsics.fx_px, c.camera.distortion);
        println!("{}: {focal_px:.2} px, k1 {:.4}, k2 {:.4}", c.name, lens.k1, lens.k2);
        assert!((focal_px / FOCAL_PX - 1.0).abs() < 0.002, "{focal_px}");
        assert!((lens.k1 + 0.25).abs() < 0.01, "{}", lens.k1);
    }
    let [a, b] = [0, 1].map(|k| rig.cameras[k].camera.centre_in_world());
    let apart_m = APART_M.iter().map(|x| x * x).sum::<f64>().sqrt();
    println!("{:.2} mm apart, {:.2} mm", 1e3 * (a - b).norm(), 1e3 * apart_m);
    assert!(((a - b).norm() / apart_m - 1.0).abs() < 0.002);
}
