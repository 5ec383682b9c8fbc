//! `targets`: sheets to print, as SVG and as PDF.

use super::new::word_color;
use super::require_folder;
use crate::cli::{Paper, Targets, WrongCall};
use crate::out::outln;
use anyhow::Result;
use mavsight_flight::Color;
use mavsight_pipeline::{Board, WandBall};
use mavsight_report::{
    BoardSheetError, NamedColor, Sheet, board_room_mm, board_sheet, color_sheet, control_frame_sheet,
    distance_form, wand_length_mm, wand_sheet,
};
use mavsight_session::{WandSection, make_folder, write_whole};
use serde::Serialize;

/// Words of unlike hues, in their order.
const HUES: [&str; 10] =
    ["red", "orange", "yellow", "lime", "green", "cyan", "blue", "violet", "magenta", "pink"];
/// The balls of a control frame: the lower four around, then those above them.
const CONTROL: [&str; 8] = ["red", "green", "blue", "yellow", "magenta", "cyan", "orange", "violet"];
/// Those of a wand: opposite hues that also differ for who sees no difference between red and green.
const WAND: [&str; 2] = ["yellow", "blue"];
/// Markers of so much of a square leave a margin that the detector needs.
const MARKER_SHARE: f64 = 0.75;

impl Paper {
    /// Width and height with the short side below, mm (ISO 216; ANSI/ASME Y14.1).
    fn upright_mm(self) -> [f64; 2] {
        match self {
            Self::A4 => [210.0, 297.0],
            Self::A3 => [297.0, 420.0],
            Self::Letter => [215.9, 279.4],
        }
    }
}

/// The part of a session that describes what is printed.
#[derive(Serialize)]
struct Section<'a> {
    board: Option<&'a Board>,
    wand: Option<&'a WandSection>,
}

pub(crate) fn targets(args: &Targets) -> Result<()> {
    require_folder(&args.dir)?;
    let upright_mm = args.paper.upright_mm();
    let lying_mm = [upright_mm[1], upright_mm[0]];
    let board_sheet_mm = if args.columns < args.rows { upright_mm } else { lying_mm };
    let board = board(args, board_sheet_mm);
    let board_text = section(&Section { board: Some(&board), wand: None })?;
    let mut sheets = boards(&board, &board_text, board_sheet_mm)?;
    let wand = wand(args.wand_ball, lying_mm)?;
    let wand_text = section(&Section { board: None, wand: Some(&wand) })?;
    let lines: Vec<&str> = wand_text.lines().filter(|line| !line.is_empty()).collect();
    sheets.push(("wand", wand_sheet(colored(WAND)?, args.wand_ball, &lines, lying_mm)));
    sheets.push(("colors", color_sheet(&colored(HUES)?, lying_mm)));
    let control = colored(CONTROL)?;
    sheets.push(("control-frame", control_frame_sheet(&control, upright_mm)));
    make_folder(&args.dir)?;
    for (name, sheet) in &sheets {
        write_whole(&args.dir.join(format!("{name}.svg")), sheet.svg().as_bytes())?;
        write_whole(&args.dir.join(format!("{name}.pdf")), &sheet.pdf())?;
    }
    let form = args.dir.join("distances.csv");
    // One that is filled in took somebody an hour.
    if form.exists() {
        eprintln!("{}: is there already and is kept", form.display());
    } else {
        write_whole(&form, distance_form(&control).as_bytes())?;
    }
    let names: Vec<&str> = sheets.iter().map(|s| s.0).collect();
    outln!("{board_text}\n\n{wand_text}\n");
    outln!(
        "These sections describe the boards and the wand in a session; the chessboard has no dictionary and no marker_m."
    );
    outln!("Written to {}: {} as .pdf and .svg, and distances.csv", args.dir.display(), names.join(", "));
    outln!("Print at 100 % and measure the line of 100 mm on each sheet.");
    Ok(())
}

/// The board with markers, its squares as large as the sheet allows where no side is given.
fn board(args: &Targets, sheet_mm: [f64; 2]) -> Board {
    let (columns, rows) = (usize::from(args.columns), usize::from(args.rows));
    let square_mm = args.square.unwrap_or_else(|| board_room_mm(columns, rows, sheet_mm).floor());
    let marker_mm = args.marker.unwrap_or(MARKER_SHARE * square_mm);
    let (dictionary, marker_m) = (Some(args.dictionary.clone()), Some(metres(marker_mm)));
    Board { columns, rows, square_m: metres(square_mm), dictionary, marker_m, ..Board::default() }
}

/// The sheets of a board with its markers and without them.
fn boards(board: &Board, text: &str, sheet_mm: [f64; 2]) -> Result<Vec<(&'static str, Sheet)>> {
    let line = |text: &str| text.lines().collect::<Vec<_>>().join("; ");
    let wrong = |e: BoardSheetError| WrongCall(format!("the board: {e}"));
    let mut sheets = vec![("charuco", board_sheet(board, &line(text), sheet_mm).map_err(wrong)?)];
    let plain = Board { dictionary: None, marker_m: None, ..board.clone() };
    let text = section(&Section { board: Some(&plain), wand: None })?;
    match board_sheet(&plain, &line(&text), sheet_mm) {
        Ok(sheet) => sheets.push(("chessboard", sheet)),
        // With markers such a board will do.
        Err(ambiguous @ BoardSheetError::Ambiguous { .. }) => eprintln!("no chessboard: {ambiguous}"),
        Err(other) => return Err(wrong(other).into()),
    }
    Ok(sheets)
}

fn wand(ball_mm: f64, sheet_mm: [f64; 2]) -> Result<WandSection> {
    let length_mm = wand_length_mm(ball_mm, sheet_mm);
    if length_mm < 2.0 * ball_mm {
        let message =
            format!("--wand-ball: balls of {ball_mm} mm leave no wand on this paper: choose larger paper");
        return Err(WrongCall(message).into());
    }
    let ball = colored(WAND)?.map(|NamedColor { rgb: [r, g, b], .. }| WandBall {
        color: Color::new(r, g, b),
        diameter_m: metres(ball_mm),
    });
    Ok(WandSection { length_m: metres(length_mm), length_std_m: 0.0, ball: ball.into() })
}

/// A section as a session file has it, without the keys that say what is so anyway.
fn section(section: &Section<'_>) -> Result<String> {
    let text = toml::to_string(section)?;
    let lines = text
        .lines()
        .filter(|line| !line.is_empty() && !line.ends_with("= false") && !line.ends_with("= 0.0"));
    Ok(lines.collect::<Vec<_>>().join("\n"))
}

fn colored<const N: usize>(words: [&'static str; N]) -> Result<[NamedColor; N]> {
    let mut all = [NamedColor { name: "", rgb: [0; 3] }; N];
    for (own, name) in all.iter_mut().zip(words) {
        *own = NamedColor { name, rgb: word_color(name).map_err(WrongCall)?.rgb() };
    }
    Ok(all)
}

/// Millimetres as metres, to a hundredth of a micrometre: written in a file, no digits of rounding follow.
fn metres(mm: f64) -> f64 {
    (1e5 * mm).round() / 1e8
}
