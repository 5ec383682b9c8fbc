//! Motion from its table, and whichever of poses and motion a table holds.

use super::columns::{self, Instant, Series};
use super::read::{isometry, read_poses, read_summary};
use crate::SessionError;
use crate::table::Table;
use mavsight_geometry::Vector3;
use mavsight_pipeline::usual_interval_ns;
use mavsight_pose::{
    Doubts, Motion, MotionCovariance, MotionSample, PoseError, PoseSample, covariance_from_std,
};
use nalgebra::SMatrix;
use std::path::Path;

/// What a table of a flight holds.
#[derive(Debug, Clone, PartialEq)]
pub enum FlightTable {
    /// Poses, to be smoothed.
    Poses(Vec<PoseSample>),
    /// Motion with its rates and accelerations, to be taken as it is.
    Motion(Motion),
}

impl FlightTable {
    /// The table in parts of one duration, in the order of time; parts without a row are left out.
    #[must_use]
    pub fn parts(&self, count: usize) -> Vec<Self> {
        let times_ns: Vec<i64> = match self {
            Self::Poses(poses) => poses.iter().map(|p| p.t_ns).collect(),
            Self::Motion(motion) => motion.samples.iter().map(|s| s.t_ns).collect(),
        };
        let Some((begin_ns, end_ns)) = times_ns.first().copied().zip(times_ns.last().copied()) else {
            return Vec::new();
        };
        let edge_ns = |part: usize| {
            begin_ns + ((i128::from(end_ns) - i128::from(begin_ns)) * part as i128 / count as i128) as i64
        };
        let parts = (0..count).map(|part| {
            let until_ns = if part + 1 == count { i64::MAX } else { edge_ns(part + 1) };
            let own = edge_ns(part)..until_ns;
            match self {
                Self::Poses(poses) => {
                    Self::Poses(poses.iter().filter(|p| own.contains(&p.t_ns)).cloned().collect())
                }
                Self::Motion(motion) => Self::Motion(Motion {
                    samples: motion.samples.iter().filter(|s| own.contains(&s.t_ns)).cloned().collect(),
                    unknown_ns: motion.unknown_ns.iter().copied().filter(|t_ns| own.contains(t_ns)).collect(),
                    doubts: motion.doubts.clone(),
                    ..*motion
                }),
            }
        });
        parts.filter(|part| !part.is_empty()).collect()
    }

    fn is_empty(&self) -> bool {
        match self {
            Self::Poses(poses) => poses.is_empty(),
            Self::Motion(motion) => motion.samples.is_empty(),
        }
    }
}

/// Reads a table as motion where it has every column of `motion.csv` except the `_std` ones, else as poses.
/// Rows of poses that are missing altogether, where times are more than one and a half usual intervals apart,
/// become rows that were not measured, as long as they are fewer than those that there are.
///
/// # Errors
/// Those of [`read_motion`] and [`read_poses`].
pub fn read_flight_table(path: &Path, marker_names: &[String]) -> Result<FlightTable, SessionError> {
    let table = Table::read(path, "flight")?;
    let moved = columns::RATES.iter().all(|q| table.column(&columns::value(*q)).is_ok());
    Ok(if moved {
        FlightTable::Motion(read_motion(path)?)
    } else {
        FlightTable::Poses(with_missing_rows(read_poses(path, marker_names)?))
    })
}

fn with_missing_rows(poses: Vec<PoseSample>) -> Vec<PoseSample> {
    let Some(usual_ns) = usual_interval_ns(poses.iter().map(|p| p.t_ns)) else {
        return poses;
    };
    let count = poses.len() as i64;
    let mut out: Vec<PoseSample> = Vec::with_capacity(poses.len());
    for pose in poses {
        if let Some(before_ns) = out.last().map(|p| p.t_ns) {
            let gap_ns = pose.t_ns - before_ns;
            let missing = (gap_ns as f64 / usual_ns as f64).round() as i64 - 1;
            // Where more would be missing than there is, the clock has jumped.
            let missing = if missing < count { missing.max(0) } else { 0 };
            out.extend((1..=missing).map(|k| PoseSample {
                t_ns: before_ns + (gap_ns as i128 * k as i128 / (missing + 1) as i128) as i64,
                estimate: Err(PoseError::MissingRow),
            }));
        }
        out.push(pose);
    }
    out
}

/// Reads `motion.csv` and, from the `summary.json` in its folder, the bandwidth of the smoother. The
/// covariance has only its diagonal (and the turn's block); without `_std` columns it is zero, which leaves
/// estimators to find the size of the errors. Without a summary the motion is taken to have passed nothing
/// but its own sampling: half its rate is the bandwidth. A row with its time alone was not measured and is
/// left out.
///
/// # Errors
/// Names the file, row and column, or the key of the summary; times must increase.
pub fn read_motion(path: &Path) -> Result<Motion, SessionError> {
    let table = Table::read(path, "motion: `track` writes it")?;
    let series = Series::of(&table, columns::motion())?;
    let (mut samples, mut unknown_ns) = (Vec::new(), Vec::new());
    let noise_columns: Vec<usize> =
        columns::noise().filter_map(|q| table.column(&columns::std(q)).ok()).collect();
    for instant in series.rows(&table)? {
        let Some(values) = instant.values else {
            unknown_ns.push(instant.t_ns);
            continue;
        };
        let stds = series.stds(instant.row, 0.0, |_| true)?;
        let mut sample = motion_sample(instant.t_ns, &values, &stds);
        let own = noise(&instant, &sample.covariance, &noise_columns)?;
        sample.covariance = sample.covariance.with_noise(own);
        samples.push(sample);
    }
    let [translation_bandwidth_hz, rotation_bandwidth_hz, sample_interval_s] = smoother(path, &samples)?;
    let doubts = Doubts::default();
    Ok(Motion {
        samples,
        unknown_ns,
        doubts,
        translation_bandwidth_hz,
        rotation_bandwidth_hz,
        sample_interval_s,
    })
}

/// Variances of velocity and rates as the whole flight has them, where a row has their standard deviations; else its own.
fn noise(
    instant: &Instant<'_, 18>,
    covariance: &MotionCovariance,
    columns: &[usize],
) -> Result<[f32; 6], SessionError> {
    let mut variances = std::array::from_fn(|k| covariance.noise_variance(k) as f32);
    if let Ok(columns) = <[usize; 6]>::try_from(columns) {
        for (variance, column) in variances.iter_mut().zip(columns) {
            *variance = instant.row.number_if_any(column)?.map_or(*variance, |std| (std * std) as f32);
        }
    }
    Ok(variances)
}

/// Bandwidths in Hz and intervals in seconds that a recording may have: a microsecond to eleven days, and back.
const FIGURES: std::ops::Range<f64> = 1e-6..1e6;

/// Bandwidths of translation and rotation and the sampling interval: from the summary, or as times show.
fn smoother(path: &Path, samples: &[MotionSample]) -> Result<[f64; 3], SessionError> {
    let summary_path = path.with_file_name(super::names::SUMMARY);
    if !summary_path.is_file() {
        let interval_ns = usual_interval_ns(samples.iter().map(|s| s.t_ns));
        let interval_s = crate::s_from_ns(interval_ns.ok_or_else(|| SessionError::no_rows(path))?);
        return Ok([0.5 / interval_s, 0.5 / interval_s, interval_s]);
    }
    let summary = read_summary(&summary_path)?;
    let mut figures = [0.0; 3];
    for (figure, key) in
        figures.iter_mut().zip(["translation_bandwidth_hz", "rotation_bandwidth_hz", "sample_interval_s"])
    {
        let value = &summary["smoother"][key];
        *figure = value.as_f64().filter(|figure| FIGURES.contains(figure)).ok_or_else(|| {
            let detail = format!(
                "is {value}, and not {} to {}: make motion.csv and summary.json again, or remove the latter",
                FIGURES.start, FIGURES.end
            );
            SessionError::value(&summary_path, format!("smoother.{key}"), detail)
        })?;
    }
    Ok(figures)
}

fn motion_sample(t_ns: i64, value: &[f64; 18], std: &[f64; 18]) -> MotionSample {
    let three = |from: usize| Vector3::new(value[from], value[from + 1], value[from + 2]);
    let pose = [value[0], value[1], value[2], value[3], value[4], value[5]];
    let pose_std = [std[0], std[1], std[2], std[3], std[4], std[5]];
    let mut all = SMatrix::<f64, 18, 18>::from_diagonal(&std.map(|s| s * s).into());
    all.fixed_view_mut::<6, 6>(0, 0).copy_from(&covariance_from_std(&isometry(&pose), &pose_std));
    MotionSample {
        t_ns,
        world_from_body: isometry(&pose),
        velocity_in_body_m_s: three(6),
        rates_rad_s: three(9),
        specific_force_m_s2: three(12),
        angular_acceleration_rad_s2: three(15),
        covariance: MotionCovariance::of(&all),
    }
}
