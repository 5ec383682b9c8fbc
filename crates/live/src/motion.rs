//! The causal filter in flight, and the estimation of its noise.

use crate::LiveError;
use mavsight_pose::{CausalFilter, MotionNoise, MotionSample, PoseSample, motion_noise};
use std::thread::JoinHandle;

/// Windows of poses for the estimation of the noise: one is available soon, one likely has a manoeuvre in it.
const WINDOWS_S: [f64; 2] = [5.0, 20.0];
/// Most poses in a window: twenty seconds at 120 Hz.
const MOST_KEPT: usize = 2400;

/// Motion from poses in real time by [`CausalFilter`], once the motion noise is known.
///
/// A noise that is not given is estimated by [`motion_noise`] on another thread from the first five seconds
/// of the flight, and again from the first twenty. The filter then processes those poses, so that its state
/// is that of a filter with this noise.
#[derive(Debug)]
pub(crate) struct MotionFilter {
    gravity_m_s2: f64,
    filter: Option<CausalFilter>,
    kept: Vec<PoseSample>,
    /// Lengths of the windows that are not used yet.
    windows_s: &'static [f64],
    /// An estimation in progress, and the number of kept poses that it uses.
    finding: Option<(JoinHandle<Option<CausalFilter>>, usize)>,
}

impl MotionFilter {
    /// A filter before its first pose; with a noise it gives motion from the first poses on.
    pub(crate) fn new(noise: Option<MotionNoise>, gravity_m_s2: f64) -> Result<Self, LiveError> {
        let filter = noise.map(|n| CausalFilter::new(n, gravity_m_s2)).transpose()?;
        let windows_s: &[f64] = if filter.is_some() { &[] } else { &WINDOWS_S };
        Ok(Self { gravity_m_s2, filter, kept: Vec::new(), windows_s, finding: None })
    }

    pub(crate) fn push(&mut self, sample: &PoseSample) -> Option<MotionSample> {
        // A pose that the filter refuses is sent without motion.
        let motion = self.filter.as_mut().and_then(|f| f.push(sample).ok().flatten());
        if !self.has_final_noise() {
            self.keep(sample);
        }
        motion
    }

    fn keep(&mut self, sample: &PoseSample) {
        if self.kept.is_empty() && sample.estimate.is_err() {
            return;
        }
        self.kept.push(sample.clone());
        if let Some((handle, had)) = self.finding.take_if(|f| f.0.is_finished()) {
            // Without an estimate the next window is tried.
            if let Ok(Some(mut filter)) = handle.join() {
                for later in &self.kept[had.min(self.kept.len())..] {
                    let _ = filter.push(later);
                }
                self.filter = Some(filter);
            }
            if self.windows_s.is_empty() {
                self.kept = Vec::new();
                return;
            }
        }
        let span_s = (sample.t_ns - self.kept[0].t_ns) as f64 * 1e-9;
        let is_full = self.kept.len() >= MOST_KEPT;
        if self.finding.is_none() && self.windows_s.first().is_some_and(|w| is_full || span_s >= *w) {
            let (poses, gravity_m_s2) = (self.kept.clone(), self.gravity_m_s2);
            let had = poses.len();
            let find = move || {
                mavsight_link::give_way();
                filter_over(&poses, gravity_m_s2)
            };
            if let Ok(handle) = std::thread::Builder::new().name("noise".into()).spawn(find) {
                self.finding = Some((handle, had));
            }
            self.windows_s = if is_full { &[] } else { &self.windows_s[1..] };
        }
    }

    /// Whether the noise is given or estimated for the last time.
    pub(crate) fn has_final_noise(&self) -> bool {
        self.windows_s.is_empty() && self.finding.is_none()
    }
}

/// A filter with the noise estimated from some poses, after these poses.
fn filter_over(poses: &[PoseSample], gravity_m_s2: f64) -> Option<CausalFilter> {
    let noise = motion_noise(poses).ok()?.of_flight();
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
        PoseSample { t_ns: k * 33_333_333, estimate: Ok(estimate) }
    }

    /// Motion is unknown until the noise is estimated, then right; in the end no poses are kept.
    #[test]
    fn the_noise_is_estimated_during_the_flight() {
        let mut filter = MotionFilter::new(None, 9.8).unwrap();
        let (mut known, mut k) = (0, 0);
        while !filter.has_final_noise() {
            assert!(k < 30 * 300, "the noise is not estimated");
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
