//! Multiple shooting: segments, their quadratic models, and the step that fits them together.

use super::measure::{Measurements, Row};
use super::model::FlightModel;
use super::propagate::{Propagator, Raster, SEEN, Step, TANGENT, difference, moved};
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

/// What stays while a point varies.
pub(crate) struct Problem<'a> {
    pub(crate) inputs: &'a [InputSample],
    pub(crate) measurements: &'a Measurements,
    pub(crate) times_s: Vec<f64>,
    /// Instant at which each segment begins, and one past the last instant.
    pub(crate) bounds: Vec<usize>,
    /// One over the standard deviation factor of each channel.
    pub(crate) weights: Vec<f64>,
    /// Flapping times and the lag stay where they are.
    pub(crate) hold_times: bool,
    /// The longest step of the integration.
    pub(crate) longest_step_s: f64,
    /// Gram matrix of the weighted nuisance directions.
    pub(crate) nuisance_gram: DMatrix<f64>,
    /// Inverse variance and mean of the start's degrees of freedom.
    pub(crate) prior_information: [f64; TANGENT],
    pub(crate) prior_start: StateVector,
}

/// How far the end of one segment may miss the start of the next: standard deviations per degree of freedom, to be
/// multiplied by the tightness: m, rad, m/s, rad/s, rad. A penalty stands for the constraint; what it leaves open is
/// far below what any measurement tells.
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
    /// The same with priors, without gaps.
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
    problem: &'a Problem<'a>,
    columns: usize,
    held: Vec<usize>,
    tangent: Vec<f64>,
    by: Vec<f64>,
    rows: Vec<Row>,
}

impl Problem<'_> {
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

/// Added to a unit diagonal, so that a direction that is not determined stays where it is.
const RIDGE: f64 = 1e-13;

/// The quadratic of all segments in [start, parameters, nuisances, -1], and how the later starts follow.
pub(crate) struct Condensed {
    quadratic: DMatrix<f64>,
    /// Per gap: K with the next start = u - K [u, parameters, nuisances, -1].
    gains: Vec<DMatrix<f64>>,
}

impl Condensed {
    /// Folds the segments into the first from the last on: at each gap the next start is eliminated, with
    /// x = u + c, u what the segment before leads to and c held near zero (Bock 1983; Albersmeyer & Diehl 2010).
    pub(crate) fn new(
        problem: &Problem<'_>,
        at: &Evaluation,
        nuisances: &DVector<f64>,
        (tightness, damping): (f64, f64),
    ) -> Result<Self, IdentifyError> {
        let n = at.segments[0].quadratic.ncols();
        let m = at.segments[0].end_by.ncols();
        let k = n - 1 - m;
        let damped = |s: usize| {
            let mut q = at.segments[s].quadratic.clone();
            for i in 0..m {
                q[(i, i)] *= 1.0 + damping;
            }
            q
        };
        let information = gap_information(tightness);
        let mut gains = Vec::with_capacity(at.segments.len());
        let mut q = damped(at.segments.len() - 1);
        for s in (0..at.segments.len() - 1).rev() {
            let mut block = q.view((0, 0), (TANGENT, TANGENT)).into_owned();
            for i in 0..TANGENT {
                block[(i, i)] += information[i];
            }
            let top = q.rows(0, TANGENT).into_owned();
            let gain = block.cholesky().ok_or(IdentifyError::RankZero)?.solve(&top);
            q -= top.transpose() * &gain;
            // Top rows as W (L + W)⁻¹ L in place of L - L (L + W)⁻¹ L, which cancels where W is small beside L.
            for i in 0..TANGENT {
                for j in 0..n {
                    let value = information[i] * gain[(i, j)];
                    q[(i, j)] = value;
                    q[(j, i)] = value;
                }
            }
            for i in 0..TANGENT {
                for j in 0..i {
                    let mean = 0.5 * (information[i] * gain[(i, j)] + information[j] * gain[(j, i)]);
                    q[(i, j)] = mean;
                    q[(j, i)] = mean;
                }
            }
            gains.push(gain);
            q = fold(&q, &at.segments[s], m) + damped(s);
        }
        gains.reverse();
        let last = n - 1;
        for a in 0..k {
            for b in 0..k {
                q[(m + a, m + b)] += problem.nuisance_gram[(a, b)];
            }
            q[(m + a, m + a)] += 1.0;
            // Rows hold no part of this: the gradient counts each row and the prior once.
            q[(m + a, last)] += at.nuisance_gradient[a];
            q[(last, m + a)] += at.nuisance_gradient[a];
        }
        q[(last, last)] += nuisances.norm_squared();
        Ok(Self { quadratic: q, gains })
    }

    /// Information on [start, parameters, nuisances].
    pub(crate) fn information(&self) -> DMatrix<f64> {
        let n = self.quadratic.ncols() - 1;
        self.quadratic.view((0, 0), (n, n)).into_owned()
    }

    /// The step to the minimum in [start, parameters, nuisances], and the squares that remain there.
    pub(crate) fn minimum(&self) -> Option<(DVector<f64>, f64)> {
        let n = self.quadratic.ncols() - 1;
        let b = self.quadratic.view((0, n), (n, 1)).into_owned();
        let a = self.information();
        let scale = DVector::from_fn(n, |i, _| 1.0 / a[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let mut scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * scale[i] * scale[j]);
        for i in 0..n {
            scaled[(i, i)] += RIDGE;
        }
        let right = DVector::from_fn(n, |i, _| b[i] * scale[i]);
        let step = scaled.cholesky()?.solve(&right).component_mul(&scale);
        let left = self.quadratic[(n, n)] - b.column(0).dot(&step);
        step.iter().all(|v| v.is_finite()).then_some((step, left))
    }

    /// Steps of all segments' starts for a step of [start, parameters, nuisances]; `constant` 1 goes along with the gaps, 0
    /// asks for the linear part alone.
    pub(crate) fn expand(&self, at: &Evaluation, step: &DVector<f64>, constant: f64) -> Vec<DVector<f64>> {
        let m = at.segments[0].end_by.ncols();
        let mut out = vec![step.rows(0, TANGENT).into_owned()];
        let mut full = DVector::zeros(step.len() + 1);
        full.rows_mut(0, step.len()).copy_from(step);
        full[step.len()] = -constant;
        for (segment, gain) in at.segments.iter().zip(&self.gains) {
            let mut u = &segment.end_by * full.rows(0, m);
            for i in 0..TANGENT {
                u[i] -= constant * segment.gap[i];
            }
            full.rows_mut(0, TANGENT).copy_from(&u);
            u -= gain * &full;
            full.rows_mut(0, TANGENT).copy_from(&u);
            out.push(u);
        }
        out
    }
}

/// Puts what one segment's end leads to in the place of the next one's start.
fn fold(q: &DMatrix<f64>, segment: &Segment, m: usize) -> DMatrix<f64> {
    let n = q.ncols();
    // x_next = [Φ S 0 gap] [x, parameters, nuisances, -1]; the other variables stay.
    let mut t = DMatrix::zeros(TANGENT, n);
    t.view_mut((0, 0), (TANGENT, m)).copy_from(&segment.end_by);
    for i in 0..TANGENT {
        t[(i, n - 1)] = segment.gap[i];
    }
    let mut rest = q.clone();
    rest.rows_mut(0, TANGENT).fill(0.0);
    let top = q.rows(0, TANGENT).into_owned();
    let mut cross = top.clone();
    cross.columns_mut(0, TANGENT).fill(0.0);
    rest.columns_mut(0, TANGENT).fill(0.0);
    let mixed = t.transpose() * cross;
    let inner = top.columns(0, TANGENT) * &t;
    rest + &mixed + mixed.transpose() + t.transpose() * inner
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
