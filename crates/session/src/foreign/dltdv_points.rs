//! Points that DLTdv and Argus digitised: `*xypts` in the images, `*xyzpts` in space, `*offsets` of the
//! cameras, as CSV or as DLTdv's sparse TSV (title; rows, columns and count; then row, column and value from
//! 1). NaN and, as DLTdv has it, exact zero are missing.

use super::marker_paths::{MarkerPaths, even_clock};
use super::numbered;
use super::pixels::PixelOrigin;
use super::rigs::names_and_sizes;
use super::text::{Line, Text};
use crate::table::{Row, Table};
use crate::{RunResults, SessionError, read_markers, write_whole};
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

type Cells = Vec<Option<f64>>;

/// Most cells of a sparse file, which says how many there are: 128 MB, and 14 minutes at 240 Hz of ten points in two
/// cameras.
const MOST_CELLS: usize = 1 << 23;

struct Matrix {
    columns: usize,
    header: Option<Vec<String>>,
    /// Row by row.
    cells: Cells,
}

impl Matrix {
    fn rows(&self) -> impl ExactSizeIterator<Item = &[Option<f64>]> {
        self.cells.chunks_exact(self.columns.max(1))
    }
}

fn is_sparse(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("tsv"))
}

/// Reads a table of so many rows a second.
fn matrix(path: &Path, role: &str, rate_hz: f64) -> Result<Matrix, SessionError> {
    if !crate::RATES_HZ.contains(&rate_hz) {
        let detail = format!("{rate_hz} Hz: give the frames a second, 0.01 to 100000, as --rate");
        return Err(SessionError::value(path, "rate", detail));
    }
    if is_sparse(path) { sparse(&Text::read(path, role)?) } else { dense(&Table::read(path, role)?) }
}

fn dense(table: &Table) -> Result<Matrix, SessionError> {
    let header: Vec<String> = table.names().map(str::to_owned).collect();
    let cell = |row: Row<'_>, column: usize| -> Result<Option<f64>, SessionError> {
        let is_nan = row.text(column).eq_ignore_ascii_case("nan");
        if is_nan { Ok(None) } else { Ok(row.number_if_any(column)?.filter(|x| *x != 0.0)) }
    };
    let read = |row| (0..header.len()).map(move |column| cell(row, column));
    let cells = table.rows_if_any().flat_map(read).collect::<Result<_, _>>()?;
    Ok(Matrix { columns: header.len(), header: Some(header), cells })
}

fn sparse(text: &Text) -> Result<Matrix, SessionError> {
    let mut lines = text.filled().skip(1);
    let three = |line: &Line, what: &str| -> Result<[usize; 2], SessionError> {
        let cells = line.cells('\t');
        if cells.len() != 3 {
            return Err(line.refuse(format!("{what} are wanted, with tabs between")));
        }
        let whole = |k: usize| {
            let wrong = || line.refuse(format!("column {}: {:?} is no count", k + 1, cells[k]));
            cells[k].parse::<usize>().map_err(|_| wrong())
        };
        Ok([whole(0)?, whole(1)?])
    };
    let last = |line: &Line| line.number_if_any(2, line.cells('\t')[2]);
    let missing = "rows, columns and count are missing: the file breaks off";
    let head = lines.next().ok_or_else(|| text.refuse_end(missing))?;
    let [r, c] = three(&head, "rows, columns and count")?;
    let announced = last(&head)?.unwrap_or(0.0);
    if r.max(1).saturating_mul(c.max(1)) > MOST_CELLS {
        let detail = format!(
            "{r} rows of {c}: more than the {MOST_CELLS} cells that are held; the file is damaged, or cut it into parts"
        );
        return Err(head.refuse(detail));
    }
    let mut cells = vec![None; r * c];
    let mut count = 0;
    for line in lines {
        let [i, j] = three(&line, "row, column and value")?;
        if !(1..=r).contains(&i) || !(1..=c).contains(&j) {
            return Err(line.refuse(format!("row {i}, column {j} is outside of {r} by {c}")));
        }
        cells[(i - 1) * c + j - 1] = last(&line)?;
        count += 1;
    }
    if f64::from(count) != announced {
        let detail = format!("{count} values where {announced} are announced: the file breaks off");
        return Err(text.refuse_end(detail));
    }
    Ok(Matrix { columns: c, header: None, cells })
}

fn time_ns(row: usize, rate_hz: f64) -> i64 {
    (row as f64 * 1e9 / rate_hz).round() as i64
}

/// Names and sizes of the cameras; the sizes do not matter where v grows down.
fn named_cameras(
    path: &Path,
    count: usize,
    names: &[String],
    sizes: &[ImageSize],
    origin: PixelOrigin,
) -> Result<Vec<(String, ImageSize)>, SessionError> {
    let any = [ImageSize { width_px: 1, height_px: 1 }];
    names_and_sizes(path, count, names, if origin.is_top_left() { &any } else { sizes })
}

/// Reads `*xypts.csv` or `.tsv` as observations: `camera_names`, `marker_names` and `markers` of the results
/// are filled.
///
/// # Errors
/// Names the line and column; a header in another order, names or sizes that do not fit.
pub fn read_xypts(path: &Path, options: &PointOptions) -> Result<RunResults, SessionError> {
    let m = matrix(path, "digitised points", options.rate_hz)?;
    let cameras = cameras_in(path, &m, options)?;
    if cameras == 0 || m.columns % (2 * cameras) != 0 {
        let detail = format!("{} are not two for each of {cameras} cameras and each point", m.columns);
        return Err(SessionError::value(path, "columns", detail));
    }
    let points = m.columns / (2 * cameras);
    let named = named_cameras(path, cameras, &options.cameras, &options.sizes, options.origin)?;
    if !options.points.is_empty() && options.points.len() != points {
        let detail = format!("{} names for {points} points: give one each", options.points.len());
        return Err(SessionError::value(path, "names", detail));
    }
    let mut markers = Vec::new();
    for (k, row) in m.rows().enumerate() {
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
    Ok(RunResults {
        camera_names: named.into_iter().map(|(n, _)| n).collect(),
        marker_names: (0..points).map(|k| numbered(&options.points, k, "pt")).collect(),
        markers,
        ..RunResults::default()
    })
}

/// How many cameras there are, with the header seen to be in DLTdv's order.
fn cameras_in(path: &Path, m: &Matrix, options: &PointOptions) -> Result<usize, SessionError> {
    let Some(header) = &m.header else {
        let detail = "a sparse file does not say how many: name them, --cameras cam1,cam2";
        let refuse = || SessionError::value(path, "cameras", detail);
        return Some(options.cameras.len()).filter(|n| *n > 0).ok_or_else(refuse);
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
    let names = |column: &str, given: &[String]| -> Result<Vec<String>, SessionError> {
        Ok(if given.is_empty() { table.distinct(table.column(column)?) } else { given.to_vec() })
    };
    let (camera_names, marker_names) = (names("camera", cameras)?, names("marker", markers)?);
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
    let named = named_cameras(path, cameras, &tracks.camera_names, sizes, origin)?;
    let mut instants: BTreeMap<i64, Cells> = BTreeMap::new();
    for o in &tracks.markers {
        let row = instants.entry(o.t_ns).or_insert_with(|| vec![None; 2 * cameras * points]);
        let theirs = origin.to_theirs(o.pixel, named[o.camera].1.height_px);
        let at = 2 * (o.marker * cameras + o.camera);
        (row[at], row[at + 1]) = (Some(theirs.x), Some(theirs.y));
    }
    let (times_ns, rows): (Vec<i64>, Vec<Cells>) = instants.into_iter().unzip();
    let columns: Vec<String> = (1..=points)
        .flat_map(|p| (1..=cameras).flat_map(move |c| ["U", "V"].map(|l| format!("pt{p}_cam{c}_{l}"))))
        .collect();
    let rate_hz = write_matrix(path, "Sparse format camera coordinates file", &columns, &times_ns, &rows)?;
    Ok(vec![
        format!(
            "points in order: {}; cameras in order: {}",
            tracks.marker_names.join(", "),
            tracks.camera_names.join(", ")
        ),
        format!(
            "row 1 is {} s, {rate_hz:.6} rows a second; pixels are those of --origin {}",
            crate::s_from_ns(times_ns[0]),
            origin.name()
        ),
    ])
}

/// Writes rows at times on an even clock, whose rate it yields; instants that are missing are empty rows.
fn write_matrix(
    path: &Path,
    title: &str,
    columns: &[String],
    times_ns: &[i64],
    rows: &[Cells],
) -> Result<f64, SessionError> {
    let clock = even_clock(path, times_ns)?;
    let cell = |tick: &Option<usize>, column: usize| tick.and_then(|row| rows[row][column]);
    let ticks = &clock.ticks;
    let mut text;
    if is_sparse(path) {
        let mut filled = Vec::new();
        for column in 0..columns.len() {
            let own = ticks.iter().zip(1..).filter_map(|(tick, row)| Some((row, cell(tick, column)?)));
            filled.extend(own.map(|(row, x): (usize, f64)| format!("{row}\t{}\t{x:.6}\n", column + 1)));
        }
        text = format!("{title}\n{}\t{}\t{}\n", ticks.len(), columns.len(), filled.len());
        text += &filled.concat();
    } else {
        text = columns.join(",") + "\n";
        for tick in ticks {
            let number = |column| cell(tick, column).map_or("NaN".into(), |x| format!("{x:.6}"));
            text += &((0..columns.len()).map(number).collect::<Vec<String>>().join(",") + "\n");
        }
    }
    write_whole(path, text.as_bytes())?;
    Ok(clock.rate_hz)
}

/// Reads `*xyzpts.csv` or `.tsv`.
///
/// # Errors
/// Names the line and column; columns that are not three a point.
pub fn read_xyzpts(path: &Path, rate_hz: f64, names: &[String]) -> Result<MarkerPaths, SessionError> {
    let m = matrix(path, "digitised points in space", rate_hz)?;
    let points = m.columns / 3;
    if points == 0 || m.columns % 3 != 0 || !(names.is_empty() || names.len() == points) {
        let detail = format!(
            "{} columns, {} names: X, Y and Z of each point are wanted, and a name for each or none",
            m.columns,
            names.len()
        );
        return Err(SessionError::value(path, "columns", detail));
    }
    let place =
        |row: &[Option<f64>], k: usize| Some(Vector3::new(row[3 * k]?, row[3 * k + 1]?, row[3 * k + 2]?));
    Ok(MarkerPaths {
        names: (0..points).map(|k| numbered(names, k, "pt")).collect(),
        t_ns: (0..m.rows().len()).map(|k| time_ns(k, rate_hz)).collect(),
        points_m: m.rows().map(|row| (0..points).map(|k| place(row, k)).collect()).collect(),
    })
}

/// Writes `*xyzpts.csv`, or the sparse form where the name ends in `.tsv`.
///
/// # Errors
/// Times on no even clock; what the file system refuses.
pub fn write_xyzpts(path: &Path, paths: &MarkerPaths) -> Result<Vec<String>, SessionError> {
    let flat = |places: &Vec<Option<Vector3<f64>>>| -> Cells {
        places.iter().flat_map(|p| (0..3).map(move |axis| p.map(|p| p[axis]))).collect()
    };
    let rows: Vec<Cells> = paths.points_m.iter().map(flat).collect();
    let columns: Vec<String> =
        (1..=paths.names.len()).flat_map(|p| ["X", "Y", "Z"].map(|l| format!("pt{p}_{l}"))).collect();
    let rate_hz = write_matrix(path, "Sparse format 3D coordinates file", &columns, &paths.t_ns, &rows)?;
    Ok(vec![format!("points in order: {}; {rate_hz:.6} rows a second", paths.names.join(", "))])
}

/// Lateness of each camera's time stamps from `*offsets.csv` or `.tsv`, s: a session's `time_offset_s`. A
/// camera shows its frame r + offset at row r; zeros are unset, and an offset that changes is refused.
///
/// # Errors
/// Names the line and column; an offset that is not the same in all rows.
pub fn read_offsets(path: &Path, rate_hz: f64) -> Result<Vec<f64>, SessionError> {
    let m = matrix(path, "camera offsets", rate_hz)?;
    let one = |k: usize| {
        let mut all = m.rows().filter_map(|row| row[k]);
        let first = all.next().unwrap_or(0.0);
        let Some(other) = all.find(|x| *x != first) else { return Ok(first / rate_hz) };
        let detail = format!("is {first} and later {other} frames: a session has one for each camera");
        Err(SessionError::value(path, format!("cam{}_offset", k + 1), detail))
    };
    (0..m.columns).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sparse_file_that_claims_more_than_memory_holds_is_refused_before_it_takes_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tsv");
        for sides in ["3\t9999999", "99999999\t1", "0\t4294967296"] {
            std::fs::write(&path, format!("Sparse format\n{sides}\t1\n1\t1\t10\n")).unwrap();
            let said = read_xyzpts(&path, 30.0, &[]).unwrap_err().to_string();
            assert!(said.contains("line 2") && said.contains("8388608 cells"), "{said}");
        }
    }
}
