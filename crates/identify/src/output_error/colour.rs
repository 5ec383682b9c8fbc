//! Correlated errors of measurements: part of each channel's variance is new at every instant, part dies away
//! slowly, with time or with the path that a marker's image has gone.

use super::condense::Linear;
use super::result::Extent;
use crate::IdentifyError;
use crate::inverse::inverse;
use nalgebra::{DMatrix, DVector};

/// Along what errors die away.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Along {
    Time,
    /// A centre's error changes with background and light: with where the marker is in the image.
    Path,
}

/// The errors of one channel: a white part, and one with the autocorrelation exp(-|x|/extent), x time or path
/// (Ornstein & Uhlenbeck 1930).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Noise {
    white: f64,
    /// Variance of the correlated part over that.
    ratio: f64,
    /// In s or in px.
    extent: f64,
}

impl Noise {
    fn variance(&self) -> f64 {
        self.white * (1.0 + self.ratio)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Colour {
    along: Along,
    channels: Vec<Noise>,
    /// Share of the correlated part in the variance of all rows together.
    pub(crate) correlated_share: f64,
    /// The extents' mean, each weighed by its channel's correlated part, as a logarithm.
    mean_extent: f64,
}

/// Ratios of the correlated part's variance to the white one's that are tried, each twice the one before.
const FIRST_RATIO: f64 = 1.0 / 16.0;
const RATIOS: usize = 15;
/// Rounds in which unknowns and noise determine each other; each leaves less than a third of the error.
const ROUNDS: usize = 4;

/// One row of a channel in the filter.
struct FilterStep {
    /// How much of the state is kept since the row before.
    kept: f64,
    gain: f64,
    /// One over the standard deviation of the innovation.
    unit: f64,
}

struct Whitener {
    steps: Vec<FilterStep>,
    /// Sum of the logarithms of the innovations' variances.
    log_determinant: f64,
}

impl Whitener {
    /// The correlated part has `ratio` times the white one's variance; rows lie at `places` along time or
    /// path.
    fn new(places: &[f64], extent: f64, ratio: f64) -> Self {
        let (mut variance, mut log_determinant) = (ratio, 0.0);
        let mut before = None;
        let steps = places
            .iter()
            .map(|place| {
                let kept = before.map_or(0.0, |b: f64| (-(place - b) / extent).exp());
                before = Some(*place);
                variance = kept * kept * variance + (1.0 - kept * kept) * ratio;
                let innovation = variance + 1.0;
                let gain = variance / innovation;
                variance *= 1.0 - gain;
                log_determinant += innovation.ln();
                FilterStep { kept, gain, unit: innovation.sqrt().recip() }
            })
            .collect();
        Self { steps, log_determinant }
    }

    /// Filters the given columns of a matrix, one after the other: `take` gets each with its innovation and
    /// one over that's standard deviation.
    fn run(&self, columns: &[usize], matrix: &DMatrix<f64>, mut take: impl FnMut(usize, &DVector<f64>, f64)) {
        let mut mean = DVector::zeros(matrix.nrows());
        let mut innovation = mean.clone();
        for (column, FilterStep { kept, gain, unit }) in columns.iter().zip(&self.steps) {
            let values = matrix.column(*column);
            for ((value, m), i) in values.iter().zip(mean.as_mut_slice()).zip(innovation.as_mut_slice()) {
                *m *= kept;
                *i = value - *m;
                *m += gain * *i;
            }
            take(*column, &innovation, *unit);
        }
    }

    /// The sum of squares of the whitened columns.
    fn squares(&self, columns: &[usize], matrix: &DMatrix<f64>) -> f64 {
        let mut sum = 0.0;
        self.run(columns, matrix, |_, innovation, unit| {
            sum += innovation.norm_squared() * unit * unit;
        });
        sum
    }
}

/// Rows of each channel, and where they lie.
struct Channels {
    rows: Vec<Vec<usize>>,
    times_s: Vec<Vec<f64>>,
    /// The way that the image has gone since the channel's first row.
    paths_px: Vec<Vec<f64>>,
}

impl Channels {
    fn new(linear: &Linear, channels: usize) -> Self {
        let mut rows = vec![Vec::new(); channels];
        linear.places.iter().enumerate().for_each(|(row, place)| rows[place.channel].push(row));
        let place = |row: &usize| &linear.places[*row];
        let times = |own: &Vec<usize>| own.iter().map(|row| place(row).t_s).collect();
        let path = |own: &Vec<usize>| {
            let (mut path_px, mut before) = (0.0, None);
            let way = own.iter().map(|row| {
                let [u, v] = place(row).pixel;
                let [u0, v0] = before.replace([u, v]).unwrap_or([u, v]);
                path_px += (u - u0).hypot(v - v0);
                path_px
            });
            way.collect()
        };
        Self { times_s: rows.iter().map(times).collect(), paths_px: rows.iter().map(path).collect(), rows }
    }

    fn along(&self, along: Along) -> &[Vec<f64>] {
        match along {
            Along::Time => &self.times_s,
            Along::Path => &self.paths_px,
        }
    }

    /// The extents that are tried: from twice the mean distance of rows, each twice the one before, to the
    /// longest channel.
    fn extents(&self, along: Along) -> Vec<f64> {
        let length = |places: &Vec<f64>| places.last().zip(places.first()).map_or(0.0, |(b, a)| b - a);
        let longest = self.along(along).iter().map(length).fold(0.0, f64::max);
        let rows = self.rows.iter().map(Vec::len).max().unwrap_or_default().max(2);
        let first = 2.0 * longest / rows as f64;
        std::iter::successors(Some(first), |e| Some(2.0 * e))
            .take_while(|e| *e > 0.0 && *e < longest)
            .collect()
    }
}

impl Colour {
    /// Finds the noise by restricted maximum likelihood (Patterson & Thompson 1971), in rounds of expectation
    /// and maximisation (Dempster, Laird & Rubin 1977).
    pub(crate) fn find(linear: &Linear, channels: usize) -> Result<Self, IdentifyError> {
        let places = Channels::new(linear, channels);
        let mut found = Self::most_likely(&places, &DMatrix::from_rows(&[linear.residuals().transpose()]));
        for _ in 0..ROUNDS {
            let white = found.whitened(linear);
            let covariance = inverse(&white.information()).ok_or(IdentifyError::RankZero)?;
            let left = linear.residuals() - linear.by().tr_mul(&white.step(&covariance));
            let root = covariance.cholesky().ok_or(IdentifyError::RankZero)?.l();
            let mut series = root.tr_mul(&linear.by()).insert_row(0, 0.0);
            series.set_row(0, &left.transpose());
            let before = std::mem::replace(&mut found, Self::most_likely(&places, &series));
            if found.is_like(&before) {
                break;
            }
        }
        Ok(found)
    }

    fn is_like(&self, other: &Self) -> bool {
        let alike = |(a, b): (&Noise, &Noise)| {
            a.ratio == b.ratio && a.extent == b.extent && (a.white / b.white - 1.0).abs() < 0.02
        };
        self.along == other.along && self.channels.iter().zip(&other.channels).all(alike)
    }

    /// The most likely of all extents and ratios tried; variances follow from the squares of the series'
    /// columns.
    fn most_likely(places: &Channels, series: &DMatrix<f64>) -> Self {
        let [(by_time, time), (by_path, path)] = [Along::Time, Along::Path].map(|along| {
            let extents = places.extents(along);
            let found = places.rows.iter().zip(places.along(along));
            let found = found.map(|(rows, places)| likeliest(rows, places, series, &extents));
            let (deviances, channels): (Vec<f64>, Vec<Noise>) = found.unzip();
            (deviances.iter().sum::<f64>(), channels)
        });
        let (along, channels) = if by_path < by_time { (Along::Path, path) } else { (Along::Time, time) };
        let (mut correlated, mut all, mut extents) = (0.0, 0.0, 0.0);
        for (noise, rows) in channels.iter().zip(&places.rows) {
            let part = rows.len() as f64 * noise.white * noise.ratio;
            correlated += part;
            all += rows.len() as f64 * noise.variance();
            extents += part * noise.extent.ln();
        }
        let mean_extent = if correlated > 0.0 { (extents / correlated).exp() } else { 0.0 };
        Self { along, channels, correlated_share: correlated / all, mean_extent }
    }

    /// The model with rows of unit variance that do not hang together, if these are the errors.
    pub(crate) fn whitened(&self, linear: &Linear) -> Linear {
        let places = Channels::new(linear, self.channels.len());
        let mut out = linear.clone();
        for ((rows, along), noise) in places.rows.iter().zip(places.along(self.along)).zip(&self.channels) {
            let white = noise.white.sqrt().recip();
            let filter = Whitener::new(along, noise.extent, noise.ratio);
            out.log_variances += rows.len() as f64 * noise.white.ln() + filter.log_determinant;
            filter.run(rows, &linear.rows, |column, innovation, unit| {
                let whitened = innovation.iter().map(|i| i * unit * white);
                out.rows.column_mut(column).iter_mut().zip(whitened).for_each(|(to, value)| *to = value);
            });
        }
        out
    }

    pub(crate) fn extent(&self) -> Extent {
        match self.along {
            Along::Time => Extent::Time(self.mean_extent),
            Along::Path => Extent::Path(self.mean_extent),
        }
    }

    /// Numbers that describe it: ratio and extent of each channel that has a correlated part.
    pub(crate) fn numbers(&self) -> usize {
        2 * self.channels.iter().filter(|noise| noise.ratio > 0.0).count()
    }

    /// Variance of each channel, both parts together, in the units of the weights.
    pub(crate) fn variances(&self) -> impl Iterator<Item = f64> {
        self.channels.iter().map(Noise::variance)
    }
}

/// Minus twice the logarithm of a channel's likelihood, and the noise that makes it the largest.
fn likeliest(rows: &[usize], places: &[f64], series: &DMatrix<f64>, extents: &[f64]) -> (f64, Noise) {
    let n = rows.len() as f64;
    let mut best = (f64::INFINITY, Noise { white: 1.0, ratio: 0.0, extent: 1.0 });
    if rows.is_empty() {
        return (0.0, best.1);
    }
    let ratios = (0..RATIOS).map(|k| FIRST_RATIO * 2f64.powi(k as i32));
    let correlated = extents.iter().flat_map(|extent| ratios.clone().map(move |ratio| (*extent, ratio)));
    for (extent, ratio) in std::iter::once((1.0, 0.0)).chain(correlated) {
        let filter = Whitener::new(places, extent, ratio);
        let white = (filter.squares(rows, series) / n).max(f64::MIN_POSITIVE);
        let deviance = n * white.ln() + filter.log_determinant;
        if deviance < best.0 {
            best = (deviance, Noise { white, ratio, extent });
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    #[test]
    fn the_filter_is_the_inverse_root_of_the_covariance() {
        let times_s = [0.0, 0.1, 0.13, 0.5, 0.51, 2.0];
        let x = [0.3, -1.2, 0.7, 2.0, 1.9, -0.4];
        for (extent, ratio) in [(0.2, 3.0), (1.5, 100.0), (0.4, 0.0)] {
            let sigma = DMatrix::from_fn(6, 6, |i, j| {
                let correlated = ratio * (-f64::abs(times_s[i] - times_s[j]) / extent).exp();
                correlated + if i == j { 1.0 } else { 0.0 }
            });
            let dense = sigma.cholesky().expect("positive definite");
            let column = DMatrix::from_column_slice(6, 1, &x);
            let squares = column.dot(&dense.solve(&column));
            let filter = Whitener::new(&times_s, extent, ratio);
            let series = DMatrix::from_row_slice(1, 6, &x);
            let rows: Vec<usize> = (0..6).collect();
            assert!((filter.squares(&rows, &series) - squares).abs() < 1e-10 * squares);
            assert!((filter.log_determinant - dense.ln_determinant()).abs() < 1e-10);
            let mut sum = 0.0;
            filter.run(&rows, &series, |_, innovation, unit| sum += (innovation[0] * unit).powi(2));
            assert!((sum - squares).abs() < 1e-10 * squares);
        }
    }

    /// Errors that go with the place, of a marker that stands, moves and creeps, and errors that go with
    /// time.
    #[test]
    fn errors_by_path_are_distinguished_from_errors_by_time() {
        let (instants, channels) = (300, 8);
        let times_s: Vec<f64> = (0..instants).map(|k| k as f64 / 30.0).collect();
        let speed_px_s = |t: f64| {
            if t < 2.0 {
                0.0
            } else if t < 4.0 {
                50.0
            } else {
                10.0
            }
        };
        let mut path_px = 0.0;
        let path: Vec<f64> = times_s
            .iter()
            .map(|t| {
                path_px += speed_px_s(*t) / 30.0;
                path_px
            })
            .collect();
        let places = Channels {
            rows: (0..channels).map(|c| (0..instants).map(|i| i * channels + c).collect()).collect(),
            times_s: vec![times_s.clone(); channels],
            paths_px: vec![path.clone(); channels],
        };
        for (along, extent) in [(Along::Path, 8.0), (Along::Time, 0.5)] {
            let coordinate = if along == Along::Path { &path } else { &times_s };
            let mut random = Random::new(5, 0);
            let mut series = DMatrix::zeros(1, instants * channels);
            for channel in 0..channels {
                let mut correlated = 3.0 * random.normal();
                for i in 0..instants {
                    let apart = if i == 0 { 0.0 } else { coordinate[i] - coordinate[i - 1] };
                    let kept = f64::exp(-apart / extent);
                    correlated = kept * correlated + 3.0 * (1.0 - kept * kept).sqrt() * random.normal();
                    series[(0, i * channels + channel)] = correlated + random.normal();
                }
            }
            let found = Colour::most_likely(&places, &series);
            assert_eq!(found.along, along);
            let ratio = found.mean_extent / extent;
            assert!((0.5..2.0).contains(&ratio), "{} for {extent}", found.mean_extent);
            // 9 of 10 parts.
            assert!((0.8..0.97).contains(&found.correlated_share), "{}", found.correlated_share);
        }
    }
}
