//! The body, predictions for planning, and a measured pose in as few bytes as say it: an hour of film has a
//! hundred thousand.

use crate::PoseError;
use mavsight_geometry::{Isometry3, Matrix2, Matrix6, Vector3};
use nalgebra::{Matrix6xX, Vector6};

/// Some of a body's markers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MarkerSet(u64);

impl MarkerSet {
    /// So many markers may a body have.
    pub const MOST: usize = u64::BITS as usize;

    /// Whether a marker is among them.
    pub fn contains(self, marker: usize) -> bool {
        marker < Self::MOST && self.0 >> marker & 1 == 1
    }

    /// How many they are.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether it is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The set without a marker.
    #[must_use]
    pub fn without(self, marker: usize) -> Self {
        self.iter().filter(|m| *m != marker).collect()
    }

    /// Their indices, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..Self::MOST).filter(move |m| self.contains(*m))
    }
}

impl FromIterator<usize> for MarkerSet {
    /// Those below [`MarkerSet::MOST`].
    fn from_iter<T: IntoIterator<Item = usize>>(markers: T) -> Self {
        Self(markers.into_iter().filter(|m| *m < Self::MOST).fold(0, |all, m| all | 1 << m))
    }
}

/// A measured pose.
///
/// Covariances are of the position in world axes (m²), then of a small turn about body axes (rad²): t + δt, R
/// exp(δθ).
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// The pose.
    pub world_from_body: Isometry3<f64>,
    /// Root mean square residual over the coordinates used. None where nothing is left over that could disagree, as of three
    /// markers in one camera, or where the pose is not from images.
    pub residual_px: Option<f64>,
    /// Markers that entered.
    pub markers_used: MarkerSet,
    /// Markers that were seen but disagree with the rigid body.
    pub left_out: MarkerSet,
    /// What is new in each frame: the upper triangle, by columns.
    own: [f64; TRIANGLE],
    /// Systematic part: columns of six, or a lower triangle by columns, which no number of columns is as
    /// long as.
    systematic: Box<[f32]>,
}

const TRIANGLE: usize = 21;

/// Row and column of each, of an upper triangle by columns.
fn places() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|j| (0..=j).map(move |i| (i, j)))
}

impl PoseEstimate {
    /// A pose of which all errors are new in each frame, by no markers that have a name.
    pub fn new(world_from_body: Isometry3<f64>, covariance: &Matrix6<f64>) -> Self {
        let mut own = [0.0; TRIANGLE];
        let mean = |(i, j)| 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
        own.iter_mut().zip(places()).for_each(|(value, at)| *value = mean(at));
        let (residual_px, markers_used, left_out, systematic) = Default::default();
        Self { world_from_body, residual_px, markers_used, left_out, own, systematic }
    }

    /// Adds what the systematic errors of cameras and marker positions do to this pose. Each column is one
    /// standard deviation along one independent direction, the same directions in all poses of a flight.
    #[must_use]
    pub fn with_systematic(self, columns: &Matrix6xX<f32>) -> Self {
        Self { systematic: columns.as_slice().into(), ..self }
    }

    /// [`Self::with_systematic`] of columns in double precision, without a copy of them in between.
    #[must_use]
    pub(crate) fn with_rounded(self, columns: &Matrix6xX<f64>) -> Self {
        let systematic = columns.as_slice().iter().map(|v| *v as f32).collect();
        Self { systematic, ..self }
    }

    /// Adds one more independent direction of systematic error, as one standard deviation. It is the same direction in all poses
    /// of a flight.
    #[must_use]
    pub fn with_systematic_column(self, column: &Vector6<f64>) -> Self {
        let is_condensed = self.is_condensed();
        let columns = self.systematic();
        let at = columns.ncols();
        let mut columns = columns.insert_column(at, 0.0);
        columns.set_column(at, &column.map(|v| v as f32));
        let more = self.with_systematic(&columns);
        if is_condensed { more.condensed() } else { more }
    }

    /// States which markers entered, which were left out, and the residual that they leave, if any can be.
    #[must_use]
    pub fn by_markers(self, markers_used: MarkerSet, left_out: MarkerSet, residual_px: Option<f64>) -> Self {
        Self { markers_used, left_out, residual_px, ..self }
    }

    /// All that is not known: pixels, cameras and marker positions.
    pub fn covariance(&self) -> Matrix6<f64> {
        let mut all = self.own_covariance();
        for c in 0..self.systematic_columns() {
            let column = self.systematic_column(c);
            all.ger(1.0, &column, &column, 1.0);
        }
        all
    }

    /// The part of the covariance that is new in each frame.
    pub fn own_covariance(&self) -> Matrix6<f64> {
        let mut own = Matrix6::zeros();
        for (value, (i, j)) in self.own.iter().zip(places()) {
            (own[(i, j)], own[(j, i)]) = (*value, *value);
        }
        own
    }

    /// The part S of the covariance S Sᵀ that is not new in each frame, in single precision: seven digits of
    /// a standard deviation. No columns: none is known.
    pub fn systematic(&self) -> Matrix6xX<f32> {
        let columns: Vec<_> =
            (0..self.systematic_columns()).map(|c| self.systematic_column(c).map(|v| v as f32)).collect();
        if columns.is_empty() { Matrix6xX::zeros(0) } else { Matrix6xX::from_columns(&columns) }
    }

    /// Number of columns of that.
    pub fn systematic_columns(&self) -> usize {
        if self.is_condensed() { 6 } else { self.systematic.len() / 6 }
    }

    /// Whether the systematic columns are those of [`Self::condensed`], which do not say how poses err
    /// together.
    pub fn is_condensed(&self) -> bool {
        self.systematic.len() == TRIANGLE
    }

    pub(crate) fn systematic_column(&self, c: usize) -> Vector6<f64> {
        if !self.is_condensed() {
            return Vector6::from_fn(|i, _| f64::from(self.systematic[6 * c + i]));
        }
        // A lower triangle's columns are an upper one's rows.
        let start = c * (13 - c) / 2;
        Vector6::from_fn(|i, _| if i < c { 0.0 } else { f64::from(self.systematic[start + i - c]) })
    }

    /// This pose without systematic columns: all of its covariance counts as random.
    #[must_use]
    pub fn all_new(self) -> Self {
        if self.systematic.is_empty() {
            return self;
        }
        let covariance = self.covariance();
        let Self { world_from_body, residual_px, markers_used, left_out, .. } = self;
        Self { residual_px, markers_used, left_out, ..Self::new(world_from_body, &covariance) }
    }

    /// This pose with no more than six systematic columns, the lower triangular root of their sum S Sᵀ: for
    /// whoever holds many poses, and has [`crate::PoseEstimator::systematic_effects`] for how they err
    /// together. What is new in the pose is as it was.
    #[must_use]
    pub fn condensed(self) -> Self {
        if self.systematic_columns() <= 6 {
            return self;
        }
        // S Sᵀ = Rᵀ R where Sᵀ = Q R.
        let rows = self.systematic().map(f64::from).transpose();
        let root = rows.qr().r().transpose().map(|v| v as f32);
        let triangle = (0..6).flat_map(|c| (c..6).map(move |i| (i, c))).map(|at| root[at]);
        Self { systematic: triangle.collect(), ..self }
    }
}

/// A ball on the body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMarker {
    /// Name in messages.
    pub name: String,
    /// Centre of the ball, body axes.
    pub marker_in_body_m: Vector3<f64>,
    /// Radius of the ball; 0 for a point.
    pub radius_m: f64,
}

/// The prediction of an observation, for planning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedObservation {
    /// Index of the camera in the rig.
    pub camera: usize,
    /// Index of the marker on the body.
    pub marker: usize,
    /// Covariance that the centre of its image will have.
    pub covariance_px2: Matrix2<f64>,
}

/// One instant: a pose, or why there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSample {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// The pose, or why there is none.
    pub estimate: Result<PoseEstimate, PoseError>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markers_are_those_that_were_put_in() {
        let some: MarkerSet = [5, 0, 63, 64, 5].into_iter().collect();
        assert_eq!(some.iter().collect::<Vec<_>>(), [0, 5, 63]);
        assert!(some.contains(63) && !some.contains(64) && !some.contains(1) && some.len() == 3);
        assert!(MarkerSet::default().is_empty() && !some.is_empty());
    }

    #[test]
    fn systematic_and_random_parts_keep_their_sizes_when_condensed() {
        let wave = |k: usize| (1.7 * k as f64).sin();
        let scale = [1e-3, 2e-3, 1e-4, 0.02, 0.01, 0.5];
        let root = Matrix6::from_fn(|i, j| scale[i] * (wave(6 * i + j) + if i == j { 2.0 } else { 0.0 }));
        let own = root * root.transpose();
        let columns = Matrix6xX::from_fn(20, |i, j| (scale[i] * wave(7 * j + i)) as f32);
        let sum = columns.map(f64::from) * columns.map(f64::from).transpose();
        let many = PoseEstimate::new(Isometry3::identity(), &own).with_systematic(&columns);
        let close = |a: &Matrix6<f64>, b: &Matrix6<f64>, to: f64| {
            (0..6)
                .all(|i| (0..6).all(|j| (a[(i, j)] - b[(i, j)]).abs() < to * (b[(i, i)] * b[(j, j)]).sqrt()))
        };
        assert_eq!((many.systematic(), many.systematic_columns()), (columns, 20));
        assert!(close(&many.covariance(), &(own + sum), 1e-14) && close(&many.own_covariance(), &own, 1e-15));
        let few = many.clone().condensed();
        assert_eq!((few.systematic_columns(), few.own_covariance()), (6, many.own_covariance()));
        assert!(close(&few.covariance(), &many.covariance(), 3e-7));
        assert_eq!(few.systematic()[(0, 1)], 0.0);
        let further = Vector6::from_fn(|i, _| scale[i] * wave(3 * i));
        for pose in [&many, &few] {
            let more = pose.clone().with_systematic_column(&further);
            assert!(close(&more.covariance(), &(own + sum + further * further.transpose()), 1e-6));
            assert_eq!(more.is_condensed(), pose.is_condensed());
        }
        let new = many.clone().all_new();
        assert_eq!((new.systematic_columns(), new.own_covariance()), (0, many.covariance()));
        // Two directions alone have a root of two columns.
        let two = many.with_systematic(&Matrix6xX::from_fn(2, |i, j| wave(i + 3 * j) as f32)).condensed();
        assert_eq!(two.systematic_columns(), 2);
    }
}
