//! Multiple shooting: segments, their quadratic models, and the step that fits them together.

use super::measure::Measurements;
use super::model::FlightModel;
use super::propagate::{Propagator, Raster, SEEN, Step, TANGENT, difference, moved};
use super::row::Row;
use crate::IdentifyError;
use mavsight_flight::{InputSample, StateVector};
use nalgebra::{DMatrix, DVector};

/// What a fit varies.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) model: FlightModel,
    /// Whitened nuisances.
    pub(crate) nuisances: DVector<f64>,
    /// State at the start of each segment.
    pub(crate) starts: Vec<StateVector>,
}

/// What a fit keeps fixed while a point varies.
pub(crate) struct Shooting<'a> {
    pub(crate) inputs: &'a [InputSample],
    pub(crate) measurements: &'a Measurements,
    pub(crate) times_s: Vec<f64>,
    /// Instant at which each segment begins, and one past the last instant.
    pub(crate) bounds: Vec<usize>,
    /// One over the standard deviation factor of each channel.
    pub(crate) weights: Vec<f64>,
    /// Flapping times and the lag keep their values.
    pub(crate) hold_times: bool,
    /// The longest step of the integration.
    pub(crate) longest_step_s: f64,
    /// Gram matrix of the weighted nuisance directions.
    pub(crate) nuisance_gram: DMatrix<f64>,
    /// Inverse variance and mean of the start's degrees of freedom.
    pub(crate) prior_information: [f64; TANGENT],
    pub(crate) prior_start: StateVector,
}

/// How far the end of one segment may miss the start of the next: standard deviations per degree of freedom,
/// to be multiplied by the tightness: m, rad, m/s, rad/s, rad. A penalty stands for the constraint; what it
/// leaves open is far below the resolution of any measurement.
const GAP_STD: [f64; TANGENT] =
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0];

/// Inverse variances of a gap.
pub(crate) fn gap_information(tightness: f64) -> [f64; TANGENT] {
    GAP_STD.map(|s| (s * tightness).powi(-2))
}

/// The sum of squares about a point as a quadratic in [start of the segment, parameters, nuisances, -1].
pub(crate) struct Segment {
    pub(crate) quadratic: DMatrix<f64>,
    /// Derivative of the end by start and parameters.
    pub(crate) end_by: DMatrix<f64>,
    /// From this segment's end to the next one's start.
    pub(crate) gap: [f64; TANGENT],
}

/// A whitened row with its derivative by start of segment and parameters.
pub(crate) struct Record {
    pub(crate) segment: usize,
    pub(crate) instant: usize,
    pub(crate) row: Row,
    pub(crate) by: Vec<f64>,
}

/// All segments at a point.
pub(crate) struct Evaluation {
    pub(crate) segments: Vec<Segment>,
    pub(crate) nuisance_gradient: DVector<f64>,
    /// Weighted squares of all rows.
    pub(crate) chi_square: f64,
    /// Weighted squares of all rows and priors, without gaps.
    pub(crate) fit: f64,
    pub(crate) gap_squares: [f64; TANGENT],
    /// Weighted squares of each channel, and their number.
    pub(crate) channel_squares: Vec<(f64, usize)>,
    /// State at each instant.
    pub(crate) states: Vec<StateVector>,
}

impl Evaluation {
    pub(crate) fn merit(&self, tightness: f64) -> f64 {
        let gaps = self.gap_squares.iter().zip(gap_information(tightness));
        self.fit + gaps.map(|(s, w)| s * w).sum::<f64>()
    }
}

struct Accumulator<'a> {
    problem: &'a Shooting<'a>,
    columns: usize,
    held: Vec<usize>,
    tangent: Vec<f64>,
    by: Vec<f64>,
    rows: Vec<Row>,
}

impl Shooting<'_> {
    pub(crate) fn segments(&self) -> usize {
        self.bounds.len() - 1
    }

    fn plan(&self, model: &FlightModel, segment: usize) -> Vec<Step> {
        let last = segment + 1 == self.segments();
        let (from, to) = (self.bounds[segment], self.bounds[segment + 1] - usize::from(last));
        // The instant at which the next segment starts belongs to that.
        let raster = Raster { inputs: self.inputs, times_s: &self.times_s, longest_s: self.longest_step_s };
        raster.steps((self.times_s[from], self.times_s[to]), model, from + 1..to + usize::from(last))
    }

    /// Flies all segments; `records` keeps the rows.
    pub(crate) fn evaluate(
        &self,
        point: &Point,
        mut records: Option<&mut Vec<Record>>,
    ) -> Result<Evaluation, IdentifyError> {
        let free = point.model.free();
        let mut flyer = Propagator::new(free);
        let k = point.nuisances.len();
        let m = flyer.columns();
        let mut sums = Accumulator {
            problem: self,
            columns: m,
            held: free
                .iter()
                .enumerate()
                .filter(|(_, p)| self.hold_times && p.is_time())
                .map(|(k, _)| TANGENT + k)
                .collect(),
            tangent: vec![0.0; TANGENT * m],
            by: vec![0.0; m],
            rows: Vec::with_capacity(64),
        };
        let mut out = Evaluation {
            segments: Vec::with_capacity(self.segments()),
            nuisance_gradient: -&point.nuisances,
            chi_square: 0.0,
            fit: point.nuisances.norm_squared(),
            gap_squares: [0.0; TANGENT],
            channel_squares: vec![(0.0, 0); self.weights.len()],
            states: vec![[f64::NAN; 17]; self.times_s.len()],
        };
        for s in 0..self.segments() {
            let mut segment = Segment {
                quadratic: DMatrix::zeros(m + k + 1, m + k + 1),
                end_by: DMatrix::zeros(TANGENT, m),
                gap: [0.0; TANGENT],
            };
            flyer.start(&point.starts[s]);
            sums.add(&flyer, (s, self.bounds[s]), point, (&mut segment, &mut out), records.as_deref_mut())?;
            for step in self.plan(&point.model, s) {
                flyer.step(&point.model, self.inputs, &step);
                if let Some(instant) = step.instant {
                    sums.add(&flyer, (s, instant), point, (&mut segment, &mut out), records.as_deref_mut())?;
                }
            }
            if !flyer.is_finite() {
                return Err(IdentifyError::RanAway { t_s: self.times_s[self.bounds[s]] });
            }
            sums.sensitivity(&flyer);
            segment.end_by = DMatrix::from_row_slice(TANGENT, m, &sums.tangent);
            if let Some(next) = point.starts.get(s + 1) {
                segment.gap = difference(next, &flyer.y);
                for (sum, gap) in out.gap_squares.iter_mut().zip(segment.gap) {
                    *sum += gap * gap;
                }
            }
            segment.quadratic.fill_lower_triangle_with_upper_triangle();
            out.segments.push(segment);
        }
        self.add_prior(point, &mut out);
        out.fit += out.chi_square;
        Ok(out)
    }

    fn add_prior(&self, point: &Point, out: &mut Evaluation) {
        let off = difference(&self.prior_start, &point.starts[0]);
        let q = &mut out.segments[0].quadratic;
        let last = q.ncols() - 1;
        for (i, information) in self.prior_information.iter().enumerate() {
            q[(i, i)] += information;
            q[(i, last)] += information * off[i];
            q[(last, i)] += information * off[i];
            q[(last, last)] += information * off[i] * off[i];
            out.fit += information * off[i] * off[i];
        }
    }

    /// Gram matrix of the nuisance directions under the present weights.
    pub(crate) fn update_nuisance_gram(&mut self, states: &[StateVector]) -> Result<(), IdentifyError> {
        let k = self.measurements.nuisances();
        self.nuisance_gram = DMatrix::zeros(k, k);
        if k == 0 {
            return Ok(());
        }
        let mut rows = Vec::with_capacity(64);
        for (instant, y) in states.iter().enumerate().skip(self.bounds[0]) {
            self.measurements.rows(instant, y, &mut rows)?;
            for row in &rows {
                let weight = self.weights[row.channel].powi(2);
                let d = self.measurements.nuisance_row(row.nuisance);
                for (b, factor) in d.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                    let mut column = self.nuisance_gram.column_mut(b);
                    for (sum, v) in column.iter_mut().zip(d).take(b + 1) {
                        *sum += weight * factor * v;
                    }
                }
            }
        }
        self.nuisance_gram.fill_lower_triangle_with_upper_triangle();
        Ok(())
    }
}

impl Accumulator<'_> {
    fn sensitivity(&mut self, flyer: &Propagator) {
        flyer.tangent(&mut self.tangent);
        for row in self.tangent.chunks_exact_mut(self.columns) {
            for k in &self.held {
                row[*k] = 0.0;
            }
        }
    }

    /// Adds the rows of one instant.
    fn add(
        &mut self,
        flyer: &Propagator,
        (s, instant): (usize, usize),
        point: &Point,
        (segment, out): (&mut Segment, &mut Evaluation),
        mut records: Option<&mut Vec<Record>>,
    ) -> Result<(), IdentifyError> {
        out.states[instant] = flyer.y;
        self.problem.measurements.rows(instant, &flyer.y, &mut self.rows)?;
        if self.rows.is_empty() {
            return Ok(());
        }
        self.sensitivity(flyer);
        let (m, last) = (self.columns, segment.quadratic.ncols() - 1);
        for row in &mut self.rows {
            let weight = self.problem.weights[row.channel];
            let directions = self.problem.measurements.nuisance_row(row.nuisance);
            let shift: f64 = directions.iter().zip(point.nuisances.iter()).map(|(d, z)| d * z).sum();
            let residual = weight * (row.residual - shift);
            self.by.fill(0.0);
            for j in 0..SEEN {
                let factor = weight * row.jacobian[j];
                if factor != 0.0 {
                    for (b, t) in self.by.iter_mut().zip(&self.tangent[j * m..(j + 1) * m]) {
                        *b += factor * t;
                    }
                }
            }
            let q = segment.quadratic.as_mut_slice();
            let n = last + 1;
            let mut add = |column: usize, factor: f64, rows: usize| {
                for (sum, b) in q[column * n..column * n + rows].iter_mut().zip(&self.by) {
                    *sum += factor * b;
                }
            };
            for b in 0..m {
                add(b, self.by[b], b + 1);
            }
            for (b, d) in directions.iter().enumerate() {
                if *d != 0.0 {
                    add(m + b, weight * d, m);
                    out.nuisance_gradient[b] += weight * d * residual;
                }
            }
            add(last, residual, m);
            q[last * n + last] += residual * residual;
            out.chi_square += residual * residual;
            out.channel_squares[row.channel].0 += residual * residual;
            out.channel_squares[row.channel].1 += 1;
            if let Some(records) = records.as_deref_mut() {
                row.residual = residual;
                records.push(Record { segment: s, instant, row: *row, by: self.by.clone() });
            }
        }
        Ok(())
    }
}

/// A point moved by a step of [start, parameters, nuisances] with the steps of all starts.
pub(crate) fn moved_point(point: &Point, step: &DVector<f64>, starts: &[DVector<f64>]) -> Point {
    let mut out = point.clone();
    for (k, parameter) in point.model.free().iter().enumerate() {
        out.model.shift(*parameter, step[TANGENT + k]);
    }
    let first = TANGENT + point.model.free().len();
    out.nuisances += step.rows(first, point.nuisances.len());
    for (y, d) in out.starts.iter_mut().zip(starts) {
        *y = moved(y, d.as_slice());
    }
    out
}
