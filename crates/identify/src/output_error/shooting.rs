//! Multiple shooting: segments that are flown each from its own start, and what was seen on them as rows that
//! are linear about a point.

use super::measure::Measurements;
use super::model::FlightModel;
use super::propagate::{Propagator, Raster, SEEN, Step, TANGENT, difference, moved};
use super::row::Row;
use crate::IdentifyError;
use mavsight_flight::{FLIGHT_STATES, HelicopterInput, StateVector};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) model: FlightModel,
    /// Whitened nuisances.
    pub(crate) nuisances: DVector<f64>,
    pub(crate) starts: Vec<StateVector>,
}

impl Point {
    /// This point after a step of [start, parameters, nuisances, -1], of which the starts of all segments are
    /// the given linear functions.
    pub(crate) fn moved(&self, step: &DVector<f64>, starts: &[DMatrix<f64>]) -> Self {
        let mut out = self.clone();
        for (k, parameter) in self.model.free().iter().enumerate() {
            out.model.shift(*parameter, step[TANGENT + k]);
        }
        out.nuisances += step.rows(TANGENT + self.model.free().len(), self.nuisances.len());
        for (y, by) in out.starts.iter_mut().zip(starts) {
            *y = moved(y, (by * step).as_slice());
        }
        out
    }
}

/// What a fit keeps fixed while a point varies.
pub(crate) struct Shooting<'a> {
    pub(crate) inputs: Vec<HelicopterInput>,
    pub(crate) measurements: &'a Measurements,
    pub(crate) times_s: Vec<f64>,
    /// Instant at which each segment begins, and one past the last instant.
    pub(crate) bounds: Vec<usize>,
    /// One over the standard deviation factor of each channel.
    pub(crate) weights: Vec<f64>,
    /// Flapping times and the lag keep their values.
    pub(crate) hold_times: bool,
    pub(crate) longest_step_s: f64,
    /// Inverse standard deviations and mean of the start's degrees of freedom.
    pub(crate) prior_weights: [f64; TANGENT],
    pub(crate) prior_start: StateVector,
}

/// Standard deviations of the gap from the end of one segment to the start of the next, to be multiplied by
/// the tightness: m, rad, m/s, rad/s, rad.
const GAP_STD: [f64; TANGENT] =
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0];

pub(crate) fn gap_information(tightness: f64) -> SMatrix<f64, TANGENT, TANGENT> {
    SMatrix::from_diagonal(&SVector::from(GAP_STD.map(|s| (s * tightness).powi(-2))))
}

/// A segment about a point. Its variables are its start, parameters, nuisances and -1.
pub(crate) struct Segment {
    /// A column for each row that was seen: its derivative by the variables, the residual last.
    pub(crate) rows: DMatrix<f64>,
    /// The start of the next segment by the variables, the gap from this one's end to it last.
    pub(crate) next: DMatrix<f64>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) instant: usize,
    pub(crate) channel: usize,
    /// Where it was predicted in the image; the origin for what is no image.
    pub(crate) pixel: [f64; 2],
}

pub(crate) struct Evaluation {
    pub(crate) segments: Vec<Segment>,
    /// What is known before the flight of the first segment's variables, as columns like those of a segment.
    pub(crate) prior: DMatrix<f64>,
    pub(crate) places: Vec<Place>,
    pub(crate) states: Vec<StateVector>,
}

/// The residuals of rows, which are columns here: their last entries.
fn residuals(rows: &DMatrix<f64>) -> impl Iterator<Item = f64> {
    rows.column_iter().map(|c| c[c.len() - 1])
}

impl Evaluation {
    pub(crate) fn residuals(&self) -> impl Iterator<Item = f64> {
        self.segments.iter().flat_map(|s| residuals(&s.rows))
    }

    /// From each segment's end to the next one's start.
    pub(crate) fn gaps(&self) -> impl Iterator<Item = SVector<f64, TANGENT>> {
        self.segments.iter().map(|s| s.next.fixed_view::<TANGENT, 1>(0, s.next.ncols() - 1).into_owned())
    }

    pub(crate) fn merit(&self, tightness: f64) -> f64 {
        let information = gap_information(tightness);
        let squares: f64 = self.residuals().chain(residuals(&self.prior)).map(|r| r * r).sum();
        squares + self.gaps().map(|gap| gap.dot(&(information * gap))).sum::<f64>()
    }
}

impl Shooting<'_> {
    fn steps(&self, model: &FlightModel, segment: usize) -> Vec<Step> {
        let last = segment + 2 == self.bounds.len();
        let (from, to) = (self.bounds[segment], self.bounds[segment + 1] - usize::from(last));
        // The instant at which the next segment starts belongs to that.
        let raster = Raster { inputs: &self.inputs, times_s: &self.times_s, longest_s: self.longest_step_s };
        raster.steps(self.times_s[from], self.times_s[to], model, from + 1..to + usize::from(last))
    }

    pub(crate) fn evaluate(&self, point: &Point) -> Result<Evaluation, IdentifyError> {
        let n = TANGENT + point.model.free().len() + point.nuisances.len() + 1;
        let mut out = Evaluation {
            segments: Vec::with_capacity(point.starts.len()),
            prior: self.prior(point),
            places: Vec::new(),
            states: vec![[f64::NAN; FLIGHT_STATES]; self.times_s.len()],
        };
        for (s, start) in point.starts.iter().enumerate() {
            let mut rows = Vec::new();
            let mut flyer = Propagator::new(point.model.free(), start);
            self.see(&flyer, self.bounds[s], point, &mut rows, &mut out)?;
            for step in self.steps(&point.model, s) {
                flyer.step(&point.model, &self.inputs, &step);
                if let Some(instant) = step.instant {
                    self.see(&flyer, instant, point, &mut rows, &mut out)?;
                }
            }
            if !flyer.is_finite() {
                return Err(IdentifyError::RanAway(self.times_s[self.bounds[s]]));
            }
            let by = self.sensitivity(&flyer, point);
            let mut next = DMatrix::zeros(TANGENT, n);
            next.columns_mut(0, by.nrows()).copy_from(&by.transpose());
            if let Some(start) = point.starts.get(s + 1) {
                next.column_mut(n - 1).copy_from_slice(&difference(start, &flyer.y));
            }
            out.segments.push(Segment { rows: DMatrix::from_vec(n, rows.len() / n, rows), next });
        }
        Ok(out)
    }

    /// Derivative of the state's degrees of freedom, a column each, by start and parameters.
    fn sensitivity(&self, flyer: &Propagator, point: &Point) -> DMatrix<f64> {
        let mut out = flyer.tangent();
        for (k, parameter) in point.model.free().iter().enumerate() {
            if self.hold_times && parameter.is_time() {
                out.row_mut(TANGENT + k).fill(0.0);
            }
        }
        out
    }

    /// Appends the rows of an instant to those of its segment.
    fn see(
        &self,
        flyer: &Propagator,
        instant: usize,
        point: &Point,
        rows: &mut Vec<f64>,
        out: &mut Evaluation,
    ) -> Result<(), IdentifyError> {
        out.states[instant] = flyer.y;
        let seen: Vec<Row<'_>> = self.measurements.rows(instant, &flyer.y)?;
        if seen.is_empty() {
            return Ok(());
        }
        let tangent = self.sensitivity(flyer, point);
        let mut by = DVector::zeros(tangent.nrows());
        for row in seen {
            let weight = self.weights[row.channel];
            by.gemv(weight, &tangent.columns(0, SEEN), &row.jacobian, 0.0);
            rows.extend(by.iter());
            let shift: f64 = row.directions.iter().zip(&point.nuisances).map(|(d, z)| d * z).sum();
            let unmoved = point.nuisances.len() - row.directions.len();
            rows.extend(row.directions.iter().map(|d| weight * d).chain(std::iter::repeat_n(0.0, unmoved)));
            rows.push(weight * (row.residual - shift));
            out.places.push(Place { instant, channel: row.channel, pixel: row.pixel });
        }
        Ok(())
    }

    /// The start is known as well as the prior says, each nuisance is a standard normal number.
    fn prior(&self, point: &Point) -> DMatrix<f64> {
        let (m, k) = (TANGENT + point.model.free().len(), point.nuisances.len());
        let mut out = DMatrix::zeros(m + k + 1, TANGENT + k);
        let off = difference(&self.prior_start, &point.starts[0]);
        for (i, weight) in self.prior_weights.iter().enumerate() {
            out[(i, i)] = *weight;
            out[(m + k, i)] = weight * off[i];
        }
        for (i, nuisance) in point.nuisances.iter().enumerate() {
            out[(m + i, TANGENT + i)] = 1.0;
            out[(m + k, TANGENT + i)] = -nuisance;
        }
        out
    }
}
