//! What the cameras saw at some instants, spread over the flight.

use super::decoys::Unclaimed;
use mavsight_pose::{Association, MarkerObservation, Observations, TrackedDetection};

/// Instants that are looked at: half of them outvote those of a false match.
pub(crate) const SAMPLED: usize = 60;

/// Observations of some instants, of markers that are identified by their colours alone, and of those that
/// the association has identified.
#[derive(Debug, Default)]
pub(crate) struct ObservationSample {
    lone: Observations,
    associated: Observations,
    unclaimed: Unclaimed,
    /// Lone balls of each camera, and those of them that the association has taken for a marker.
    by_camera: Vec<(usize, usize)>,
    taken: usize,
    /// Instants from one that is taken to the next, and those until then.
    every: usize,
    until_next: usize,
}

impl ObservationSample {
    pub(crate) fn spread_over(&mut self, instants: usize) {
        self.every = instants / SAMPLED;
    }

    pub(crate) fn is_full(&self) -> bool {
        self.taken >= SAMPLED
    }

    pub(crate) fn unclaimed(&self) -> &Unclaimed {
        &self.unclaimed
    }

    pub(crate) fn lone(&self) -> &Observations {
        &self.lone
    }

    /// What the association has identified, where it has taken most of the lone balls of every camera.
    pub(crate) fn associated(&self) -> Option<&Observations> {
        let most = |(lone, taken): &(usize, usize)| 2 * taken > *lone || *lone == 0;
        (!self.associated.is_empty() && self.by_camera.iter().all(most)).then_some(&self.associated)
    }

    /// Takes an instant, without the cameras that are left out, if it is one's turn; one that says nothing leaves
    /// its turn to the next.
    pub(crate) fn take(
        &mut self,
        seen: &[TrackedDetection],
        colors: &[usize],
        found: &Association,
        is_out: impl Fn(usize) -> bool,
    ) {
        if self.until_next > 0 || self.is_full() {
            self.until_next = self.until_next.saturating_sub(1);
            return;
        }
        let t_ns = found.sample.t_ns;
        self.unclaimed.take(seen, colors, found);
        let mut lone = lone(t_ns, seen, colors);
        lone.retain(|o| !is_out(o.camera));
        // Four in two cameras, or in one of them, have more coordinates than a pose.
        if lone.len() < 4 {
            return;
        }
        for own in &lone {
            let is_taken = found.pairs.iter().any(|(index, marker)| {
                let of = &seen[*index];
                *marker == own.marker && of.camera == own.camera && of.pixel == own.pixel
            });
            if self.by_camera.len() <= own.camera {
                self.by_camera.resize(own.camera + 1, (0, 0));
            }
            let (all, taken) = &mut self.by_camera[own.camera];
            *all += 1;
            *taken += usize::from(is_taken);
            self.lone.push(own);
        }
        for (index, marker) in &found.pairs {
            self.associated.push(&MarkerObservation { t_ns, ..seen[*index].of_marker(*marker) });
        }
        self.taken += 1;
        self.until_next = self.every.saturating_sub(1);
    }
}

/// Balls that are the only ones of their colour in their camera, as the only markers of it.
fn lone(t_ns: i64, seen: &[TrackedDetection], color_of_marker: &[usize]) -> Vec<MarkerObservation> {
    let is_lone = |c: &&TrackedDetection| {
        seen.iter().filter(|o| (o.camera, o.color) == (c.camera, c.color)).count() == 1
            && color_of_marker.iter().filter(|m| **m == c.color).count() == 1
    };
    let identified = |c: &TrackedDetection| {
        let marker = color_of_marker.iter().position(|m| *m == c.color)?;
        Some(MarkerObservation { t_ns, ..c.of_marker(marker) })
    };
    seen.iter().filter(is_lone).filter_map(identified).collect()
}

/// At most [`SAMPLED`] instants, spread evenly.
pub(crate) fn sampled(observations: &Observations) -> Vec<Vec<MarkerObservation>> {
    let times_ns: Vec<i64> = observations.times_ns().collect();
    let count = SAMPLED.min(times_ns.len());
    let at = |k: usize| {
        let mut seen = Vec::new();
        observations.at(times_ns[(2 * k + 1) * times_ns.len() / (2 * count)], &mut seen);
        seen
    };
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::Vector2;

    #[test]
    fn a_ball_counts_as_its_colours_marker_where_both_are_alone() {
        let ball = |camera, color| TrackedDetection {
            t_ns: 7,
            camera,
            track_id: 0,
            color,
            pixel: Vector2::new(color as f64, 2.0),
            covariance_px2: mavsight_geometry::Matrix2::identity(),
            diameter_px: 5.0,
            is_static: false,
            is_preferred: true,
        };
        // Colour 1 has two markers; camera 0 sees two balls of colour 0, camera 1 one.
        let seen = [ball(0, 0), ball(0, 0), ball(0, 1), ball(0, 2), ball(1, 0), ball(1, 1)];
        let got: Vec<_> =
            lone(7, &seen, &[0, 1, 1, 2]).iter().map(|o| (o.t_ns, o.camera, o.marker)).collect();
        assert_eq!(got, [(7, 0, 3), (7, 1, 0)]);
    }
}
