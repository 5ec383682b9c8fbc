//! The causal filter in flight, and the noise that it goes by.

use crate::LiveError;
use mavsight_pose::{CausalFilter, MotionNoise, MotionSample, PoseSample, motion_noise};
use std::thread::JoinHandle;

/// Seconds of poses from which the noise is first estimated, and from which it is estimated for good: a manoeuvre shows itself in
/// the second, while the first is soon there.
const WINDOWS_S: [f64; 2] = [5.0, 20.0];
/// Poses that are kept for that at most: twenty seconds at 120 Hz.
const MOST_KEPT: usize = 2400;

/// Motion from poses as they come: [`CausalFilter`], once the noise is known.
///
/// Where it was not given, the noise is estimated beside the flight from its first five seconds, and again from its first twenty
/// ([`motion_noise`], the smoother's own); the filter is then run over those poses, so that it stands as if it had known.
#[derive(Debug)]
pub struct MotionFilter {
    gravity_m_s2: f64,
    filter: Option<CausalFilter>,
    kept: Vec<PoseSample>,
    /// Windows that were estimated from.
    done: usize,
    /// An estimation under way, and how many of the poses kept it has.
    finding: Option<(JoinHandle<Option<CausalFilter>>, usize)>,
}

impl MotionFilter {
    /// A filter before its first pose; with a noise it knows motion from the first poses on.
    ///
    /// # Errors
    /// A noise or gravity that is none.
    pub fn new(noise: Option<MotionNoise>, gravity_m_s2: f64) -> Result<Self, LiveError> {
        let filter = noise.map(|n| CausalFilter::new(n, gravity_m_s2)).transpose()?;
        let done = if filter.is_some() { WINDOWS_S.len() } else { 0 };
        Ok(Self { gravity_m_s2, filter, kept: Vec::new(), done, finding: None })
    }

    /// Takes one instant in: the motion then, where it is known.
    pub fn push(&mut self, sample: &PoseSample) -> Option<MotionSample> {
        // What the filter cannot take leaves it as it was; the pose itself goes out all the same.
        let motion = self.filter.as_mut().and_then(|f| f.push(sample).ok().flatten());
        if !self.is_settled() {
            self.keep(sample);
        }
        motion
    }

    fn keep(&mut self, sample: &PoseSample) {
        if self.kept.is_empty() && sample.estimate.is_none() {
            return;
        }
        self.kept.push(sample.clone());
        if let Some((handle, had)) = self.finding.take_if(|f| f.0.is_finished()) {
            // Without an estimate, from poses that tell nothing, the next window has another try.
            if let Ok(Some(mut filter)) = handle.join() {
                for later in &self.kept[had.min(self.kept.len())..] {
                    let _ = filter.push(later);
                }
                self.filter = Some(filter);
            }
            if self.done == WINDOWS_S.len() {
                self.kept = Vec::new();
            }
        }
        let long_s = match (self.kept.first(), self.kept.last()) {
            (Some(first), Some(last)) => (last.t_ns - first.t_ns) as f64 * 1e-9,
            _ => 0.0,
        };
        let is_full = self.kept.len() >= MOST_KEPT;
        if self.finding.is_none()
            && self.done < WINDOWS_S.len()
            && (is_full || WINDOWS_S.get(self.done).is_some_and(|w| long_s >= *w))
        {
            let (poses, gravity_m_s2) = (self.kept.clone(), self.gravity_m_s2);
            let had = poses.len();
            let find = move || {
                crate::give_way();
                filter_over(&poses, gravity_m_s2)
            };
            if let Ok(handle) = std::thread::Builder::new().name("noise".into()).spawn(find) {
                self.finding = Some((handle, had));
            }
            self.done = if is_full { WINDOWS_S.len() } else { self.done + 1 };
        }
    }
}

impl MotionFilter {
    /// Whether poses are still kept for an estimation.
    pub fn is_settled(&self) -> bool {
        self.done == WINDOWS_S.len() && self.finding.is_none()
    }
}

/// The filter with the noise of some poses, after them.
fn filter_over(poses: &[PoseSample], gravity_m_s2: f64) -> Option<CausalFilter> {
    let noise = motion_noise(poses).ok()?;
    let mut filter = CausalFilter::new(noise, gravity_m_s2).ok()?;
    poses.iter().for_each(|p| {
        let _ = filter.push(p);
    });
    Some(filter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3};
    use mavsight_pose::PoseEstimate;
    use mavsight_random::Random;

    /// A body that swings, measured to a millimetre and a milliradian.
    fn sample(k: i64) -> PoseSample {
        let mut random = Random::new(1, k as u64);
        let mut noise = || 1e-3 * random.normal();
        let t_s = k as f64 / 30.0;
        let place = Vector3::new(0.3 * (2.0 * t_s).sin() + noise(), noise(), 1.5 + noise());
        let turn = Vector3::new(0.2 * (3.0 * t_s).sin() + noise(), noise(), noise());
        let estimate = PoseEstimate::new(
            Isometry3::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn)),
            &(Matrix6::identity() * 1e-6),
        );
        PoseSample { t_ns: k * 33_333_333, estimate: Some(estimate), reason: None }
    }

    /// Unknown until it is estimated, then right, and nothing is kept in the end.
    #[test]
    fn the_noise_is_found_beside_the_flight() {
        let mut filter = MotionFilter::new(None, 9.8).unwrap();
        let (mut known, mut k) = (0, 0);
        while !filter.is_settled() {
            assert!(k < 30 * 300, "it does not settle");
            let motion = filter.push(&sample(k));
            assert!(k >= 150 || motion.is_none(), "instant {k}");
            if let Some(motion) = motion {
                known += 1;
                let t_s = k as f64 / 30.0;
                let error = motion.rates_rad_s.x - 0.6 * (3.0 * t_s).cos();
                let std = motion.covariance.variance(9).sqrt();
                assert!(error.abs() < 6.0 * std + 0.02 && std < 0.2, "{t_s}: {error} ± {std}");
            }
            if filter.finding.is_some() {
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            k += 1;
        }
        assert!(known > 100 && filter.kept.capacity() == 0 && filter.push(&sample(k)).is_some());
    }
}
