//! Which poses the smoother believes.

use crate::estimate::chi_square_beyond;
use crate::smoother::hidden::LONGER;
use crate::smoother::noise::{Likely, likely};
use crate::smoother::passes::{Checked, Flown, each_smoothed};
use crate::smoother::rates::Rates;
use crate::smoother::smooth::known_parts;
use crate::smoother::state::Joint;
use crate::statistics::median;
use crate::{Doubts, PoseError, PoseSample};
use std::borrow::Cow;

/// Share of the flights without fault in which a pose is left out, and of those in which a gap is severed.
const FALSE_ALARM: f64 = 0.001;
/// Rounds of rejection. Wrong poses of one place are left out one after the other, those of different places
/// together.
const MOST_ROUNDS: usize = 12;
/// Coordinates of a pose.
const POSE: usize = 6;
/// Poses behind a gap from which a place, its rate and the rate of that follow.
const BEHIND: usize = 3;

/// Poses without those that disagree with the others.
pub(crate) struct Believed<'a> {
    pub(crate) poses: Cow<'a, [PoseSample]>,
    /// Indices of poses at which the motion begins anew.
    pub(crate) anew: Vec<usize>,
    pub(crate) found: Likely<'a>,
    pub(crate) doubts: Doubts,
}

/// Leaves out poses that disagree with all others, and severs the motion at gaps behind which the poses
/// contradict it.
///
/// The difference between a pose and what all others say of it (deletion residual; de Jong & Penzer 1998) is
/// tested at a level of 0.1 % for the whole flight (Bonferroni). Of neighbours that fail, the worst is left
/// out, since a wrong pose makes its neighbours disagree too; then the noise is estimated anew without it, and
/// so on. Those that agree with what remains in the end are taken in again (Rousseeuw & Leroy 1987, section
/// 6.6, on masking and swamping). Behind a gap the innovations of three poses, which
/// hold place, rate and acceleration, are tested together (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2):
/// if they fail, the motion begins anew there.
pub(crate) fn believed<'a>(
    poses: &'a [PoseSample],
    rates: Option<&'a Rates>,
) -> Result<Believed<'a>, PoseError> {
    let mut kept = Cow::Borrowed(poses);
    let (mut anew, mut left_out) = (Vec::new(), Vec::new());
    let likely = |poses: &[PoseSample], anew: &[usize]| likely(poses, anew).map(|l| l.with_rates(rates));
    let mut found: Likely<'_> = likely(poses, &anew)?;
    for _ in 0..MOST_ROUNDS {
        let Some(wrong) = Wrong::of(poses, &kept, &anew, &found) else { break };
        match wrong {
            Wrong::Gaps(behind) => anew.extend(behind),
            Wrong::Poses(alone) => {
                for k in &alone {
                    kept.to_mut()[*k].estimate = Err(PoseError::NotMeasured);
                }
                left_out.extend(alone);
            }
        }
        match likely(&kept, &anew) {
            Ok(again) => found = again,
            Err(_) => break,
        }
    }
    let again = agreeing(poses, &kept, &left_out, &anew, &found);
    if !again.is_empty() {
        left_out.retain(|k| !again.contains(k));
        again.iter().for_each(|k| kept.to_mut()[*k].estimate = poses[*k].estimate.clone());
        found = likely(&kept, &anew)?;
    }
    left_out.sort_unstable();
    anew.sort_unstable();
    let before = |k: usize| kept[..k].iter().rev().find(|p| p.estimate.is_ok()).map(|p| p.t_ns);
    let begun = anew.iter().filter(|k| kept[**k].estimate.is_ok());
    let severed_ns = begun.filter_map(|k| Some((before(*k)?, kept[*k].t_ns))).collect();
    let left_out_ns = left_out.iter().map(|k| poses[*k].t_ns).collect();
    Ok(Believed { poses: kept, anew, found, doubts: Doubts { left_out_ns, severed_ns, ..Doubts::default() } })
}

enum Wrong {
    /// Indices of the first poses behind gaps that the motion does not cross.
    Gaps(Vec<usize>),
    /// Indices of poses to leave out.
    Poses(Vec<usize>),
}

impl Wrong {
    /// What of the poses kept disagrees. Gaps of the film come first, since behind a motion that was never seen
    /// right poses seem wrong; those that poses left out have torn come last, when the others are sound.
    fn of(all: &[PoseSample], kept: &[PoseSample], anew: &[usize], found: &Likely<'_>) -> Option<Self> {
        let parts = checked_parts(kept, anew, found);
        let count = parts.iter().map(Vec::len).sum::<usize>().max(1);
        let steps_s = parts.iter().flat_map(|part| part.windows(2)).map(|w| step_s(kept, w)).collect();
        let long_s = median(steps_s).map_or(f64::INFINITY, |usual_s| LONGER * usual_s);
        let behind_gaps = || {
            let groups = parts.iter().flat_map(|part| part.windows(1 + BEHIND));
            groups.filter(|w| step_s(kept, &w[..2]) > long_s)
        };
        let gate = chi_square_beyond(POSE * BEHIND, FALSE_ALARM / behind_gaps().count().max(1) as f64);
        let sum = |w: &[(usize, Checked)]| w[1..].iter().map(|c| c.1.innovation).sum::<f64>();
        let severed: Vec<_> = behind_gaps().filter(|w| sum(w) > gate).collect();
        let is_of_film =
            |w: &&[(usize, Checked)]| all[w[0].0 + 1..w[1].0].iter().all(|p| p.estimate.is_err());
        let of_film: Vec<usize> = severed.iter().copied().filter(is_of_film).map(|w| w[1].0).collect();
        if !of_film.is_empty() {
            return Some(Self::Gaps(of_film));
        }
        let gate = chi_square_beyond(POSE, FALSE_ALARM / count as f64);
        let fails = |c: &(usize, Checked)| c.1.disagreement > gate;
        let runs = parts.iter().flat_map(|part| part.chunk_by(|a, b| fails(a) == fails(b)));
        let worst = |run: &[(usize, Checked)]| {
            run.iter().max_by(|a, b| a.1.disagreement.total_cmp(&b.1.disagreement)).map(|c| c.0)
        };
        let alone: Vec<usize> = runs.filter(|run| fails(&run[0])).filter_map(worst).collect();
        if !alone.is_empty() {
            return Some(Self::Poses(alone));
        }
        let torn: Vec<usize> = severed.iter().map(|w| w[1].0).collect();
        (!torn.is_empty()).then_some(Self::Gaps(torn))
    }
}

/// Those of the poses left out that agree with all that remain.
fn agreeing(
    poses: &[PoseSample],
    kept: &[PoseSample],
    left_out: &[usize],
    anew: &[usize],
    found: &Likely<'_>,
) -> Vec<usize> {
    let mut out = Vec::new();
    if left_out.is_empty() {
        return out;
    }
    let gate = chi_square_beyond(POSE, FALSE_ALARM / poses.len() as f64);
    for part in known_parts(kept, anew, found) {
        let first = part.start;
        each_smoothed(
            &Flown::without_effects(&kept[part], first, found.rates),
            &found.noise,
            |k, state, _| {
                let seen = left_out
                    .contains(&(first + k))
                    .then(|| poses[first + k].estimate.as_ref().ok())
                    .flatten();
                let square = seen.and_then(|seen| state.disagreement(seen, &found.noise));
                out.extend(square.filter(|square| *square <= gate).map(|_| first + k));
                Some(())
            },
        );
    }
    out
}

fn step_s(poses: &[PoseSample], pair: &[(usize, Checked)]) -> f64 {
    (poses[pair[1].0].t_ns - poses[pair[0].0].t_ns) as f64 * 1e-9
}

/// How the poses of each part agree, by their indices; a part in which the arithmetic fails has none.
fn checked_parts(poses: &[PoseSample], anew: &[usize], found: &Likely<'_>) -> Vec<Vec<(usize, Checked)>> {
    let parts = known_parts(poses, anew, found);
    let checked = parts.into_iter().map(|part| {
        let first = part.start;
        let flown = Flown::without_effects(&poses[part], first, found.rates);
        let mut out = Vec::new();
        let visit = |k: usize, _: Joint, checked: Option<Checked>| {
            out.extend(checked.map(|c| (first + k, c)));
            Some(())
        };
        each_smoothed(&flown, &found.noise, visit)?;
        out.reverse();
        Some(out)
    });
    checked.flatten().collect()
}

#[cfg(test)]
mod tests;
