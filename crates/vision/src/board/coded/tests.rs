use super::*;
use mavsight_geometry::ImageSize;

const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

/// A frame of what is on the board's plane, in squares from its first inner corner, each pixel the mean of 6
/// by 6 samples.
fn frame(level: impl Fn(Vector2<f64>) -> f64, board_from_pixel: impl Fn(f64, f64) -> Vector2<f64>) -> Frame {
    blurred(1.0, level, board_from_pixel)
}

/// The same through a lens that spreads each point over a square of so many pixels.
fn blurred(
    blur_px: f64,
    level: impl Fn(Vector2<f64>) -> f64,
    board_from_pixel: impl Fn(f64, f64) -> Vector2<f64>,
) -> Frame {
    let mut rgb = Vec::new();
    for y in 0..SIZE.height_px {
        for x in 0..SIZE.width_px {
            let sample = |k: u32| {
                let at = |i: u32| blur_px * ((f64::from(i) + 0.5) / 6.0 - 0.5);
                level(board_from_pixel(f64::from(x) + at(k % 6), f64::from(y) + at(k / 6)))
            };
            rgb.extend([((0..36).map(sample).sum::<f64>() / 36.0).round() as u8; 3]);
        }
    }
    Frame::from_rgb(SIZE, rgb).unwrap()
}

/// Grey level of a board, whose first square is dark (0) or light (1), at a place in squares from its first
/// inner corner.
fn printed(board: &CodedBoard, first: usize) -> impl Fn(Vector2<f64>) -> f64 {
    let squares = board.squares(first);
    let (columns, rows) = board.corners();
    move |p| {
        let (x, y) = (p.x + 1.0, p.y + 1.0);
        if !(0.0..columns as f64 + 1.0).contains(&x) || !(0.0..rows as f64 + 1.0).contains(&y) {
            return 220.0;
        }
        let marker = squares.iter().position(|s| *s == (x as usize, y as usize));
        if marker.is_some_and(|m| board.is_white(m, x.fract(), y.fract())) { 220.0 } else { 20.0 }
    }
}

/// A camera that looks at the board with a tilt: pixels onto the board, and back.
struct View {
    turn: f64,
    side_px: f64,
    at: Vector2<f64>,
}

impl View {
    const TILT: f64 = 4e-4;

    fn board_from_pixel(&self, u: f64, v: f64) -> Vector2<f64> {
        let p = Vector2::new(u, v) - self.at;
        let (s, c) = self.turn.sin_cos();
        Vector2::new(c * p.x + s * p.y, -s * p.x + c * p.y) / (self.side_px * (1.0 + Self::TILT * p.x))
    }

    fn pixel(&self, board: Vector2<f64>) -> Vector2<f64> {
        let (s, c) = self.turn.sin_cos();
        let q = Vector2::new(c * board.x - s * board.y, s * board.x + c * board.y) * self.side_px;
        // p = q (1 + TILT p.x)
        q / (1.0 - Self::TILT * q.x) + self.at
    }
}

/// Root mean square error of the places of what was found as it is named, px, and the number.
fn check(found: &[(usize, BoardCorner)], columns: usize, view: &View) -> (f64, usize) {
    let error = |(k, corner): &(usize, BoardCorner)| {
        let place = Vector2::new((k % columns) as f64, (k / columns) as f64);
        (corner.pixel - view.pixel(place)).norm_squared()
    };
    ((found.iter().map(error).sum::<f64>() / found.len() as f64).sqrt(), found.len())
}

#[test]
fn a_whole_board_is_found_whichever_side_is_up() {
    for (turn, dictionary, share) in [
        (0.1, "DICT_4X4_50", 0.75),
        (1.8, "DICT_5X5_100", 0.7),
        (3.3, "DICT_6X6_250", 0.8),
        (-1.2, "DICT_APRILTAG_36h11", 0.8),
    ] {
        let board = CodedBoard::new((6, 4), share, dictionary).unwrap();
        let (s, c) = f64::sin_cos(turn);
        let middle = Vector2::new(c * 2.5 - s * 1.5, s * 2.5 + c * 1.5) * 50.0;
        let view = View { turn, side_px: 50.0, at: Vector2::new(320.0, 240.0) - middle };
        let found = find_coded_board(&frame(printed(&board, 0), |u, v| view.board_from_pixel(u, v)), &board);
        let (error_px, count) = check(&found, 6, &view);
        println!("{dictionary}: {count} corners, {error_px:.3} px");
        assert_eq!(count, 24, "{dictionary}");
        assert!(error_px < 0.08, "{dictionary}: {error_px} px");
    }
}

#[test]
fn a_part_of_a_board_is_recognised_by_its_markers() {
    let board = CodedBoard::new((9, 7), 0.75, "DICT_4X4_50").unwrap();
    let view = View { turn: 0.3, side_px: 60.0, at: Vector2::new(-70.0, -150.0) };
    // A hand before the middle of what is in view.
    let printed = printed(&board, 0);
    let with_hand =
        |p: Vector2<f64>| if (p - Vector2::new(5.4, 4.2)).norm() < 0.8 { 120.0 } else { printed(p) };
    let found = find_coded_board(&frame(with_hand, |u, v| view.board_from_pixel(u, v)), &board);
    let (error_px, count) = check(&found, 9, &view);
    println!("{count} corners, {error_px:.3} px");
    assert!((18..63).contains(&count), "{count}");
    assert!(error_px < 0.1, "{error_px} px");
}

/// A marker's border lies 3.5 to 4.5 px from the edges of its square here: it must not pull the corners.
#[test]
fn corners_of_small_squares_with_markers_are_good_to_a_few_hundredths_of_a_pixel() {
    let board = CodedBoard::new((6, 5), 0.75, "DICT_4X4_50").unwrap();
    for (side_px, blur_px, most_px) in [(28.0, 1.0, 0.035), (36.0, 1.0, 0.035), (36.0, 3.0, 0.065)] {
        for turn in [0.1, 0.3, 0.8] {
            let view = View { turn, side_px, at: Vector2::new(310.3, 199.7) };
            let seen = blurred(blur_px, printed(&board, 0), |u, v| view.board_from_pixel(u, v));
            let (error_px, count) = check(&find_coded_board(&seen, &board), 6, &view);
            println!("{side_px} px, blur {blur_px} px, turn {turn}: {count} corners, {error_px:.4} px");
            assert_eq!(count, 30);
            assert!(error_px < most_px, "{side_px} px, blur {blur_px} px, turn {turn}: {error_px} px");
        }
    }
}

/// Boards printed by OpenCV before 4.6, and by calib.io, begin with a light square where the number of rows
/// of squares is even.
#[test]
fn either_kind_of_first_square_is_recognised() {
    let board = CodedBoard::new((6, 5), 0.75, "DICT_5X5_50").unwrap();
    for first in [0, 1] {
        let view = View { turn: -0.2, side_px: 55.0, at: Vector2::new(150.0, 160.0) };
        let found =
            find_coded_board(&frame(printed(&board, first), |u, v| view.board_from_pixel(u, v)), &board);
        let (error_px, count) = check(&found, 6, &view);
        assert!(count == 30 && error_px < 0.08, "first {first}: {count}, {error_px} px");
    }
}

#[test]
fn what_is_no_such_board_is_not_taken_for_one() {
    let board = CodedBoard::new((6, 4), 0.75, "DICT_4X4_50").unwrap();
    let view = View { turn: 0.2, side_px: 50.0, at: Vector2::new(200.0, 150.0) };
    let other = CodedBoard::new((6, 4), 0.75, "DICT_6X6_50").unwrap();
    let seen = frame(printed(&other, 0), |u, v| view.board_from_pixel(u, v));
    assert_eq!(find_coded_board(&seen, &board), []);
    let plain =
        |p: Vector2<f64>| if (p.x.floor() + p.y.floor()).rem_euclid(2.0) == 0.0 { 20.0 } else { 220.0 };
    let seen = frame(plain, |u, v| view.board_from_pixel(u, v));
    assert_eq!(find_coded_board(&seen, &board), []);
    assert_eq!(find_coded_board(&frame(|_| 128.0, |u, v| view.board_from_pixel(u, v)), &board), []);
}

#[test]
fn boards_that_cannot_be_are_refused() {
    let why = |corners, share, name| CodedBoard::new(corners, share, name).unwrap_err().to_string();
    assert!(why((6, 4), 0.7, "DICT_4X4").contains("no dictionary is called `DICT_4X4`"));
    assert!(why((20, 14), 0.7, "DICT_4X4_50").contains("157 light squares and the dictionary 50 markers"));
    assert!(why((6, 4), 0.95, "DICT_4X4_50").contains("markers of 0.95 of a square"));
    assert!(why((1, 4), 0.7, "DICT_4X4_50").contains("1 by 4 inner corners"));
    assert!(why((2, 2), 0.7, "DICT_4X4_50").contains("2 by 3 or more"));
    assert!(why((usize::MAX, usize::MAX), 0.7, "DICT_4X4_50").contains("50 markers"));
}
