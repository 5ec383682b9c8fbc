//! A chessboard from its images.

use crate::{CameraFeed, PipelineError};
use mavsight_pose::{MarkerObservation, MovedObject};
use mavsight_vision::{BoardCorner, CodedBoard, Frame, find_board, find_coded_board};

/// A chessboard.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Rows of inner corners.
    pub rows: usize,
    /// Side of a square.
    pub square_m: f64,
    /// Whether frames of the same number show the board at the same place to all cameras.
    pub together: bool,
    /// The markers in its light squares, where it has any: then any part of it will do.
    pub coded: Option<CodedBoard>,
}

impl Board {
    /// The inner corners that a frame shows, by their numbers; none where that does not do.
    fn corners(&self, frame: &Frame) -> Vec<(usize, BoardCorner)> {
        match &self.coded {
            Some(coded) => find_coded_board(frame, coded),
            None => find_board(frame, self.columns, self.rows).into_iter().flatten().enumerate().collect(),
        }
    }
}

/// Finds the inner corners in every frame of every camera. Frames that do not show the whole board are
/// passed over; of a board with markers, those that do not show six corners.
///
/// # Errors
/// Sources that fail; [`PipelineError::NoBoard`] for a camera whose frames do not show it.
pub fn board_of(board: &Board, feeds: Vec<Option<CameraFeed<'_>>>) -> Result<MovedObject, PipelineError> {
    let mut observations = Vec::new();
    let many = feeds.len() as i64;
    for (camera, feed) in feeds.into_iter().enumerate() {
        let Some(feed) = feed else { continue };
        let name = feed.name.clone();
        let (mut frames, mut seen) = (0, 0);
        for frame in feed.frames {
            let frame = frame?.frame;
            let place = if board.together { frames } else { frames * many + camera as i64 };
            frames += 1;
            let corners = board.corners(&frame);
            seen += usize::from(!corners.is_empty());
            observations.extend(corners.into_iter().map(|(marker, corner)| MarkerObservation {
                t_ns: place,
                camera,
                marker,
                pixel: corner.pixel,
                covariance_px2: corner.covariance_px2,
            }));
        }
        if seen == 0 {
            let (columns, rows) = (board.columns, board.rows);
            let (camera, frames) = (name, frames as usize);
            return Err(match board.coded {
                Some(_) => PipelineError::NoCodedBoard { camera, frames, columns, rows },
                None => PipelineError::NoBoard { camera, frames, columns, rows },
            });
        }
    }
    Ok(MovedObject::board(board.columns, board.rows, board.square_m, observations))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TimedFrame;
    use mavsight_vision::{Frame, ImageSize};

    #[test]
    fn images_without_a_board_are_named() {
        let size = ImageSize { width_px: 64, height_px: 48 };
        let frame = Frame::from_rgb(size, vec![90; 3 * 64 * 48]).unwrap();
        let feed = || {
            let frame = frame.clone();
            let frames = Box::new((0..3).map(move |k| Ok(TimedFrame { t_ns: k, frame: frame.clone() })));
            CameraFeed::new("cam1", None, frames)
        };
        let plain = Board { columns: 9, rows: 6, square_m: 0.03, together: false, coded: None };
        let coded = CodedBoard::new((9, 6), 0.75, "DICT_4X4_50").unwrap();
        let with_markers = Board { coded: Some(coded), ..plain.clone() };
        for (board, words) in [
            (plain, "cam1: none of 3 images shows a chessboard with 9 by 6"),
            (with_markers, "cam1: none of 3 images shows six corners of a board with 9 by 6"),
        ] {
            let why = board_of(&board, vec![None, Some(feed())]).unwrap_err().to_string();
            assert!(why.contains(words), "{why}");
        }
    }
}
