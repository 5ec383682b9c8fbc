//! Multiple shooting: segments that are flown each from its own start, and what was seen on them as rows that
//! are linear about a point.

use super::measure::Measurements;
use super::model::{Equations, FlightModel};
use super::propagate::{
    Propagator, Raster, SEEN, SHORTEST_TIME_CONSTANT_S, difference, fastest, longest_step_s, moved,
};
use super::row::Row;
use super::sensor::input_rates;
use crate::IdentifyError;
use mavsight_flight::{FlightError, InputSeries};
use mavsight_model::{FurtherState, RIGID_STATES};
use nalgebra::{DMatrix, DVector, DVectorView};

#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) model: FlightModel,
    /// Whitened nuisances.
    pub(crate) nuisances: DVector<f64>,
    pub(crate) starts: Vec<Vec<f64>>,
}

impl Point {
    /// This point after a step of [start, parameters, nuisances, -1], of which the starts of all segments are
    /// the given linear functions.
    pub(crate) fn moved(&self, step: &DVector<f64>, starts: &[DMatrix<f64>]) -> Self {
        let mut out = self.clone();
        let (tangent, free) = (starts.first().map_or(0, DMatrix::nrows), self.model.free().len());
        for (k, parameter) in self.model.free().iter().enumerate() {
            out.model.shift(*parameter, step[tangent + k]);
        }
        out.nuisances += step.rows(tangent + free, self.nuisances.len());
        for (y, by) in out.starts.iter_mut().zip(starts) {
            *y = moved(y, (by * step).as_slice());
        }
        out
    }
}

impl Point {
    /// Free parameters that a step would take beyond their bounds, by their places, and the steps to the
    /// bound.
    pub(crate) fn beyond_bounds(&self, step: &DVector<f64>, tangent: usize) -> Vec<(usize, f64)> {
        let free = self.model.free().iter().enumerate();
        free.filter_map(|(k, p)| Some((k, self.model.step_to_bound(*p, step[tangent + k])?))).collect()
    }
}

/// What a fit keeps fixed while a point varies.
pub(crate) struct Shooting<'a> {
    /// Of the columns that the model reads.
    pub(crate) inputs: InputSeries,
    pub(crate) equations: Equations,
    pub(crate) measurements: &'a Measurements,
    pub(crate) times_s: Vec<f64>,
    /// Instant at which each segment begins, and one past the last instant.
    pub(crate) bounds: Vec<usize>,
    /// One over the standard deviation factor of each channel.
    pub(crate) weights: Vec<f64>,
    /// Parameters in which the equations are not linear keep their values.
    pub(crate) hold_nonlinear: bool,
    pub(crate) longest_step_s: f64,
    /// Inverse standard deviations and mean of the start's degrees of freedom.
    pub(crate) prior_weights: Vec<f64>,
    pub(crate) prior_start: Vec<f64>,
    /// What is known of free parameters before the flight.
    pub(crate) parameter_priors: Vec<ParameterPrior>,
    /// [`gap_std`].
    pub(crate) gap_std: DVector<f64>,
    /// Variance that process noise adds to each degree of freedom of the gaps, per second; zero in output
    /// error.
    pub(crate) process_noise: DVector<f64>,
}

/// What is known of a free parameter before the flight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterPrior {
    /// Its place in the list of free ones.
    pub(crate) place: usize,
    pub(crate) value: f64,
    pub(crate) std: f64,
}

/// Of a further state, the gap's standard deviation over the usual excursion.
const EXCURSIONS: f64 = 5.0;
/// A gap is open if its standard deviations are so many times those of [`gap_std`].
pub(super) const OPEN: f64 = 100.0;
/// Where nothing is measured for longer, the flight starts anew: an unstable aircraft's motion behind the gap says
/// nothing of that before it.
pub(super) const LONGEST_GAP_S: f64 = 2.0;

/// Standard deviations of the gap from the end of one segment to the start of the next, to be multiplied by
/// the tightness: m, rad, m/s, rad/s, and five times the usual excursion of a further state.
pub(crate) fn gap_std(further: &[FurtherState]) -> DVector<f64> {
    let rigid = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 10.0, 10.0, 10.0];
    DVector::from_iterator(
        rigid.len() + further.len(),
        rigid.into_iter().chain(further.iter().map(|s| EXCURSIONS * s.size)),
    )
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
    pub(crate) t_s: f64,
    /// Its instant, counted in the series that it belongs to.
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
    pub(crate) states: Vec<Vec<f64>>,
    /// Degrees of freedom of a state.
    pub(crate) tangent: usize,
    /// Number of free parameters.
    pub(crate) parameters: usize,
    gap_std: DVector<f64>,
    process_noise: DVector<f64>,
    /// How each segment ends.
    ends: Vec<SegmentEnd>,
}

/// How a segment ends.
#[derive(Debug, Clone, Copy)]
struct SegmentEnd {
    /// From its first instant to that of the next.
    length_s: f64,
    /// The next one starts anew: nothing was measured for too long, or what was contradicts this one.
    is_cut: bool,
}

/// Where what is seen of a segment goes.
struct Seen<'a> {
    point: &'a Point,
    rows: &'a mut Vec<f64>,
    out: &'a mut Evaluation,
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
    pub(crate) fn gaps(&self) -> impl Iterator<Item = DVectorView<'_, f64>> {
        self.segments.iter().map(|s| s.next.column(s.next.ncols() - 1))
    }

    /// Inverse variances of the gap behind a segment: its process noise, and a penalty that is as good as a
    /// constraint where that is none. Where the next one starts anew, further states are within their usual
    /// excursions and all else is open.
    pub(crate) fn gap_information(&self, segment: usize, tightness: f64) -> DVector<f64> {
        let SegmentEnd { length_s, is_cut } = self.ends[segment];
        if is_cut {
            let open = |k: usize, std: f64| if k < RIGID_STATES - 1 { std * OPEN } else { std / EXCURSIONS };
            return DVector::from_fn(self.tangent, |k, _| open(k, self.gap_std[k]).powi(-2));
        }
        self.gap_std
            .zip_map(&self.process_noise, |std, noise| ((std * tightness).powi(2) + noise * length_s).recip())
    }

    /// Degrees of freedom of the gap behind a segment that have process noise, with its standard deviation.
    pub(crate) fn noise_std(&self, segment: usize) -> impl Iterator<Item = (usize, f64)> {
        let SegmentEnd { length_s, is_cut } = self.ends[segment];
        let noises = self.process_noise.iter().enumerate().filter(move |(_, noise)| !is_cut && **noise > 0.0);
        noises.map(move |(k, noise)| (k, (noise * length_s).sqrt()))
    }

    pub(crate) fn merit(&self, tightness: f64) -> f64 {
        let squares: f64 = self.residuals().chain(residuals(&self.prior)).map(|r| r * r).sum();
        let penalty = |(s, gap): (usize, DVectorView<'_, f64>)| {
            self.gap_information(s, tightness).dot(&gap.component_mul(&gap))
        };
        squares + self.gaps().enumerate().map(penalty).sum::<f64>()
    }
}

impl Shooting<'_> {
    /// Steps are those of the raster, as short as the equations at the segment's start need.
    fn raster(&self, model: &FlightModel, longest_s: f64) -> Raster<'_> {
        Raster {
            inputs: &self.inputs,
            lag_s: model.input_lag_s,
            times_s: &self.times_s,
            longest_s: self.longest_step_s.min(longest_s),
        }
    }

    pub(crate) fn evaluate(&self, point: &Point) -> Result<Evaluation, IdentifyError> {
        self.fly(point, |_, _, start| start.to_vec()).map(|(at, _)| at)
    }

    /// The flight about a point whose segments begin where `begin` says: from the number of a segment, the
    /// state at the end of the one before, and the point's own start of it.
    pub(crate) fn fly(
        &self,
        point: &Point,
        begin: impl Fn(usize, &[f64], &[f64]) -> Vec<f64>,
    ) -> Result<(Evaluation, Vec<Vec<f64>>), IdentifyError> {
        let parameters = point.model.free().len();
        let mut out = Evaluation {
            segments: Vec::with_capacity(point.starts.len()),
            prior: self.prior(point),
            places: Vec::new(),
            states: vec![vec![f64::NAN; self.equations.dynamics.states()]; self.times_s.len()],
            tangent: self.equations.tangent(),
            parameters,
            gap_std: self.gap_std.clone(),
            process_noise: self.process_noise.clone(),
            ends: self.ends(),
        };
        let values = self.equations.values(&point.model);
        let mut evaluation = self.equations.dynamics.with(&values);
        let mut starts = Vec::with_capacity(point.starts.len());
        starts.push(point.starts[0].clone());
        for s in 0..point.starts.len() {
            let (mut segment, mut end) = self.segment(s, &starts[s], point, &mut evaluation, &mut out)?;
            if let Some(own) = point.starts.get(s + 1) {
                if out.ends[s].is_cut {
                    end = self.afresh(s + 1, point);
                }
                let start = begin(s + 1, &end, own);
                let last = segment.next.ncols() - 1;
                segment.next.column_mut(last).copy_from_slice(&difference(&start, &end));
                starts.push(start);
            }
            out.segments.push(segment);
        }
        Ok((out, starts))
    }

    /// The state from which a segment that starts anew is expected: its own, with further states as at the
    /// beginning of a flight.
    fn afresh(&self, segment: usize, point: &Point) -> Vec<f64> {
        let input = self.raster(&point.model, f64::INFINITY).input_at(self.times_s[self.bounds[segment]]);
        let model = &point.model;
        let further = model.model().initial(model.values(), self.inputs.row(input));
        [&point.starts[segment][..RIGID_STATES], &further].concat()
    }

    /// Whether the motion behind an instant's predecessor says nothing of it.
    fn begins_anew(&self, instant: usize) -> bool {
        self.times_s[instant] - self.times_s[instant - 1] > LONGEST_GAP_S
            || self.measurements.begins_anew(instant)
    }

    fn ends(&self) -> Vec<SegmentEnd> {
        let last = self.times_s.len() - 1;
        let end = |w: &[usize]| SegmentEnd {
            length_s: self.times_s[w[1].min(last)] - self.times_s[w[0]],
            is_cut: w[1] <= last && self.begins_anew(w[1]),
        };
        self.bounds.windows(2).map(end).collect()
    }

    /// A segment, its gap still closed, and the state at its end.
    fn segment(
        &self,
        s: usize,
        start: &[f64],
        point: &Point,
        evaluation: &mut mavsight_model::Evaluation<'_>,
        out: &mut Evaluation,
    ) -> Result<(Segment, Vec<f64>), IdentifyError> {
        let is_cut = out.ends[s].is_cut;
        let ends_here = is_cut || s + 2 == self.bounds.len();
        let (from, to) = (self.bounds[s], self.bounds[s + 1] - usize::from(ends_here));
        let begin = self.raster(&point.model, f64::INFINITY).input_at(self.times_s[from]);
        evaluation.set_inputs(self.inputs.row(begin));
        let fastest = fastest(evaluation, start);
        if fastest.time_s < SHORTEST_TIME_CONSTANT_S {
            let refused = point.model.model().too_fast(fastest, SHORTEST_TIME_CONSTANT_S);
            return Err(FlightError::ModelFile(refused).into());
        }
        let raster = self.raster(&point.model, longest_step_s(fastest));
        let mut flyer = Propagator::new(&self.equations, start);
        let mut rows = Vec::new();
        self.see(&flyer, evaluation, from, &mut Seen { point, rows: &mut rows, out })?;
        // The instant at which the next segment starts belongs to that.
        let instants = from + 1..to + usize::from(ends_here);
        for step in raster.steps(self.times_s[from], self.times_s[to], instants) {
            flyer.step(evaluation, &self.inputs, &step);
            if let Some(instant) = step.instant {
                self.see(&flyer, evaluation, instant, &mut Seen { point, rows: &mut rows, out })?;
            }
        }
        if !flyer.is_finite() {
            return Err(IdentifyError::RanAway(self.times_s[from]));
        }
        let n = out.prior.nrows();
        let mut next = DMatrix::zeros(self.equations.tangent(), n);
        if !is_cut {
            let by = self.sensitivity(&flyer);
            next.columns_mut(0, by.nrows()).copy_from(&by.transpose());
        }
        Ok((Segment { rows: DMatrix::from_vec(n, rows.len() / n, rows), next }, flyer.y))
    }

    /// Derivative of the state's degrees of freedom, a column each, by start and parameters.
    fn sensitivity(&self, flyer: &Propagator<'_>) -> DMatrix<f64> {
        let mut out = flyer.tangent();
        if self.hold_nonlinear {
            let held = self.equations.is_linear.iter().enumerate().filter(|(_, is_linear)| !**is_linear);
            held.for_each(|(k, _)| out.row_mut(self.equations.tangent() + k).fill(0.0));
        }
        out
    }

    /// Appends the rows of an instant to those of its segment; the evaluation has the inputs of the instant.
    fn see(
        &self,
        flyer: &Propagator<'_>,
        evaluation: &mut mavsight_model::Evaluation<'_>,
        instant: usize,
        to: &mut Seen<'_>,
    ) -> Result<(), IdentifyError> {
        let Seen { point, rows, out } = to;
        out.states[instant].clone_from(&flyer.y);
        let mut seen: Vec<Row<'_>> = self.measurements.rows(instant, &flyer.y)?;
        if let Some(sample) = self.measurements.sample(instant) {
            let input = self.raster(&point.model, f64::INFINITY).input_at(self.times_s[instant]);
            let rates = input_rates(&self.inputs, input);
            seen.extend(sample.rows(&flyer.y, evaluation, &self.equations, &rates)?);
        }
        if seen.is_empty() {
            return Ok(());
        }
        let tangent = self.sensitivity(flyer);
        let mut by = DVector::zeros(tangent.nrows());
        for row in seen {
            let weight = self.weights[row.channel];
            by.gemv(weight, &tangent.columns(0, SEEN), &row.by_pose, 0.0);
            for (k, slope) in row.by_rest {
                by.axpy(weight * slope, &tangent.column(k), 1.0);
            }
            for (place, slope) in row.by_parameter {
                if !self.hold_nonlinear || self.equations.is_linear[place] {
                    by[self.equations.tangent() + place] += weight * slope;
                }
            }
            rows.extend(by.iter());
            let shift: f64 = row.directions.iter().zip(&point.nuisances).map(|(d, z)| d * z).sum();
            let unmoved = point.nuisances.len() - row.directions.len();
            rows.extend(row.directions.iter().map(|d| weight * d).chain(std::iter::repeat_n(0.0, unmoved)));
            rows.push(weight * (row.residual - shift));
            let Row { instant: own, channel, pixel, .. } = row;
            out.places.push(Place { t_s: self.times_s[instant], instant: own, channel, pixel });
        }
        Ok(())
    }

    /// The start and parameters are known as well as the priors say, each nuisance is a standard normal
    /// number.
    fn prior(&self, point: &Point) -> DMatrix<f64> {
        let (tangent, k) = (self.equations.tangent(), point.nuisances.len());
        let m = tangent + point.model.free().len();
        let mut out = DMatrix::zeros(m + k + 1, tangent + k + self.parameter_priors.len());
        let off = difference(&self.prior_start, &point.starts[0]);
        for (i, weight) in self.prior_weights.iter().enumerate() {
            out[(i, i)] = *weight;
            out[(m + k, i)] = weight * off[i];
        }
        for (i, nuisance) in point.nuisances.iter().enumerate() {
            out[(m + i, tangent + i)] = 1.0;
            out[(m + k, tangent + i)] = -nuisance;
        }
        for (i, prior) in self.parameter_priors.iter().enumerate() {
            let now = point.model.value(point.model.free()[prior.place]);
            out[(tangent + prior.place, tangent + k + i)] = 1.0 / prior.std;
            out[(m + k, tangent + k + i)] = (prior.value - now) / prior.std;
        }
        out
    }
}
