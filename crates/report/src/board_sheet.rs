//! Boards to print.

use crate::sheet::Sheet;
use mavsight_pipeline::{Board, PipelineError};
use mavsight_vision::CodedBoard;

/// White on the left, on the right and above: a board must have some around it, and printers leave their own.
const MARGIN_MM: f64 = 12.0;
/// Below it: the board's section of a session, and the ruler.
const BELOW_MM: f64 = 24.0;

/// Why a board cannot be printed.
#[derive(Debug, thiserror::Error)]
pub enum BoardSheetError {
    /// Larger than the sheet.
    #[error(
        "a board of {:.1} × {:.1} mm with its margins does not fit a sheet of {:.1} × {:.1} mm: choose larger paper, or squares of \
         {most_mm:.1} mm or less", board_mm[0], board_mm[1], sheet_mm[0], sheet_mm[1]
    )]
    TooLarge {
        /// Width and height of the board.
        board_mm: [f64; 2],
        /// Of the sheet.
        sheet_mm: [f64; 2],
        /// The largest squares with which it would fit.
        most_mm: f64,
    },
    /// Squares that have no size.
    #[error("squares of {square_m} m cannot be printed: give their side")]
    NoSize {
        /// Side of a square.
        square_m: f64,
    },
    /// A plain board that is too small, or looks the same when it is turned by half.
    #[error(
        "a board without markers of {columns} by {rows} inner corners is not found, or looks the same upside down: choose three or \
         more of each, one number even and the other odd"
    )]
    Ambiguous {
        /// Inner corners along a row.
        columns: usize,
        /// Rows.
        rows: usize,
    },
    /// Markers that are not those of such a board.
    #[error(transparent)]
    Markers(#[from] PipelineError),
}

/// The side of the largest squares, mm, with which a board of so many inner corners along a row, and rows, fits a sheet.
pub fn board_room_mm(columns: usize, rows: usize, sheet_mm: [f64; 2]) -> f64 {
    let across = (sheet_mm[0] - 2.0 * MARGIN_MM) / (columns as f64 + 1.0);
    across.min((sheet_mm[1] - MARGIN_MM - BELOW_MM) / (rows as f64 + 1.0))
}

/// A sheet with a board as [`mavsight_pipeline::board_of`] finds it, its first square dark, and below it words that say what
/// a session must say of it.
///
/// # Errors
/// [`BoardSheetError`].
pub fn board_sheet(board: &Board, section: &str, sheet_mm: [f64; 2]) -> Result<Sheet, BoardSheetError> {
    let (columns, rows, side_mm) = (board.columns, board.rows, 1e3 * board.square_m);
    if !(side_mm > 0.0 && side_mm.is_finite()) {
        return Err(BoardSheetError::NoSize { square_m: board.square_m });
    }
    let coded = board.coded()?;
    if coded.is_none() && (columns.min(rows) < 3 || (columns + rows).is_multiple_of(2)) {
        return Err(BoardSheetError::Ambiguous { columns, rows });
    }
    let most_mm = board_room_mm(columns, rows, sheet_mm);
    let board_mm = [side_mm * (columns + 1) as f64, side_mm * (rows + 1) as f64];
    // A thousandth of a millimetre for sides that were computed to fit.
    if side_mm > most_mm + 1e-3 {
        return Err(BoardSheetError::TooLarge { board_mm, sheet_mm, most_mm });
    }
    let left_mm = 0.5 * (sheet_mm[0] - board_mm[0]);
    let corner = |i: usize, j: usize| [left_mm + side_mm * i as f64, MARGIN_MM + side_mm * j as f64];
    let all = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j)));
    let mut blocks: Vec<[f64; 4]> = all
        .filter(|(i, j)| (i + j) % 2 == 0)
        .map(|(i, j)| {
            let [x, y] = corner(i, j);
            [x, y, side_mm, side_mm]
        })
        .collect();
    if let Some(coded) = &coded {
        for (marker, (i, j)) in coded.squares(0).into_iter().enumerate() {
            let [x, y] = corner(i, j);
            blocks.extend(dark_modules(coded, marker).map(|m| {
                let [dx, dy, width, height] = m.map(|share| side_mm * share);
                [x + dx, y + dy, width, height]
            }));
        }
    }
    let mut sheet = Sheet::new(if coded.is_some() { "ChArUco board" } else { "Chessboard" }, sheet_mm);
    sheet.blocks(blocks);
    sheet.paragraphs(MARGIN_MM + board_mm[1] + 8.0, &[section]);
    Ok(sheet)
}

/// Dark runs of a marker's rows: left, top, width and height as parts of its square.
fn dark_modules(board: &CodedBoard, marker: usize) -> impl Iterator<Item = [f64; 4]> {
    let (modules, share) = (board.modules(), board.marker_share());
    let step = share / modules as f64;
    let edge = move |k: usize| 0.5 * (1.0 - share) + step * k as f64;
    let is_dark = move |column: usize, row: usize| {
        !board.is_white(marker, edge(column) + 0.5 * step, edge(row) + 0.5 * step)
    };
    (0..modules).flat_map(move |row| {
        let starts = (0..modules).filter(move |c| is_dark(*c, row) && (*c == 0 || !is_dark(*c - 1, row)));
        starts.map(move |column| {
            let length = (column..modules).take_while(|c| is_dark(*c, row)).count();
            [edge(column), edge(row), step * length as f64, step]
        })
    })
}
