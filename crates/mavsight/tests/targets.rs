//! Printed targets, read back from an independent rendering of their SVG by the program's own detectors.

#![allow(clippy::unwrap_used)]

mod common;

use common::mavsight;
use mavsight::geometry::{Vector2, Vector3};
use mavsight::pipeline::Board;
use mavsight::pose::points_from_distances;
use mavsight::random::Random;
use mavsight::report::board_sheet;
use mavsight::session::DistanceTable;
use mavsight::vision::{BoardCorner, Frame, ImageSize, find_board, find_coded_board};
use resvg::{tiny_skia, usvg};
use std::path::Path;
use tempfile::TempDir;

/// Pixels for a millimetre of paper.
const SCALE: f64 = 3.0;
const SHEETS: [&str; 5] = ["charuco", "chessboard", "wand", "colors", "control-frame"];

/// A sheet as a scanner would have it.
fn scanned(svg: &str) -> Frame {
    let tree = usvg::Tree::from_str(svg, &usvg::Options::default()).unwrap();
    // The tree is in pixels of CSS, 96 an inch.
    let scale = SCALE * 25.4 / 96.0;
    let side = |px: f32| (f64::from(px) * scale).round() as u32;
    let (width_px, height_px) = (side(tree.size().width()), side(tree.size().height()));
    let mut pixels = tiny_skia::Pixmap::new(width_px, height_px).unwrap();
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale as f32, scale as f32), &mut pixels.as_mut());
    let rgb = pixels.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    Frame::from_rgb(ImageSize { width_px, height_px }, rgb).unwrap()
}

fn printed(folder: &Path, words: &[&str]) -> String {
    let done = mavsight().arg("targets").arg(folder).args(words).assert().success();
    String::from_utf8_lossy(&done.get_output().stdout).into_owned()
}

/// Every corner is where squares of so many millimetres have it, on a sheet whose board is in the middle of its width.
fn are_on_the_lattice(found: &[(usize, BoardCorner)], board: &Board, sheet_mm: [f64; 2]) {
    let side_mm = 1e3 * board.square_m;
    let left_mm = 0.5 * (sheet_mm[0] - side_mm * (board.columns + 1) as f64);
    let top_mm = found[0].1.pixel.y / SCALE - side_mm;
    for (k, corner) in found {
        let (i, j) = ((k % board.columns + 1) as f64, (k / board.columns + 1) as f64);
        // The first pixel's centre is 0, half a pixel from the paper's edge.
        let want = Vector2::new(left_mm + side_mm * i, top_mm + side_mm * j) * SCALE - Vector2::new(0.5, 0.0);
        assert!((corner.pixel - want).norm() < 0.1, "corner {k}: {} where {want} must be", corner.pixel);
    }
}

#[test]
fn boards_of_every_family_of_markers_are_read_back_where_they_are() {
    let sheet_mm = [297.0, 210.0];
    for dictionary in [
        "DICT_4X4_1000",
        "DICT_5X5_50",
        "DICT_6X6_250",
        "DICT_7X7_100",
        "DICT_ARUCO_ORIGINAL",
        "DICT_ARUCO_MIP_36h12",
        "DICT_APRILTAG_16h5",
        "DICT_APRILTAG_25h9",
        "DICT_APRILTAG_36h10",
        "DICT_APRILTAG_36h11",
    ] {
        let board = Board {
            columns: 7,
            rows: 5,
            square_m: 0.028,
            dictionary: Some(dictionary.to_owned()),
            marker_m: Some(0.021),
            ..Board::default()
        };
        let sheet = board_sheet(&board, "", sheet_mm).unwrap();
        let found = find_coded_board(&scanned(&sheet.svg()), &board.coded().unwrap().unwrap());
        assert_eq!(found.len(), 35, "{dictionary}");
        are_on_the_lattice(&found, &board, sheet_mm);
    }
}

/// The sections that the command prints describe what it draws.
#[test]
fn printed_boards_are_those_of_the_printed_sections() {
    let folder = TempDir::new().unwrap();
    for (words, sheet_mm) in [
        (vec![], [297.0, 210.0]),
        (vec!["--columns", "5", "--rows", "8", "--paper", "letter"], [215.9, 279.4]),
        (vec!["--square", "33.5", "--marker", "20", "--paper", "a3"], [420.0, 297.0]),
    ] {
        let said = printed(folder.path(), &words);
        let section =
            |of: &str| said.split("\n[").find(|s| s.trim_start_matches('[').starts_with(of)).unwrap();
        let text = section("board]").split_once('\n').unwrap().1;
        let board: Board = toml::from_str(text).unwrap();
        let svg = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let coded = find_coded_board(&scanned(&svg("charuco.svg")), &board.coded().unwrap().unwrap());
        assert_eq!(coded.len(), board.columns * board.rows);
        are_on_the_lattice(&coded, &board, sheet_mm);
        let plain = find_board(&scanned(&svg("chessboard.svg")), board.columns, board.rows).unwrap();
        are_on_the_lattice(&plain.into_iter().enumerate().collect::<Vec<_>>(), &board, sheet_mm);
    }
}

/// Rectangles of a PDF, mm from the upper left corner, and the size of its page.
fn rectangles_of_pdf(pdf: &[u8]) -> (Vec<[f64; 4]>, [f64; 2]) {
    let text = String::from_utf8_lossy(pdf);
    let numbers = |t: &str| t.split_whitespace().filter_map(|n| n.parse::<f64>().ok()).collect::<Vec<_>>();
    let box_pt = numbers(text.split("/MediaBox [").nth(1).unwrap().split(']').next().unwrap());
    let mm = |pt: f64| pt * 25.4 / 72.0;
    let rectangles = text.lines().filter_map(|line| line.strip_suffix(" re")).map(|line| {
        let [x, y, width, height]: [f64; 4] = numbers(line).try_into().unwrap();
        [mm(x), mm(box_pt[3] - y - height), mm(width), mm(height)]
    });
    (rectangles.collect(), [mm(box_pt[2]), mm(box_pt[3])])
}

/// Rectangles of the one path of blocks of an SVG, mm.
fn rectangles_of_svg(svg: &str) -> Vec<[f64; 4]> {
    let path = svg.split("<path d=\"").find(|p| p.contains('Z')).unwrap().split('"').next().unwrap();
    let corners = |part: &str| {
        let numbers: Vec<f64> = part.split(['M', ' ', 'H', 'V']).filter_map(|n| n.parse().ok()).collect();
        let [left, top, right, bottom, _]: [f64; 5] = numbers.try_into().unwrap();
        [left, top, right - left, bottom - top]
    };
    path.split_terminator('Z').map(corners).collect()
}

#[test]
fn pdf_and_svg_are_one_drawing_in_its_true_size() {
    let folder = TempDir::new().unwrap();
    printed(folder.path(), &["--paper", "a3"]);
    for name in SHEETS {
        let pdf = std::fs::read(folder.path().join(name).with_extension("pdf")).unwrap();
        assert!(pdf.starts_with(b"%PDF") && pdf.trim_ascii_end().ends_with(b"%%EOF"), "{name}");
        let (in_pdf, page_mm) = rectangles_of_pdf(&pdf);
        let svg = std::fs::read_to_string(folder.path().join(name).with_extension("svg")).unwrap();
        let upright = if name == "control-frame" { [297.0, 420.0] } else { [420.0, 297.0] };
        assert!((0..2).all(|k| (page_mm[k] - upright[k]).abs() < 1e-3), "{name}: {page_mm:?}");
        if ["charuco", "chessboard"].contains(&name) {
            let in_svg = rectangles_of_svg(&svg);
            assert_eq!(in_svg.len(), in_pdf.len(), "{name}");
            for (a, b) in in_svg.iter().zip(&in_pdf) {
                assert!((0..4).all(|k| (a[k] - b[k]).abs() < 1e-3), "{name}: {a:?} {b:?}");
            }
        }
        // The ruler is the longest dark line near the lower edge.
        let scan = scanned(&svg);
        let (width, height) = (scan.size.width_px as usize, scan.size.height_px as usize);
        let rows = height - (15.0 * SCALE) as usize..height;
        let longest_px =
            rows.map(|y| longest_dark(&(0..width).map(|x| scan.rgb(x, y)[0]).collect::<Vec<_>>())).max();
        assert!((longest_px.unwrap() as f64 / SCALE - 100.0).abs() < 0.8, "{name}: {longest_px:?}");
    }
}

fn longest_dark(row: &[u8]) -> usize {
    row.split(|level| *level > 200).map(<[u8]>::len).max().unwrap_or(0)
}

/// The form is filled in with a tape of 1 mm, some distances forgotten: errors of the coordinates, but for the shift and the
/// turn that no tape measures, have the stated standard deviations.
#[test]
fn a_form_that_is_filled_in_gives_coordinates_within_their_standard_deviations() {
    const TAPE_STD_M: f64 = 0.001;
    let folder = TempDir::new().unwrap();
    printed(folder.path(), &[]);
    let path = folder.path().join("distances.csv");
    let refused = DistanceTable::read(&path, TAPE_STD_M).unwrap_err().to_string();
    assert!(refused.contains("no distance is filled in"), "{refused}");
    let form = std::fs::read_to_string(&path).unwrap();
    assert_eq!(form.lines().count(), 1 + 28 + 8);
    let (mut squares, mut count) = (0.0, 0);
    for seed in 0..20 {
        let mut random = Random::new(11, seed);
        let names = ["red", "green", "blue", "yellow", "magenta", "cyan", "orange", "violet"];
        let corner = |k: usize| {
            let (x, y) = [(0.0, 0.0), (2.4, 0.0), (2.4, 2.0), (0.0, 2.0)][k % 4];
            Vector3::new(x, y, if k < 4 { 0.3 } else { 2.1 })
        };
        let truth: Vec<Vector3<f64>> =
            (0..8).map(|k| corner(k) + Vector3::from(random.normals::<3>()) * 0.05).collect();
        let place = |name: &str| names.iter().position(|n| *n == name).map(|k| truth[k]);
        let mut filled = String::new();
        for (k, line) in form.lines().enumerate() {
            let cells: Vec<&str> = line.split(',').collect();
            // The first row, of the balls that fix the axes, is one of the forgotten.
            let is_left = k == 0 || k % 9 == 1;
            let value = place(cells[0]).filter(|_| !is_left).map(|from| {
                let exact = place(cells[1]).map_or(from.z, |to| (from - to).norm());
                format!("{},{},{:.4},", cells[0], cells[1], exact + TAPE_STD_M * random.normal())
            });
            filled += &(value.unwrap_or_else(|| line.to_owned()) + "\n");
        }
        std::fs::write(&path, filled).unwrap();
        // Printing once more keeps it.
        if seed == 0 {
            printed(folder.path(), &[]);
        }
        let table = DistanceTable::read(&path, TAPE_STD_M).unwrap();
        assert_eq!(table.names, names);
        let network = points_from_distances(&table.names, &table.measured).unwrap();
        assert_eq!(network.left_out, None);
        let truth = turned_onto(&truth, &network.points_m);
        for (k, (point, truth)) in network.points_m.iter().zip(&truth).enumerate() {
            let cov_m2 = network.point_cov_m2(k);
            for axis in 0..3 {
                squares += (point[axis] - truth[axis]).powi(2) / cov_m2[(axis, axis)];
                count += 1;
            }
        }
    }
    let ratio = squares / f64::from(count);
    assert!((0.8..1.2).contains(&ratio), "{ratio}");
}

/// Points turned about the vertical and shifted along the floor to be as near to others as they can.
fn turned_onto(points: &[Vector3<f64>], others: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let middle = |all: &[Vector3<f64>]| all.iter().map(Vector3::xy).sum::<Vector2<f64>>() / all.len() as f64;
    let (from, to) = (middle(points), middle(others));
    let (mut dot, mut cross) = (0.0, 0.0);
    for (p, q) in points.iter().zip(others) {
        let (p, q) = (p.xy() - from, q.xy() - to);
        (dot, cross) = (dot + p.dot(&q), cross + p.perp(&q));
    }
    let (s, c) = cross.atan2(dot).sin_cos();
    let turned = |p: &Vector3<f64>| {
        let away = p.xy() - from;
        Vector3::new(c * away.x - s * away.y + to.x, s * away.x + c * away.y + to.y, p.z)
    };
    points.iter().map(turned).collect()
}

#[test]
fn what_does_not_fit_is_refused_with_what_would() {
    let folder = TempDir::new().unwrap();
    for (words, why) in [
        (vec!["--square", "60"], "larger paper, or squares of 29.0 mm or less"),
        (vec!["--dictionary", "DICT_9X9_50"], "DICT_APRILTAG"),
        (vec!["--columns", "20", "--rows", "13"], "the dictionary 50 markers"),
        (vec!["--marker", "28.5"], "a marker of 0.4 to 0.9"),
        (vec!["--square", "0"], "no length above zero"),
        (vec!["--wand-ball", "150"], "choose larger paper"),
    ] {
        let assert = mavsight().arg("targets").arg(folder.path()).args(&words).assert().code(2);
        let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(said.contains(why), "{words:?}: {said}");
    }
    assert!(
        std::fs::read_dir(folder.path()).unwrap().next().is_none(),
        "nothing is written of what is refused"
    );
    // A plain board of that shape looks the same upside down; one with markers does not.
    printed(folder.path(), &["--columns", "6", "--rows", "4"]);
    assert!(folder.path().join("charuco.pdf").exists() && !folder.path().join("chessboard.pdf").exists());
}

/// An example of the help was refused: its board does not fit its paper.
#[test]
fn the_examples_of_the_help_print() {
    let help = mavsight().args(["targets", "--help"]).assert().success();
    let help = String::from_utf8_lossy(&help.get_output().stdout).into_owned();
    let examples: Vec<&str> =
        help.lines().filter_map(|line| line.trim().strip_prefix("mavsight targets ")).collect();
    assert_eq!(examples.len(), 2, "{help}");
    for example in examples {
        let folder = TempDir::new().unwrap();
        mavsight().arg("targets").args(example.split(' ')).current_dir(&folder).assert().success();
    }
}
