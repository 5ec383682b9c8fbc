//! Points that DLTdv and Argus digitised: `*xypts` in the images, `*xyzpts` in space, `*offsets` of the
//! cameras, as CSV or as DLTdv's sparse TSV (title; rows, columns and count; then row, column and value from
//! 1). NaN and, as DLTdv has it, exact zero are missing.

use super::marker_paths::{MarkerPaths, even_clock};
use super::pixels::PixelOrigin;
use super::rigs::names_and_sizes;
use super::text::Text;
use crate::{RunResults, SessionError, read_markers, table::Table, write_whole};
use mavsight_geometry::{ImageSize, Matrix2, Vector2, Vector3};
use mavsight_pose::MarkerObservation;
use std::collections::BTreeMap;
use std::path::Path;

/// What the points' files do not say.
#[derive(Debug, Clone)]
pub struct PointOptions {
    /// Rows a second.
    pub rate_hz: f64,
    /// Where pixels are counted from.
    pub origin: PixelOrigin,
    /// Image size, one for all cameras or one each: needed where v grows up.
    pub sizes: Vec<ImageSize>,
    /// Names of the cameras; `cam1`, ... where empty, but needed for a sparse file.
    pub cameras: Vec<String>,
    /// Names of the points; `pt1`, ... where empty.
    pub points: Vec<String>,
    /// Standard deviation of each coordinate that is read.
    pub std_px: f64,
}

struct Matrix {
    columns: usize,
    header: Option<Vec<String>>,
    rows: Vec<Vec<Option<f64>>>,
}

fn matrix(path: &Path, role: &str) -> Result<Matrix, SessionError> {
    let text = Text::read(path, role)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("tsv")) { sparse(&text) } else { dense(&text) }
}

fn dense(text: &Text) -> Result<Matrix, SessionError> {
    let mut lines = text.filled();
    let Some(head) = lines.next() else {
        return Err(SessionError::EmptyTable { path: text.path().to_owned() });
    };
    let header: Vec<String> = head.cells(',').iter().map(|c| c.trim_matches('"').to_owned()).collect();
    let mut rows = Vec::new();
    for line in lines {
        let cells = line.cells(',');
        if cells.len() != header.len() {
            return Err(line.refuse(format!(
                "{} cells where the header has {}: complete the row",
                cells.len(),
                header.len()
            )));
        }
        let value = |(k, cell): (usize, &&str)| Ok(line.number_if_any(k, cell)?.filter(|x| *x != 0.0));
        rows.push(cells.iter().enumerate().map(value).collect::<Result<Vec<_>, SessionError>>()?);
    }
    Ok(Matrix { columns: header.len(), header: Some(header), rows })
}

fn sparse(text: &Text) -> Result<Matrix, SessionError> {
    let mut lines = text.filled().skip(1);
    let whole = |line: &super::text::Line, k: usize, cell: &str| -> Result<usize, SessionError> {
        cell.parse::<usize>().map_err(|_| line.refuse(format!("column {}: {cell:?} is no count", k + 1)))
    };
    let Some(head) = lines.next() else {
        return Err(text.refuse_end("rows, columns and count are missing: the file breaks off"));
    };
    let [r, c, n] = head.cells('\t')[..] else {
        return Err(head.refuse("rows, columns and count are wanted, with tabs between"));
    };
    let (r, c, n) = (whole(&head, 0, r)?, whole(&head, 1, c)?, whole(&head, 2, n)?);
    if r.saturating_mul(c) > 100_000_000 {
        return Err(
            head.refuse(format!("{r} rows of {c}: more than this program holds; the file is damaged"))
        );
    }
    let mut rows = vec![vec![None; c]; r];
    let mut count = 0;
    for line in lines {
        let [i, j, value] = line.cells('\t')[..] else {
            return Err(line.refuse("row, column and value are wanted, with tabs between"));
        };
        let (i, j, value) = (whole(&line, 0, i)?, whole(&line, 1, j)?, line.number_if_any(2, value)?);
        if !(1..=r).contains(&i) || !(1..=c).contains(&j) {
            return Err(line.refuse(format!("row {i}, column {j} is outside of {r} by {c}")));
        }
        rows[i - 1][j - 1] = value;
        count += 1;
    }
    if count != n {
        return Err(text.refuse_end(format!("{count} values where {n} are announced: the file breaks off")));
    }
    Ok(Matrix { columns: c, header: None, rows })
}

fn time_ns(row: usize, rate_hz: f64) -> i64 {
    (row as f64 * 1e9 / rate_hz).round() as i64
}

fn checked_rate(path: &Path, rate_hz: f64) -> Result<(), SessionError> {
    let fine = rate_hz.is_finite() && rate_hz > 0.0;
    if fine {
        Ok(())
    } else {
        Err(SessionError::value(path, "rate", format!("{rate_hz} Hz: give the frames a second as --rate")))
    }
}

/// Reads `*xypts.csv` or `.tsv` as observations: `camera_names`, `marker_names` and `markers` of the results
/// are filled.
///
/// # Errors
/// Names the line and column; a header in another order, names or sizes that do not fit.
pub fn read_xypts(path: &Path, options: &PointOptions) -> Result<RunResults, SessionError> {
    checked_rate(path, options.rate_hz)?;
    let m = matrix(path, "digitised points")?;
    let cameras = cameras_in(path, &m, options)?;
    if cameras == 0 || m.columns % (2 * cameras) != 0 {
        return Err(SessionError::value(
            path,
            "columns",
            format!("{} are not two for each of {cameras} cameras and each point", m.columns),
        ));
    }
    let points = m.columns / (2 * cameras);
    let dummy = [ImageSize { width_px: 1, height_px: 1 }];
    let sizes = if options.origin.is_top_left() { &dummy[..] } else { &options.sizes };
    let named = names_and_sizes(path, cameras, &options.cameras, sizes)?;
    if !options.points.is_empty() && options.points.len() != points {
        return Err(SessionError::value(
            path,
            "names",
            format!("{} names for {points} points: give one each", options.points.len()),
        ));
    }
    let mut markers = Vec::new();
    for (k, row) in m.rows.iter().enumerate() {
        for (camera, (_, size)) in named.iter().enumerate() {
            for marker in 0..points {
                let at = 2 * (marker * cameras + camera);
                let (Some(u), Some(v)) = (row[at], row[at + 1]) else { continue };
                markers.push(MarkerObservation {
                    t_ns: time_ns(k, options.rate_hz),
                    camera,
                    marker,
                    pixel: options.origin.to_ours(Vector2::new(u, v), size.height_px),
                    covariance_px2: Matrix2::identity() * (options.std_px * options.std_px),
                });
            }
        }
    }
    let name = |k: usize| options.points.get(k).cloned().unwrap_or_else(|| format!("pt{}", k + 1));
    Ok(RunResults {
        camera_names: named.into_iter().map(|(n, _)| n).collect(),
        marker_names: (0..points).map(name).collect(),
        markers,
        ..RunResults::default()
    })
}

/// How many cameras there are, with the header seen to be in DLTdv's order.
fn cameras_in(path: &Path, m: &Matrix, options: &PointOptions) -> Result<usize, SessionError> {
    let Some(header) = &m.header else {
        return match options.cameras.len() {
            0 => Err(SessionError::value(
                path,
                "cameras",
                "a sparse file does not say how many: name them, --cameras cam1,cam2",
            )),
            n => Ok(n),
        };
    };
    let cameras = header.iter().take_while(|h| h.to_lowercase().starts_with("pt1_")).count() / 2;
    for (k, found) in header.iter().enumerate() {
        let (point, rest) = (k / (2 * cameras.max(1)) + 1, k % (2 * cameras.max(1)));
        let (camera, letters) = (rest / 2 + 1, if rest % 2 == 0 { ["U", "X"] } else { ["V", "Y"] });
        let fits = letters.iter().any(|l| found.eq_ignore_ascii_case(&format!("pt{point}_cam{camera}_{l}")));
        if !fits {
            let detail = format!(
                "{found:?} where pt{point}_cam{camera}_{} belongs: points outside, cameras inside, both from 1",
                letters[0]
            );
            return Err(SessionError::value(path, format!("column {}", k + 1), detail));
        }
    }
    Ok(cameras)
}

/// Reads `markers.csv` with its cameras and markers named in the order of their first appearance, or those
/// given.
///
/// # Errors
/// Those of [`read_markers`].
pub fn read_marker_table(
    path: &Path,
    cameras: &[String],
    markers: &[String],
) -> Result<RunResults, SessionError> {
    let table = Table::read(path, "markers: `track` writes them")?;
    let appear = |column: &str, given: &[String]| -> Result<Vec<String>, SessionError> {
        let column = table.column(column)?;
        let mut names = given.to_vec();
        if given.is_empty() {
            for row in table.rows()? {
                if !names.iter().any(|n| n == row.text(column)) {
                    names.push(row.text(column).to_owned());
                }
            }
        }
        Ok(names)
    };
    let (camera_names, marker_names) = (appear("camera", cameras)?, appear("marker", markers)?);
    let markers = read_markers(path, &camera_names, &marker_names)?;
    Ok(RunResults { camera_names, marker_names, markers, ..RunResults::default() })
}

/// Writes `*xypts.csv`, or the sparse form where the name ends in `.tsv`; one row an instant of the even
/// clock.
///
/// # Errors
/// Times on no even clock; a missing image size where v grows up; what the file system refuses.
pub fn write_xypts(
    path: &Path,
    tracks: &RunResults,
    origin: PixelOrigin,
    sizes: &[ImageSize],
) -> Result<Vec<String>, SessionError> {
    let (cameras, points) = (tracks.camera_names.len(), tracks.marker_names.len());
    let dummy = [ImageSize { width_px: 1, height_px: 1 }];
    let sizes = names_and_sizes(
        path,
        cameras,
        &tracks.camera_names,
        if origin.is_top_left() { &dummy } else { sizes },
    )?;
    let mut instants: BTreeMap<i64, Vec<Option<f64>>> = BTreeMap::new();
    for o in &tracks.markers {
        let row = instants.entry(o.t_ns).or_insert_with(|| vec![None; 2 * cameras * points]);
        let theirs = origin.from_ours(o.pixel, sizes[o.camera].1.height_px);
        let at = 2 * (o.marker * cameras + o.camera);
        (row[at], row[at + 1]) = (Some(theirs.x), Some(theirs.y));
    }
    let times: Vec<i64> = instants.keys().copied().collect();
    let clock = even_clock(path, &times)?;
    let rows: Vec<Option<&Vec<Option<f64>>>> =
        clock.ticks.iter().map(|t| t.and_then(|k| instants.get(&times[k]))).collect();
    let columns = (1..=points)
        .flat_map(|p| (1..=cameras).flat_map(move |c| ["U", "V"].map(|l| format!("pt{p}_cam{c}_{l}"))));
    write_matrix(path, "Sparse format camera coordinates file", &columns.collect::<Vec<_>>(), &rows)?;
    Ok(vec![
        format!(
            "points in order: {}; cameras in order: {}",
            tracks.marker_names.join(", "),
            tracks.camera_names.join(", ")
        ),
        format!(
            "row 1 is {} s, {:.6} rows a second; pixels are those of --origin {}",
            crate::s_from_ns(times[0]),
            clock.rate_hz,
            origin.name()
        ),
    ])
}

fn write_matrix(
    path: &Path,
    title: &str,
    columns: &[String],
    rows: &[Option<&Vec<Option<f64>>>],
) -> Result<(), SessionError> {
    let cell = |row: &Option<&Vec<Option<f64>>>, k: usize| row.and_then(|r| r[k]);
    let mut text;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("tsv")) {
        let filled: String = (0..columns.len())
            .flat_map(|k| {
                rows.iter()
                    .enumerate()
                    .filter_map(move |(i, row)| Some(format!("{}\t{}\t{:.6}\n", i + 1, k + 1, cell(row, k)?)))
            })
            .collect();
        text = format!("{title}\n{}\t{}\t{}\n", rows.len(), columns.len(), filled.lines().count());
        text += &filled;
    } else {
        text = columns.join(",") + "\n";
        for row in rows {
            let cells: Vec<String> = (0..columns.len())
                .map(|k| cell(row, k).map_or("NaN".into(), |x| format!("{x:.6}")))
                .collect();
            text += &(cells.join(",") + "\n");
        }
    }
    write_whole(path, text.as_bytes())
}

/// Reads `*xyzpts.csv` or `.tsv`.
///
/// # Errors
/// Names the line and column; columns that are not three a point.
pub fn read_xyzpts(path: &Path, rate_hz: f64, names: &[String]) -> Result<MarkerPaths, SessionError> {
    checked_rate(path, rate_hz)?;
    let m = matrix(path, "digitised points in space")?;
    let points = m.columns / 3;
    if points == 0 || m.columns % 3 != 0 || !(names.is_empty() || names.len() == points) {
        let detail = format!(
            "{} columns, {} names: X, Y and Z of each point are wanted, and a name for each or none",
            m.columns,
            names.len()
        );
        return Err(SessionError::value(path, "columns", detail));
    }
    let place = |row: &Vec<Option<f64>>, k: usize| match row[3 * k..3 * k + 3] {
        [Some(x), Some(y), Some(z)] => Some(Vector3::new(x, y, z)),
        _ => None,
    };
    Ok(MarkerPaths {
        names: (0..points).map(|k| names.get(k).cloned().unwrap_or_else(|| format!("pt{}", k + 1))).collect(),
        t_ns: (0..m.rows.len()).map(|k| time_ns(k, rate_hz)).collect(),
        points_m: m.rows.iter().map(|row| (0..points).map(|k| place(row, k)).collect()).collect(),
    })
}

/// Writes `*xyzpts.csv`, or the sparse form where the name ends in `.tsv`.
///
/// # Errors
/// Times on no even clock; what the file system refuses.
pub fn write_xyzpts(path: &Path, paths: &MarkerPaths) -> Result<Vec<String>, SessionError> {
    let clock = even_clock(path, &paths.t_ns)?;
    let flat = |places: &Vec<Option<Vector3<f64>>>| -> Vec<Option<f64>> {
        places.iter().flat_map(|p| (0..3).map(move |axis| p.map(|p| p[axis]))).collect()
    };
    let dense: Vec<Vec<Option<f64>>> = paths.points_m.iter().map(flat).collect();
    let rows: Vec<Option<&Vec<Option<f64>>>> = clock.ticks.iter().map(|t| t.map(|k| &dense[k])).collect();
    let columns: Vec<String> =
        (1..=paths.names.len()).flat_map(|p| ["X", "Y", "Z"].map(|l| format!("pt{p}_{l}"))).collect();
    write_matrix(path, "Sparse format 3D coordinates file", &columns, &rows)?;
    Ok(vec![format!("points in order: {}; {:.6} rows a second", paths.names.join(", "), clock.rate_hz)])
}

/// Lateness of each camera's time stamps from `*offsets.csv` or `.tsv`, s: a session's `time_offset_s`. A
/// camera shows its frame r + offset at row r; zeros are unset, and an offset that changes is refused.
///
/// # Errors
/// Names the line and column; an offset that is not the same in all rows.
pub fn read_offsets(path: &Path, rate_hz: f64) -> Result<Vec<f64>, SessionError> {
    checked_rate(path, rate_hz)?;
    let m = matrix(path, "camera offsets")?;
    let one = |k: usize| -> Result<f64, SessionError> {
        let mut all = m.rows.iter().filter_map(|row| row[k]);
        let first = all.next().unwrap_or(0.0);
        match all.find(|x| *x != first) {
            Some(other) => Err(SessionError::value(
                path,
                format!("cam{}_offset", k + 1),
                format!("is {first} and later {other} frames: a session has one for each camera"),
            )),
            None => Ok(first / rate_hz),
        }
    };
    (0..m.columns).map(one).collect()
}
