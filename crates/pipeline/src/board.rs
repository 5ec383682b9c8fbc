//! A chessboard from its images or films.

use crate::joined::{joined_to, lag_std_s};
use crate::{CameraFeed, PipelineError, TimedFrame, usual_interval_ns};
use mavsight_geometry::Vector2;
use mavsight_pose::{MarkerObservation, MovedObject, ObjectImages, ObjectLags};
use mavsight_vision::{BoardCorner, CodedBoard, Frame, find_board, find_coded_board};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

mod in_step;

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
    /// Whether images of the same number, or frames of films at one time, show the board at one place to all cameras.
    #[serde(default)]
    pub together: bool,
    /// What OpenCV calls the markers in the light squares (ChArUco), such as `DICT_4X4_50`: any part of the
    /// board then will do. Left out: a plain board.
    pub dictionary: Option<String>,
    /// Side of a marker, its black border included.
    pub marker_m: Option<f64>,
    /// Whether it is printed with black and white exchanged.
    #[serde(default)]
    pub inverted: bool,
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
        let inverted = self.inverted.then(|| frame.inverted());
        let frame = inverted.as_ref().unwrap_or(frame);
        match coded {
            Some(coded) => find_coded_board(frame, coded),
            None => find_board(frame, self.columns, self.rows).into_iter().flatten().enumerate().collect(),
        }
    }
}

/// Frames of a film of the board that are looked at, at most: those between them show little that is new.
const MOST_LOOKED: usize = 600;
/// Neighbours in time by which the velocity of an image is measured are no more than so many intervals away.
const NEAR_INTERVALS: f64 = 1.5;

/// Finds the inner corners in the frames of every camera. Frames that do not show the whole board are passed over;
/// of a board with markers, those that do not show six corners.
///
/// With [`Board::together`], images of one number belong together. Of films those frames do that are nearest in
/// time. By how much a film whose clock is not known is late is found from the motion of the board (Albl et al. 2017); as
/// free-running cameras are not in step, their lags within a frame interval are left to the calibration,
/// with the velocities of the corners. A frame whose velocity cannot be measured stands by itself.
///
/// # Errors
/// Sources that fail; [`PipelineError::NoBoard`] for a camera whose frames do not show it.
pub fn board_of(board: &Board, feeds: Vec<Option<CameraFeed<'_>>>) -> Result<MovedObject, PipelineError> {
    let coded = board.coded()?;
    let seen =
        |feed: Option<CameraFeed<'_>>| feed.map(|feed| Film::of(board, coded.as_ref(), feed)).transpose();
    let mut films: Vec<Option<Film>> = feeds.into_par_iter().map(seen).collect::<Result<_, _>>()?;
    if board.together {
        move_in_step(&mut films);
    }
    let grid = if board.together { films.iter().flatten().next() } else { None };
    let grid_ns: Vec<i64> = grid.map_or_else(Vec::new, |film| film.stamps_ns.clone());
    let is_film = films.iter().flatten().any(|film| film.is_film);
    let mut out = MovedObject::board(board.columns, board.rows, board.square_m, Vec::new());
    let mut velocities_px_s = Vec::new();
    for (camera, film) in films.iter().enumerate() {
        let Some(film) = film else { continue };
        out.images.push(ObjectImages {
            camera,
            images: film.stamps_ns.len(),
            unseen: film.unseen(),
            late_ns: film.late_ns,
        });
        let times_ns: Vec<i64> = film.views.iter().map(|view| view.t_ns).collect();
        for (view, near_ns) in film.views.iter().zip(joined_to(&grid_ns, &times_ns, film.step_ns / 2)) {
            let velocities = view.velocities_px_s.as_ref().filter(|_| film.is_film);
            let joins = near_ns.filter(|_| velocities.is_some() || !film.is_film);
            // By itself: a time that no other camera has.
            let t_ns = joins.unwrap_or(view.t_ns + camera as i64 + 1);
            let early_s = 1e-9 * (t_ns - view.t_ns) as f64;
            for (k, (marker, BoardCorner { pixel, covariance_px2 })) in view.corners.iter().enumerate() {
                let velocity = velocities.filter(|_| joins.is_some()).map_or_else(Vector2::zeros, |v| v[k]);
                let (marker, covariance_px2, pixel) = (*marker, *covariance_px2, pixel + velocity * early_s);
                out.observations.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                velocities_px_s.push(velocity);
            }
        }
    }
    // Nearest frames are up to half an interval apart, and nothing says by how much.
    let interval_ns = films.iter().flatten().map(|f| f.interval_ns).max().unwrap_or(0);
    let std_s = lag_std_s(interval_ns);
    out.lags = (is_film && board.together && std_s > 0.0).then_some(ObjectLags { std_s, velocities_px_s });
    Ok(out)
}

/// Moves the films whose clocks are not known to the clock of the first one, where the board's motion shows it.
fn move_in_step(films: &mut [Option<Film>]) {
    let mut films = films.iter_mut().flatten();
    let Some(first) = films.next() else { return };
    for own in films.filter(|own| own.is_film && !own.has_true_clock) {
        in_step::late_ns(first, own).into_iter().for_each(|late_ns| own.moved_by(late_ns));
    }
}

/// What one camera saw of the board.
struct Film {
    /// Whether its images follow each other in time.
    is_film: bool,
    /// Whether its time stamps are known to be those of the other cameras.
    has_true_clock: bool,
    /// What was taken off its stamps, by the motion of the board.
    late_ns: i64,
    /// Of all images that were looked at.
    stamps_ns: Vec<i64>,
    /// Those that show the board.
    views: Vec<View>,
    /// Between two frames of the recording, and between two that were looked at.
    interval_ns: i64,
    step_ns: i64,
}

struct View {
    t_ns: i64,
    corners: Vec<(usize, BoardCorner)>,
    /// Of each corner's image; `None` where no neighbour in time shows the board.
    velocities_px_s: Option<Vec<Vector2<f64>>>,
}

impl Film {
    fn of(board: &Board, coded: Option<&CodedBoard>, feed: CameraFeed<'_>) -> Result<Self, PipelineError> {
        let CameraFeed { name, announced, frames, clock, is_film, .. } = feed;
        let every = announced.filter(|_| is_film).map_or(1, |n| n.div_ceil(MOST_LOOKED).max(1));
        let (mut stamps_ns, mut views) = (Vec::new(), Vec::new());
        for frame in frames.step_by(every) {
            let TimedFrame { t_ns, frame } = frame?;
            let t_ns = if is_film { clock.clock.time_ns(t_ns) } else { t_ns };
            stamps_ns.push(t_ns);
            let corners = board.corners(coded, &frame);
            if !corners.is_empty() {
                views.push(View { t_ns, corners, velocities_px_s: None });
            }
        }
        if views.is_empty() {
            return Err(not_found(board, name, stamps_ns.len()));
        }
        let step_ns = usual_interval_ns(stamps_ns.iter().copied()).unwrap_or(0);
        let (has_true_clock, interval_ns) = (clock.offset_std_s == 0.0, step_ns / every as i64);
        let mut out = Self { is_film, has_true_clock, late_ns: 0, stamps_ns, views, interval_ns, step_ns };
        if is_film {
            let velocities: Vec<_> = (0..out.views.len()).map(|k| out.velocities_px_s(k)).collect();
            out.views.iter_mut().zip(velocities).for_each(|(view, v)| view.velocities_px_s = v);
        }
        Ok(out)
    }

    fn moved_by(&mut self, late_ns: i64) {
        self.late_ns = late_ns;
        self.stamps_ns.iter_mut().for_each(|t_ns| *t_ns -= late_ns);
        self.views.iter_mut().for_each(|view| view.t_ns -= late_ns);
    }

    fn unseen(&self) -> usize {
        self.stamps_ns.len() - self.views.len()
    }

    /// Differences of the neighbours in time, or with one of them. A corner that neither shows moves like the mean
    /// of the others.
    fn velocities_px_s(&self, k: usize) -> Option<Vec<Vector2<f64>>> {
        let own = &self.views[k];
        let is_near = |v: &&View| ((v.t_ns - own.t_ns).abs() as f64) < NEAR_INTERVALS * self.step_ns as f64;
        let before = k.checked_sub(1).and_then(|b| self.views.get(b)).filter(is_near);
        let after = self.views.get(k + 1).filter(is_near);
        let of = |view: Option<&View>, corner: usize| {
            let view = view?;
            let seen = view.corners.iter().find(|c| c.0 == corner)?;
            Some((view.t_ns, seen.1.pixel))
        };
        let velocity = |(corner, seen): &(usize, BoardCorner)| {
            let here = (own.t_ns, seen.pixel);
            let (from, to) = (of(before, *corner).unwrap_or(here), of(after, *corner).unwrap_or(here));
            (to.0 > from.0).then(|| (to.1 - from.1) / (1e-9 * (to.0 - from.0) as f64))
        };
        let measured: Vec<Option<Vector2<f64>>> = own.corners.iter().map(velocity).collect();
        let known: Vec<Vector2<f64>> = measured.iter().copied().flatten().collect();
        let mean = known.iter().sum::<Vector2<f64>>() / known.len() as f64;
        (!known.is_empty()).then(|| measured.iter().map(|v| v.unwrap_or(mean)).collect())
    }
}

fn not_found(board: &Board, camera: String, frames: usize) -> PipelineError {
    let size = format!("{} by {} inner corners", board.columns, board.rows);
    let (what, check) = match board.dictionary {
        Some(_) => (
            format!("six corners of a board with {size} and the markers named"),
            "the dictionary, the numbers (inner corners, not squares) and the sides, whether black and white are exchanged \
             (inverted), and that it is sharp, its squares 25 px across or more",
        ),
        None => (
            format!("a chessboard with {size}"),
            "the numbers (inner corners, not squares), whether black and white are exchanged (inverted), and that the whole \
             board with a white margin is in view and sharp",
        ),
    };
    PipelineError::NoBoard { camera, frames, what, check }
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
