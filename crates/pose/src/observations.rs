//! What the cameras saw in a whole flight, in as few bytes as say it.

use crate::MarkerObservation;
use mavsight_geometry::{Matrix2, Vector2};

/// Marker observations by time: 32 bytes for each, and 16 for an instant.
///
/// Pixels are exact; covariances are held in single precision, which is seven digits of a variance. Instants
/// come in the order of time, and the observations of one in the order in which they were added.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Observations {
    /// Time of each instant, and where its observations end.
    instants: Vec<(i64, usize)>,
    packed: Vec<PackedObservation>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct PackedObservation {
    pixel: Vector2<f64>,
    /// uu, uv, vv.
    covariance_px2: [f32; 3],
    camera: u16,
    marker: u16,
}

impl PackedObservation {
    fn of(seen: &MarkerObservation) -> Self {
        let c = &seen.covariance_px2;
        // No rig and no body has so many: what is beyond is refused where it is used.
        let index = |k: usize| u16::try_from(k).unwrap_or(u16::MAX);
        Self {
            pixel: seen.pixel,
            covariance_px2: [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(|v| v as f32),
            camera: index(seen.camera),
            marker: index(seen.marker),
        }
    }

    fn seen(&self, t_ns: i64) -> MarkerObservation {
        let [uu, uv, vv] = self.covariance_px2.map(f64::from);
        let (camera, marker, pixel) = (self.camera.into(), self.marker.into(), self.pixel);
        MarkerObservation { t_ns, camera, marker, pixel, covariance_px2: Matrix2::new(uu, uv, uv, vv) }
    }
}

impl Observations {
    /// Room for so many instants at which so many markers are seen. Lists that double when they are full
    /// leave behind as much again.
    pub fn reserve(&mut self, instants: usize, observations: usize) {
        self.instants.reserve(instants);
        self.packed.reserve(instants * observations);
    }

    /// Number of observations.
    pub fn len(&self) -> usize {
        self.packed.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.packed.is_empty()
    }

    /// Adds one, behind those of its time.
    pub fn push(&mut self, seen: &MarkerObservation) {
        let at = self.instants.partition_point(|i| i.0 < seen.t_ns);
        if self.instants.get(at).is_none_or(|i| i.0 != seen.t_ns) {
            self.instants.insert(at, (seen.t_ns, self.start(at)));
        }
        self.packed.insert(self.instants[at].1, PackedObservation::of(seen));
        self.instants[at..].iter_mut().for_each(|i| i.1 += 1);
    }

    fn start(&self, at: usize) -> usize {
        at.checked_sub(1).map_or(0, |before| self.instants[before].1)
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = MarkerObservation> + '_ {
        (0..self.instants.len()).flat_map(|k| {
            let (t_ns, end) = self.instants[k];
            self.packed[self.start(k)..end].iter().map(move |s| s.seen(t_ns))
        })
    }

    /// Those of a time, in place of what `out` held.
    pub fn at(&self, t_ns: i64, out: &mut Vec<MarkerObservation>) {
        out.clear();
        if let Ok(k) = self.instants.binary_search_by_key(&t_ns, |i| i.0) {
            out.extend(self.packed[self.start(k)..self.instants[k].1].iter().map(|s| s.seen(t_ns)));
        }
    }

    /// Times at which something was seen.
    pub fn times_ns(&self) -> impl ExactSizeIterator<Item = i64> + '_ {
        self.instants.iter().map(|i| i.0)
    }

    /// Multiplies the variances of columns and rows by the factors of their camera and marker; the
    /// correlation is kept.
    pub fn scale_covariances(&mut self, factors: impl Fn(usize, usize) -> Vector2<f64>) {
        for s in &mut self.packed {
            let by = factors(s.camera.into(), s.marker.into());
            for (v, by) in s.covariance_px2.iter_mut().zip([by.x, (by.x * by.y).sqrt(), by.y]) {
                *v = (f64::from(*v) * by) as f32;
            }
        }
    }
}

impl<'a> FromIterator<&'a MarkerObservation> for Observations {
    fn from_iter<T: IntoIterator<Item = &'a MarkerObservation>>(all: T) -> Self {
        let mut sorted: Vec<&MarkerObservation> = all.into_iter().collect();
        sorted.sort_by_key(|o| o.t_ns);
        let mut out = Self::default();
        sorted.into_iter().for_each(|o| out.push(o));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(t_ns: i64, camera: usize, u_px: f64) -> MarkerObservation {
        let covariance_px2 = Matrix2::new(0.04 + u_px * 1e-5, -0.01, -0.01, 0.03);
        MarkerObservation { t_ns, camera, marker: 3, pixel: Vector2::new(u_px, 1.0 / 3.0), covariance_px2 }
    }

    #[test]
    fn what_goes_in_comes_out_by_time() {
        let given =
            [seen(40, 1, 7.1), seen(10, 0, 1.1), seen(40, 0, 8.3), seen(10, 1, 2.2), seen(20, 0, 4.4)];
        let all: Observations = given.iter().collect();
        let mut one_by_one = Observations::default();
        given.iter().for_each(|o| one_by_one.push(o));
        assert_eq!(all, one_by_one);
        assert_eq!(all.times_ns().collect::<Vec<_>>(), [10, 20, 40]);
        let got: Vec<_> = all.iter().collect();
        for (got, k) in got.iter().zip([1, 3, 4, 0, 2]) {
            let want = &given[k];
            assert_eq!(
                (got.t_ns, got.camera, got.marker, got.pixel),
                (want.t_ns, want.camera, 3, want.pixel)
            );
            assert!((got.covariance_px2 - want.covariance_px2).amax() < 1e-7 * want.covariance_px2.amax());
        }
        let mut own = vec![seen(0, 0, 0.0)];
        all.at(40, &mut own);
        assert_eq!(own, got[3..]);
        all.at(41, &mut own);
        assert_eq!((own.len(), all.len()), (0, 5));
    }

    #[test]
    fn factors_are_of_camera_and_marker() {
        let mut all: Observations = [seen(0, 0, 0.0), seen(0, 1, 0.0)].iter().collect();
        all.scale_covariances(|camera, marker| Vector2::new(4.0, (camera + marker) as f64));
        let before = seen(0, 0, 0.0).covariance_px2;
        for (o, down) in all.iter().zip([3.0_f64, 4.0]) {
            let times = Matrix2::new(4.0, 2.0 * down.sqrt(), 2.0 * down.sqrt(), down);
            assert!((o.covariance_px2 - before.component_mul(&times)).amax() < 1e-6, "{}", o.covariance_px2);
        }
        assert_eq!(size_of::<PackedObservation>(), 32);
    }
}
