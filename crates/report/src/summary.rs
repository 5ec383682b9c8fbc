//! Every figure of a run: printed, in `summary.json` and in the report from one list.

mod body;
mod cameras;
mod clocks;
mod health;
mod list;
mod motion;
mod plan;
mod truth;

use crate::{equation_error, output_error};
use mavsight_score::Scores;
use mavsight_session::RunResults;

pub(crate) use cameras::pixel_std_px;
pub use list::{Row, Summary};
pub(crate) use list::{Section, title};

impl Summary {
    /// Collects the figures of a run, and the errors against truth where there are any.
    pub fn of(results: &RunResults, scores: Option<&Scores>) -> Self {
        let mut summary = Self { rows: Vec::new(), verdicts: Vec::new(), notes: results.notes.clone() };
        cameras::add(&mut summary, results);
        clocks::add(&mut summary, results);
        body::add(&mut summary, results);
        motion::add_poses(&mut summary, results);
        health::add(&mut summary, results);
        plan::add(&mut summary, results);
        motion::add_motion(&mut summary, results);
        equation_error::summarise(&mut summary, results);
        output_error::summarise(&mut summary, results);
        if let Some(scores) = scores {
            truth::add(&mut summary, scores);
        }
        summary
    }
}
