//! Markers in space over time: what motion-capture systems export, and the poses of a rigid body that they
//! make.

use super::Noted;
use super::poses::TimedPose;
use crate::SessionError;
use crate::decimal::decimal_from_ns;
use crate::table::{Table, write_csv};
use mavsight_geometry::{GeometryError, Vector3, rigid_fit};
use mavsight_pipeline::usual_interval_ns;
use std::path::Path;

/// Columns of the table: one row for each marker and instant, coordinates empty where it was not seen.
const COLUMNS: [&str; 5] = ["t_s", "marker", "x_m", "y_m", "z_m"];

/// A stamp may be this part of an interval off an even clock: jitter, far below the half of a neighbour.
const JITTER: f64 = 0.1;

/// Markers in space.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MarkerPaths {
    /// Names.
    pub names: Vec<String>,
    /// Increasing.
    pub t_ns: Vec<i64>,
    /// For each instant where each marker was, world axes; none where it was not seen.
    pub points_m: Vec<Vec<Option<Vector3<f64>>>>,
}

/// Reads `t_s,marker,x_m,y_m,z_m`.
///
/// # Errors
/// Names the file, row and column; times must not decrease, a marker be there once an instant.
pub fn read_table(path: &Path) -> Result<MarkerPaths, SessionError> {
    let table = Table::read(path, "marker positions")?;
    let [t, marker, x, y, z] = table.columns(COLUMNS)?;
    let names = table.distinct(marker).into_iter().filter(|name| !name.is_empty()).collect();
    let mut paths = MarkerPaths { names, ..MarkerPaths::default() };
    for row in table.rows()? {
        let t_ns = row.time_ns(t)?;
        if paths.t_ns.last().is_some_and(|last| *last > t_ns) {
            return Err(row.refuse(t, "the time comes before that of the row before: sort the rows"));
        }
        if paths.t_ns.last() != Some(&t_ns) {
            paths.t_ns.push(t_ns);
            paths.points_m.push(vec![None; paths.names.len()]);
        }
        let Some(index) = paths.names.iter().position(|n| n == row.text(marker)) else { continue };
        if [x, y, z].iter().all(|c| row.text(*c).is_empty()) {
            continue;
        }
        let point = Vector3::from(row.numbers([x, y, z])?);
        if let Some(places) = paths.points_m.last_mut()
            && places[index].replace(point).is_some()
        {
            let detail = format!("{} is there twice at this time: keep one", row.text(marker));
            return Err(row.refuse(marker, detail));
        }
    }
    Ok(paths)
}

/// Writes `t_s,marker,x_m,y_m,z_m`.
///
/// # Errors
/// What the file system refuses.
pub fn write_table(path: &Path, paths: &MarkerPaths) -> Result<(), SessionError> {
    let of_instant = |(t_ns, places): (&i64, &Vec<Option<Vector3<f64>>>)| -> Vec<_> {
        let time = decimal_from_ns(*t_ns);
        let cells = |place: &Option<Vector3<f64>>| place.map_or([None; 3], |p| [p.x, p.y, p.z].map(Some));
        paths.names.iter().zip(places).map(|(name, place)| (time.clone(), name, cells(place))).collect()
    };
    write_csv(path, COLUMNS, paths.t_ns.iter().zip(&paths.points_m).flat_map(of_instant))
}

/// Poses of a rigid body from at least three of its markers an instant, by least squares (Kabsch 1976); an
/// instant with fewer was not measured.
///
/// Labels are matched to names without their subject (`Lama:red`) and without regard to case.
///
/// # Errors
/// Fewer than three labels that are markers of the body; no instant with three.
pub fn poses_of_body(
    path: &Path,
    paths: &MarkerPaths,
    body: &[(String, Vector3<f64>)],
) -> Result<Noted<Vec<TimedPose>>, SessionError> {
    let bare = |label: &str| label.rsplit(':').next().unwrap_or(label).trim().to_lowercase();
    let column = |name: &str| paths.names.iter().position(|label| bare(label) == name.trim().to_lowercase());
    let found: Vec<(usize, Vector3<f64>)> =
        body.iter().filter_map(|(name, p)| Some((column(name)?, *p))).collect();
    let wrong = |detail: String| SessionError::value(path, "markers", detail);
    if found.len() < 3 {
        let names: Vec<&str> = body.iter().map(|(n, _)| n.as_str()).collect();
        return Err(wrong(format!(
            "{} of the labels {} are markers of the vehicle ({}), and a pose needs three: rename either",
            found.len(),
            paths.names.join(", "),
            names.join(", ")
        )));
    }
    let (mut sum_m2, mut count, mut worst) = (0.0, 0usize, None);
    let mut poses = Vec::with_capacity(paths.t_ns.len());
    for (t_ns, places) in paths.t_ns.iter().zip(&paths.points_m) {
        let seen = || found.iter().filter_map(|(c, p)| Some((*p, places.get(*c).copied().flatten()?)));
        let fit = rigid_fit(seen());
        match &fit {
            Ok(fit) => {
                let square_m2 = |(p, at): (Vector3<f64>, Vector3<f64>)| {
                    (fit.rotation * p + fit.translation.vector - at).norm_squared()
                };
                sum_m2 += seen().map(square_m2).sum::<f64>();
                count += seen().count();
            }
            Err(GeometryError::TooFewMarkers { .. }) => {}
            Err(error) => worst = Some(error.to_string()),
        }
        poses.push(TimedPose { t_ns: *t_ns, world_from_body: fit.ok() });
    }
    let measured = poses.iter().filter(|p| p.world_from_body.is_some()).count();
    if measured == 0 {
        let why = worst.unwrap_or_else(|| "none has three markers".into());
        return Err(wrong(format!("no instant of {} gives a pose: {why}", poses.len())));
    }
    let mut notes = vec![format!(
        "{measured} of {} instants give a pose from {} markers; they are {:.3} mm (RMS) off the vehicle's shape",
        poses.len(),
        found.len(),
        1e3 * (sum_m2 / count.max(1) as f64).sqrt()
    )];
    notes.extend(worst.map(|e| format!("some instants were left out: {e}")));
    Ok(Noted { value: poses, notes })
}

/// Where the markers of a body are along its poses.
pub fn paths_of_body(poses: &[TimedPose], body: &[(String, Vector3<f64>)]) -> MarkerPaths {
    let place = |p: &TimedPose| {
        let world = |m: &Vector3<f64>| p.world_from_body.map(|w| w.rotation * m + w.translation.vector);
        body.iter().map(|(_, m)| world(m)).collect()
    };
    MarkerPaths {
        names: body.iter().map(|(n, _)| n.clone()).collect(),
        t_ns: poses.iter().map(|p| p.t_ns).collect(),
        points_m: poses.iter().map(place).collect(),
    }
}

pub(super) struct Even {
    pub(super) rate_hz: f64,
    /// For each tick from the first instant on, the index of the instant there.
    pub(super) ticks: Vec<Option<usize>>,
}

/// The even clock that the times lie on, with gaps where instants are missing.
pub(super) fn even_clock(path: &Path, t_ns: &[i64]) -> Result<Even, SessionError> {
    let wrong = |detail: String| SessionError::value(path, "times", detail);
    let Some(usual_ns) = usual_interval_ns(t_ns.iter().copied()).filter(|i| *i > 0) else {
        return Err(wrong("at least two instants are needed for a rate".into()));
    };
    // Ticks are counted from instant to instant, so that a rounded rate does not drift.
    let mut at = vec![0usize];
    for w in t_ns.windows(2) {
        let steps = ((w[1] - w[0]) as f64 / usual_ns as f64).round().max(1.0) as usize;
        at.push(at[at.len() - 1] + steps);
    }
    let last = at[at.len() - 1];
    let span_ns = (t_ns[t_ns.len() - 1] - t_ns[0]) as f64;
    let interval_ns = span_ns / last as f64;
    for (k, (t, tick)) in t_ns.iter().zip(&at).enumerate() {
        let off_ns = (*t - t_ns[0]) as f64 - *tick as f64 * interval_ns;
        if off_ns.abs() > JITTER * interval_ns {
            return Err(wrong(format!(
                "instant {} at {} s is {:.3} ms off an even clock of {:.3} Hz, and the format has a rate alone: write \
                 TRC, TUM or a table, which keep each time",
                k + 1,
                decimal_from_ns(*t),
                off_ns * 1e-6,
                1e9 / interval_ns
            )));
        }
    }
    if last > 20 * t_ns.len() + 1000 {
        return Err(wrong(format!(
            "{last} ticks for {} instants: the clock has jumped; split the table there",
            t_ns.len()
        )));
    }
    let mut ticks = vec![None; last + 1];
    at.iter().enumerate().for_each(|(k, tick)| ticks[*tick] = Some(k));
    Ok(Even { rate_hz: 1e9 / interval_ns, ticks })
}
