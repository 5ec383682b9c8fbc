//! A chessboard from its images.

use crate::{CameraFeed, PipelineError};
use mavsight_pose::{MarkerObservation, MovedObject};
use mavsight_vision::{BoardCorner, CodedBoard, Frame, find_board, find_coded_board};
use serde::{Deserialize, Serialize};

/// A chessboard: calibration by its images.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Rows of inner corners.
    pub rows: usize,
    /// Side of a square.
    pub square_m: f64,
    /// Whether images of the same number show the board at the same place to all cameras.
    #[serde(default)]
    pub together: bool,
    /// What OpenCV calls the markers in the light squares (ChArUco), such as `DICT_4X4_50`: any part of the
    /// board then will do. Left out: a plain board.
    pub dictionary: Option<String>,
    /// Side of a marker, its black border included.
    pub marker_m: Option<f64>,
}

impl Board {
    /// The board's markers; `None` for a plain one.
    ///
    /// # Errors
    /// Key and remedy, where the markers cannot be those of this board.
    pub fn coded(&self) -> Result<Option<CodedBoard>, PipelineError> {
        let refuse = |key: &'static str, detail: String| Err(PipelineError::Board { key, detail });
        match (&self.dictionary, self.marker_m) {
            (None, None) => Ok(None),
            (Some(_), None) => {
                refuse("board.marker_m", "is missing: give the side of a marker in metres".into())
            }
            (None, Some(_)) => {
                let detail = "is missing: give the name of the markers' dictionary, for instance \"DICT_4X4_50\", or leave \
                              marker_m out";
                refuse("board.dictionary", detail.into())
            }
            (Some(name), Some(marker_m)) => {
                CodedBoard::new((self.columns, self.rows), marker_m / self.square_m, name)
                    .map(Some)
                    .or_else(|wrong| refuse("board.dictionary, board.marker_m", wrong.to_string()))
            }
        }
    }

    /// The inner corners that a frame shows, by their numbers; none where that does not do.
    fn corners(&self, coded: Option<&CodedBoard>, frame: &Frame) -> Vec<(usize, BoardCorner)> {
        match coded {
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
    let coded = board.coded()?;
    let mut observations = Vec::new();
    let many = feeds.len() as i64;
    for (camera, feed) in feeds.into_iter().enumerate() {
        let Some(feed) = feed else { continue };
        let (mut frames, mut seen) = (0, 0);
        for frame in feed.frames {
            let corners = board.corners(coded.as_ref(), &frame?.frame);
            let t_ns = if board.together { frames } else { frames * many + camera as i64 };
            frames += 1;
            seen += usize::from(!corners.is_empty());
            observations.extend(corners.into_iter().map(|(marker, corner)| {
                let BoardCorner { pixel, covariance_px2 } = corner;
                MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 }
            }));
        }
        if seen == 0 {
            let size = format!("{} by {} inner corners", board.columns, board.rows);
            let (what, check) = match coded {
                Some(_) => (
                    format!("six corners of a board with {size} and the markers named"),
                    "the dictionary, the numbers (inner corners, not squares) and the sides, and that it is sharp, its squares \
                     25 px across or more",
                ),
                None => (
                    format!("a chessboard with {size}"),
                    "the numbers (inner corners, not squares), and that the whole board with a white margin is in view and sharp",
                ),
            };
            return Err(PipelineError::NoBoard { camera: feed.name, frames, what, check });
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
        let plain = Board { columns: 9, rows: 6, square_m: 0.03, ..Board::default() };
        let dictionary = Some("DICT_4X4_50".to_owned());
        let with_markers = Board { dictionary, marker_m: Some(0.75 * 0.03), ..plain.clone() };
        for (board, words) in [
            (plain, "cam1: none of 3 images shows a chessboard with 9 by 6"),
            (with_markers, "cam1: none of 3 images shows six corners of a board with 9 by 6"),
        ] {
            let why = board_of(&board, vec![None, Some(feed())]).unwrap_err().to_string();
            assert!(why.contains(words), "{why}");
        }
    }
}
