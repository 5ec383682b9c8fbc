//! Results into their files.

use super::{MarkerAsBuilt, RESULTS_SCHEMA, RunResults, columns, names, rig_file};
use crate::files::{PartFile, json_text};
use crate::table::csv_lines;
use crate::{SessionError, make_folder, s_from_ns};
use mavsight_geometry::{EulerAngles, Isometry3};
use mavsight_identify::{CoefficientTable, Pooled, PooledParameter};
use mavsight_inertial::LogAlignment;
use mavsight_pose::{MarkerObservation, Motion, MotionSample, Observations, euler_std};
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

/// Writes what a run found into a folder, which is made where it is missing.
///
/// Every file is written whole next to its place before the first is renamed into it, `summary.json` last;
/// when one cannot be written, those of this call are taken away again. Tables go to the disk row by row.
///
/// # Errors
/// A folder that is a file, or what the file system refuses.
pub fn write_results(folder: &Path, results: &RunResults) -> Result<(), SessionError> {
    make_folder(folder)?;
    let parts = parts(results, folder)?;
    let names: Vec<&str> = parts.iter().map(|(name, _)| *name).collect();
    for (k, (_, part)) in parts.into_iter().enumerate() {
        if let Err(error) = part.keep() {
            for written in &names[..k] {
                // The first failure is what the user must know.
                drop(std::fs::remove_file(folder.join(written)));
            }
            return Err(error);
        }
    }
    Ok(())
}

/// Writes `markers.csv` alone.
///
/// # Errors
/// What the file system refuses.
pub fn write_markers(path: &Path, results: &RunResults) -> Result<(), SessionError> {
    PartFile::write(path, |out| markers(results.markers.iter().cloned(), results, out))?.keep()
}

/// Writes `pooled.csv`: parameters over several flights, into a folder that is made where it is missing.
///
/// # Errors
/// A folder that is a file, or what the file system refuses.
pub fn write_pooled(folder: &Path, parameters: &[PooledParameter]) -> Result<(), SessionError> {
    make_folder(folder)?;
    PartFile::write(&folder.join(names::POOLED), |out| pooled(parameters, out))?.keep()
}

fn pooled(parameters: &[PooledParameter], out: &mut dyn Write) -> io::Result<()> {
    let mut lines = csv_lines(out, columns::POOLED)?;
    for p in parameters {
        let Pooled { mean, std, ci_low, ci_high, between_std, heterogeneity } = p.pooled;
        let names = split_names(&p.estimator, &p.name).map(str::to_owned);
        let count = p.flights.len().to_string();
        let figures =
            [mean, std, ci_low, ci_high, between_std, heterogeneity.chi_square, heterogeneity.p_value]
                .map(number);
        lines.write_record(names.into_iter().chain([count]).chain(figures))?;
    }
    lines.flush()
}

/// A file that is written and waits next to its place until [`write_results`] puts it there; it is taken away
/// where that never comes.
#[derive(Debug, Clone)]
pub struct EarlyFile(Arc<PartFile>);

/// Writes `markers.csv` next to its place in a folder from all that was seen, of which the results keep what
/// `is_needed` says yes to: those of an hour are many, and few are looked at again.
///
/// # Errors
/// What the file system refuses.
pub fn write_markers_early(
    folder: &Path,
    results: &mut RunResults,
    all: &Observations,
    is_needed: impl Fn(&MarkerObservation) -> bool,
) -> Result<(), SessionError> {
    let path = folder.join(names::MARKERS);
    let part = PartFile::write(&path, |out| markers(all.iter(), results, out))?;
    results.markers_file = Some(EarlyFile(Arc::new(part)));
    results.markers = all.iter().filter(is_needed).collect();
    Ok(())
}

/// What a table writes.
type Content<'a> = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + 'a>;

/// The tables that there are of some results, each with the name of its file.
fn tables(results: &RunResults) -> Vec<(&'static str, Content<'_>)> {
    let mut tables: Vec<(&'static str, Content<'_>)> = Vec::new();
    if !results.poses.is_empty() || !results.markers.is_empty() {
        tables.push((names::MARKERS, Box::new(|out| markers(results.markers.iter().cloned(), results, out))));
        tables.push((names::POSE, Box::new(|out| poses(results, out))));
    }
    if !results.body.is_empty() {
        tables.push((names::BODY, Box::new(|out| body(&results.body, out))));
    }
    if let Some(motion) = &results.motion {
        tables.push((names::MOTION, Box::new(|out| motion_table(motion, results.log.as_ref(), out))));
    }
    if let Some(table) = &results.coefficients {
        tables.push((names::COEFFICIENTS, Box::new(|out| coefficients(table, out))));
    }
    if results.identification.is_some() || results.output_error.named().next().is_some() {
        tables.push((names::PARAMETERS, Box::new(|out| parameters(results, out))));
    }
    tables
}

/// The text of each table that [`write_results`] would write, with the name of its file; of a long flight `markers.csv` has
/// what the results keep.
///
/// # Errors
/// None but for a table that is no text.
pub fn result_tables(results: &RunResults) -> Result<Vec<(&'static str, String)>, SessionError> {
    let text = |(name, content): (&'static str, Content<'_>)| {
        let mut bytes = Vec::new();
        let refused = |e| SessionError::io(Path::new(name), "write it", e);
        content(&mut bytes).map_err(refused)?;
        String::from_utf8(bytes).map(|text| (name, text)).map_err(|e| refused(io::Error::other(e)))
    };
    tables(results).into_iter().map(text).collect()
}

fn parts(results: &RunResults, folder: &Path) -> Result<Vec<(&'static str, Arc<PartFile>)>, SessionError> {
    let mut parts: Vec<(&'static str, Arc<PartFile>)> = Vec::new();
    if let Some(EarlyFile(early)) = &results.markers_file {
        parts.push((names::MARKERS, early.clone()));
    }
    let mut part = |name: &'static str, content: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
        PartFile::write(&folder.join(name), content).map(|file| parts.push((name, Arc::new(file))))
    };
    if let Some(rig) = &results.rig {
        let text = rig_file::text(rig, &folder.join(names::RIG))?;
        part(names::RIG, &|out| out.write_all(text.as_bytes()))?;
    }
    for (name, content) in tables(results) {
        // Those of a long flight wait already.
        if name != names::MARKERS || results.markers_file.is_none() {
            part(name, &content)?;
        }
    }
    if let Some(summary) = summary(results) {
        let text = json_text(&folder.join(names::SUMMARY), &summary)?;
        part(names::SUMMARY, &|out| out.write_all(text.as_bytes()))?;
    }
    Ok(parts)
}

fn time(t_ns: i64) -> String {
    format!("{:.9}", s_from_ns(t_ns))
}

/// The shortest text that reads back as the same number; nothing for what is not one.
fn number(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { String::new() }
}

fn optional(value: Option<f64>) -> String {
    value.map(number).unwrap_or_default()
}

fn name_of(names: &[String], index: usize) -> String {
    names.get(index).cloned().unwrap_or_else(|| index.to_string())
}

fn markers(
    observations: impl Iterator<Item = MarkerObservation>,
    results: &RunResults,
    out: &mut dyn Write,
) -> io::Result<()> {
    let mut lines = csv_lines(out, columns::MARKERS)?;
    for o in observations {
        lines.write_record([
            time(o.t_ns),
            name_of(&results.camera_names, o.camera),
            name_of(&results.marker_names, o.marker),
            number(o.pixel.x),
            number(o.pixel.y),
            number(o.covariance_px2[(0, 0)].sqrt()),
            number(o.covariance_px2[(1, 1)].sqrt()),
        ])?;
    }
    lines.flush()
}

fn body(markers: &[MarkerAsBuilt], out: &mut dyn Write) -> io::Result<()> {
    let mut lines = csv_lines(out, columns::BODY)?;
    for marker in markers {
        let numbers = marker.position_m.iter().chain(&marker.position_std_m).chain([&marker.diameter_m]);
        let cells = std::iter::once(marker.name.clone()).chain(numbers.map(|x| number(*x)));
        lines.write_record(cells.chain([optional(marker.diameter_std_m)]))?;
    }
    lines.flush()
}

fn pose_values(world_from_body: &Isometry3<f64>) -> [f64; 6] {
    let (p, e) = (world_from_body.translation.vector, EulerAngles::from_world_from_body(world_from_body));
    [p.x, p.y, p.z, e.phi_rad, e.theta_rad, e.psi_rad]
}

/// The name of the column of times by the aircraft's log, where that was aligned, and none elsewhere.
fn log_column(log: Option<&LogAlignment>) -> Option<String> {
    log.map(|_| columns::LOG_TIME.to_owned())
}

fn log_time(log: Option<&LogAlignment>, t_ns: i64) -> Option<String> {
    log.map(|log| format!("{:.9}", log.log_s(s_from_ns(t_ns))))
}

fn poses(results: &RunResults, out: &mut dyn Write) -> io::Result<()> {
    let (marker_names, log) = (&results.marker_names, results.log.as_ref());
    let mut header = vec!["t_s".to_owned()];
    header.extend(columns::POSE.map(columns::value));
    header.extend(columns::POSE.map(columns::std));
    header.extend(["markers".to_owned(), "residual_px".to_owned()]);
    header.extend(columns::upper_triangle().map(columns::new_covariance));
    let width = header.len();
    let mut lines = csv_lines(out, header.into_iter().chain(log_column(log)))?;
    for sample in &results.poses {
        let mut cells = vec![time(sample.t_ns)];
        if let Ok(e) = &sample.estimate {
            cells.extend(pose_values(&e.world_from_body).map(number));
            let covariance = e.covariance();
            cells.extend((0..3).map(|i| number(covariance[(i, i)].sqrt())));
            let turn = covariance.fixed_view::<3, 3>(3, 3).into_owned();
            cells.extend(euler_std(&e.world_from_body, &turn).iter().map(|s| number(*s)));
            let used: Vec<String> = e.markers_used.iter().map(|m| name_of(marker_names, m)).collect();
            cells.extend([used.join(" "), e.residual_px.map_or_else(String::new, number)]);
            let own = e.own_covariance();
            cells.extend(columns::upper_triangle().map(|at| number(own[at])));
        }
        cells.resize(width, String::new());
        cells.extend(log_time(log, sample.t_ns));
        lines.write_record(cells)?;
    }
    lines.flush()
}

fn motion_table(motion: &Motion, log: Option<&LogAlignment>, out: &mut dyn Write) -> io::Result<()> {
    let header = columns::motion().flat_map(|q| [columns::value(q), columns::std(q)]);
    let header = header.chain(columns::noise().map(columns::std));
    let header = std::iter::once("t_s".to_owned()).chain(header).chain(log_column(log));
    let mut lines = csv_lines(out, header)?;
    // Instants at which the motion is not known have a row with their time alone, as poses have.
    let unknown = motion.unknown_ns.iter().map(|t_ns| (*t_ns, None));
    let mut rows: Vec<_> = motion.samples.iter().map(|s| (s.t_ns, Some(s))).chain(unknown).collect();
    rows.sort_by_key(|row| row.0);
    for (t_ns, sample) in rows {
        let empty = || vec![String::new(); 2 * columns::motion().count() + columns::noise().count()];
        let cells = sample.map_or_else(empty, motion_cells);
        lines.write_record(std::iter::once(time(t_ns)).chain(cells).chain(log_time(log, t_ns)))?;
    }
    lines.flush()
}

fn motion_cells(sample: &MotionSample) -> Vec<String> {
    let rates = [
        sample.velocity_in_body_m_s,
        sample.rates_rad_s,
        sample.specific_force_m_s2,
        sample.angular_acceleration_rad_s2,
    ];
    let values = pose_values(&sample.world_from_body).into_iter().chain(rates.iter().flatten().copied());
    let mut stds = sample.covariance.variances().map(f64::sqrt);
    let euler = euler_std(&sample.world_from_body, &sample.covariance.quantity(1));
    stds.fixed_rows_mut::<3>(3).copy_from(&euler);
    let noise = (0..6).map(|k| sample.covariance.noise_variance(k).sqrt());
    let cells = values.zip(&stds).flat_map(|(value, std)| [value, *std]);
    cells.chain(noise).map(number).collect()
}

fn coefficients(table: &CoefficientTable, out: &mut dyn Write) -> io::Result<()> {
    let mut header = vec!["t_s".to_owned()];
    for output in &table.outputs {
        header.push(output.name.clone());
        header.extend(output.columns.iter().map(|c| format!("{}:{}", output.name, c.name)));
    }
    let mut lines = csv_lines(out, header)?;
    let cell = |values: &[f64], k: usize| optional(values.get(k).copied());
    for (k, t_s) in table.t_s.iter().enumerate() {
        let mut cells = vec![format!("{t_s:.9}")];
        for output in &table.outputs {
            cells.push(cell(&output.values, k));
            cells.extend(output.columns.iter().map(|c| cell(&c.values, k)));
        }
        lines.write_record(cells)?;
    }
    lines.flush()
}

fn parameters(results: &RunResults, out: &mut dyn Write) -> io::Result<()> {
    let mut lines = csv_lines(out, columns::PARAMETERS)?;
    let mut line = |names: [&str; 3], figures: [Option<f64>; 4], identifiable: bool| {
        let cells = names.map(str::to_owned).into_iter().chain(figures.map(optional));
        lines.write_record(cells.chain([identifiable.to_string()]))
    };
    for fit in results.identification.iter().flat_map(|i| &i.fits) {
        let (estimator, output) = (fit.estimator.name(), fit.output.as_str());
        for p in &fit.parameters {
            line([estimator, output, &p.name], [p.value, p.std, p.ci_low, p.ci_high], p.identifiable)?;
        }
        for c in &fit.combinations {
            line([estimator, output, &c.text], [c.value, c.std, c.ci_low, c.ci_high].map(Some), true)?;
        }
    }
    for (estimator, fit) in results.output_error.named() {
        for p in &fit.parameters {
            line(
                split_names(estimator, &p.name),
                [p.value, p.std, p.ci_low, p.ci_high].map(Some),
                p.identifiable,
            )?;
        }
        for d in &fit.derived {
            line([estimator, "", &d.name], [d.value, d.std, d.ci_low, d.ci_high].map(Some), d.identifiable)?;
        }
        for parameter in &results.output_error.held {
            line(split_names(estimator, parameter), [None; 4], false)?;
        }
    }
    lines.flush()
}

/// Estimator, output and parameter of a label such as `C_X,alpha_u`; times and the lag are of no output.
fn split_names<'a>(estimator: &'a str, label: &'a str) -> [&'a str; 3] {
    let (output, parameter) = label.split_once(',').unwrap_or(("", label));
    [estimator, output, parameter]
}

/// The summary with the schema's version, the session's name, and what the motion table cannot say of itself.
fn summary(results: &RunResults) -> Option<serde_json::Value> {
    let mut object = results.summary.as_object()?.clone();
    object.insert("schema".into(), RESULTS_SCHEMA.into());
    object.insert("session".into(), results.session.clone().into());
    if let Some(motion) = &results.motion {
        object.insert(
            "smoother".into(),
            serde_json::json!({
                "translation_bandwidth_hz": motion.translation_bandwidth_hz,
                "rotation_bandwidth_hz": motion.rotation_bandwidth_hz,
                "sample_interval_s": motion.sample_interval_s,
            }),
        );
    }
    Some(object.into())
}
