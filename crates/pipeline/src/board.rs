//! A chessboard from its images.

use crate::{CameraFeed, PipelineError};
use mavsight_pose::{MarkerObservation, MovedObject};
use mavsight_vision::find_board;

/// A chessboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Rows of inner corners.
    pub rows: usize,
    /// Side of a square.
    pub square_m: f64,
    /// Whether frames of the same number show the board at the same place to all cameras.
    pub together: bool,
}

/// Finds all inner corners in every frame of every camera; frames that do not show the whole board are passed over.
///
/// # Errors
/// Sources that fail; [`PipelineError::NoBoard`] for a camera whose frames do not show it.
pub fn board_of(board: &Board, feeds: Vec<Option<CameraFeed<'_>>>) -> Result<MovedObject, PipelineError> {
    let mut sights = Vec::new();
    let many = feeds.len() as i64;
    for (camera, feed) in feeds.into_iter().enumerate() {
        let Some(feed) = feed else { continue };
        let name = feed.name.clone();
        let (mut frames, mut seen) = (0, 0);
        for frame in feed.frames {
            let frame = frame?.frame;
            let place = if board.together { frames } else { frames * many + camera as i64 };
            frames += 1;
            let Some(corners) = find_board(&frame, board.columns, board.rows) else { continue };
            seen += 1;
            sights.extend(corners.iter().enumerate().map(|(marker, corner)| MarkerObservation {
                t_ns: place,
                camera,
                marker,
                pixel: corner.pixel,
                covariance_px2: corner.covariance_px2,
            }));
        }
        if seen == 0 {
            let (columns, rows) = (board.columns, board.rows);
            return Err(PipelineError::NoBoard { camera: name, frames: frames as usize, columns, rows });
        }
    }
    Ok(MovedObject::board((board.columns, board.rows), board.square_m, sights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TimedFrame;
    use mavsight_vision::{Frame, ImageSize};

    #[test]
    fn images_without_a_board_are_told() {
        let size = ImageSize { width_px: 64, height_px: 48 };
        let frame = Frame::from_rgb(size, vec![90; 3 * 64 * 48]).unwrap();
        let frames = Box::new((0..3).map(move |k| Ok(TimedFrame { t_ns: k, frame: frame.clone() })));
        let feed = CameraFeed::new("cam1", None, frames);
        let board = Board { columns: 9, rows: 6, square_m: 0.03, together: false };
        let why = board_of(&board, vec![None, Some(feed)]).unwrap_err().to_string();
        assert!(why.contains("cam1: none of 3 images shows a chessboard with 9 by 6"), "{why}");
    }
}
