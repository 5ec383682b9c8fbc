//! TRC (track row column) of Motion Analysis and OpenSim: markers in space, tabs between, a time in each row.

use super::marker_paths::MarkerPaths;
use super::text::{Line, Text};
use crate::decimal::{decimal_from_ns, ns_from_decimal};
use crate::{SessionError, write_whole};
use mavsight_geometry::Vector3;
use std::path::Path;

/// Reads marker paths; empty cells and NaN were not seen. Lengths are mm, cm or m by the header's `Units`.
///
/// # Errors
/// Names the line and column: a header that is none, unknown units, counts that do not agree, times that do
/// not increase.
pub fn read(path: &Path) -> Result<MarkerPaths, SessionError> {
    let text = Text::read(path, "TRC marker paths")?;
    let lines: Vec<Line> = text.filled().collect();
    let [first, keys, values, labels, _, rows @ ..] = lines.as_slice() else {
        return Err(text.refuse_end("five lines of header are wanted: the file breaks off"));
    };
    if !first.text.trim_start().starts_with("PathFileType") {
        return Err(first.refuse("a TRC file begins with PathFileType: correct the path or --from"));
    }
    let (keys, at) = (keys.cells('\t'), values.cells('\t'));
    let entry = |key: &str| keys.iter().position(|k| *k == key).and_then(|k| at.get(k)).copied();
    let unit = entry("Units").unwrap_or("");
    let scale =
        scale_of(unit).ok_or_else(|| values.refuse(format!("Units is {unit:?}: mm, cm or m is wanted")))?;
    let names: Vec<String> =
        labels.cells('\t').iter().skip(2).filter(|n| !n.is_empty()).map(|n| (*n).to_owned()).collect();
    let is_announced = |key: &str, count: usize| {
        let text = entry(key).unwrap_or("missing");
        if text.parse() == Ok(count) { Ok(()) } else { Err(format!("where {key} is {text}")) }
    };
    is_announced("NumMarkers", names.len())
        .map_err(|wrong| labels.refuse(format!("{} labels {wrong}", names.len())))?;
    let mut paths = MarkerPaths { names, ..MarkerPaths::default() };
    for line in rows {
        row(line, scale, &mut paths)?;
    }
    let frames = paths.t_ns.len();
    is_announced("NumFrames", frames)
        .map_err(|wrong| text.refuse_end(format!("{frames} frames {wrong}: the file breaks off")))?;
    Ok(paths)
}

fn row(line: &Line, scale: f64, paths: &mut MarkerPaths) -> Result<(), SessionError> {
    let cells = line.cells('\t');
    let width = 2 + 3 * paths.names.len();
    if cells.len() < 2 || cells.iter().skip(width).any(|c| !c.is_empty()) {
        let detail = format!("{} cells where {width} are wanted, with tabs between", cells.len());
        return Err(line.refuse(detail));
    }
    let wrong = || line.refuse(format!("column 2: {:?} is no time in seconds", cells[1]));
    let t_ns = ns_from_decimal(cells[1]).ok_or_else(wrong)?;
    if paths.t_ns.last().is_some_and(|before| *before >= t_ns) {
        return Err(line.refuse("the time does not come after that of the line before: sort the lines"));
    }
    let place = |k: usize| -> Result<Option<Vector3<f64>>, SessionError> {
        let mut p = [None; 3];
        for (axis, value) in p.iter_mut().enumerate() {
            let column = 2 + 3 * k + axis;
            *value = line.number_if_any(column, cells.get(column).copied().unwrap_or(""))?;
        }
        match p {
            [Some(x), Some(y), Some(z)] => Ok(Some(Vector3::new(x, y, z) * scale)),
            [None, None, None] => Ok(None),
            _ => {
                let (from, to) = (3 + 3 * k, 5 + 3 * k);
                let detail = "some coordinates of a marker are missing, others not";
                Err(line.refuse(format!("columns {from} to {to}: {detail}")))
            }
        }
    };
    let places = (0..paths.names.len()).map(place).collect::<Result<Vec<_>, _>>()?;
    paths.t_ns.push(t_ns);
    paths.points_m.push(places);
    Ok(())
}

/// Metres a unit.
pub(super) fn scale_of(unit: &str) -> Option<f64> {
    match unit.trim().to_lowercase().as_str() {
        "mm" => Some(1e-3),
        "cm" => Some(1e-2),
        "m" => Some(1.0),
        _ => None,
    }
}

/// Writes marker paths in millimetres with six decimals; the rate in the header is the mean.
///
/// # Errors
/// Names that hold tabs; what the file system refuses.
pub fn write(path: &Path, paths: &MarkerPaths) -> Result<(), SessionError> {
    if let Some(name) = paths.names.iter().find(|n| n.is_empty() || n.contains(['\t', '\n'])) {
        let detail = format!("{name:?} is empty or holds a tab or a line's end: rename it");
        return Err(SessionError::value(path, "marker", detail));
    }
    let (n, frames) = (paths.names.len(), paths.t_ns.len());
    let span_s = match (paths.t_ns.first(), paths.t_ns.last()) {
        (Some(a), Some(b)) => crate::s_from_ns(b - a),
        _ => 0.0,
    };
    let rate_hz = if span_s > 0.0 { (frames - 1) as f64 / span_s } else { 1.0 };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{name}\n");
    text += "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n";
    text += &format!("{rate_hz:.6}\t{rate_hz:.6}\t{frames}\t{n}\tmm\t{rate_hz:.6}\t1\t{frames}\n");
    text += &format!("Frame#\tTime\t{}\n", paths.names.join("\t\t\t"));
    let axes: Vec<String> = (1..=n).map(|k| format!("X{k}\tY{k}\tZ{k}")).collect();
    text += &format!("\t\t{}\n\n", axes.join("\t"));
    for (k, (t_ns, places)) in paths.t_ns.iter().zip(&paths.points_m).enumerate() {
        text += &format!("{}\t{}", k + 1, decimal_from_ns(*t_ns));
        for place in places {
            text += &match place {
                Some(p) => format!("\t{:.6}\t{:.6}\t{:.6}", p.x * 1e3, p.y * 1e3, p.z * 1e3),
                None => "\t\t\t".to_owned(),
            };
        }
        text.push('\n');
    }
    write_whole(path, text.as_bytes())
}
