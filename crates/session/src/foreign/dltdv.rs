//! DLT coefficients of DLTdv and Argus, and DLTdv's control object.
//!
//! Comma separated, no header; eleven rows L1 to L11, one column a camera. The file does not say where v
//! begins. With right-handed world axes and the world's origin before the camera the left 3×3 block of the
//! matrix (L12 = 1) has a positive determinant where v grows down and a negative one where it grows up. Where
//! lenses were corrected first the coefficients are of undistorted points.

use super::Noted;
use super::pixels::PixelOrigin;
use super::rigs::{exact_rig, names_and_sizes, rig_camera};
use super::text::Text;
use crate::{SessionError, write_whole};
use mavsight_flight::Color;
use mavsight_geometry::{Camera, Dlt, ImageSize};
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::Rig;
use std::path::Path;

/// What the coefficients' file does not say.
#[derive(Debug, Clone, Default)]
pub struct DltOptions {
    /// Where pixels are counted from; found from the determinants and the file's name where left out.
    pub origin: Option<PixelOrigin>,
    /// Image size: one for all cameras or one each.
    pub sizes: Vec<ImageSize>,
    /// Names of the cameras; `cam1`, `cam2`, ... where empty.
    pub names: Vec<String>,
}

/// Reads `*DLTcoefs.csv` of DLTdv or `*-dlt-coefficients.csv` of Argus.
///
/// # Errors
/// Names the line and column; other numbers of rows than 11 (8 is a planar DLT), an origin that the
/// determinants belie, a missing image size.
pub fn read_coefficients(path: &Path, options: &DltOptions) -> Result<Noted<Rig>, SessionError> {
    let text = Text::read(path, "DLT coefficients")?;
    let separator = if text.filled().next().is_some_and(|l| l.text.contains('\t')) { '\t' } else { ',' };
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for line in text.filled() {
        let row = line.numbers(separator)?;
        if rows.first().is_some_and(|first| first.len() != row.len()) {
            let detail = format!(
                "{} columns where the first row has {}: one column a camera",
                row.len(),
                rows[0].len()
            );
            return Err(line.refuse(detail));
        }
        rows.push(row);
    }
    match rows.len() {
        11 => {}
        8 => {
            return Err(text.refuse_end(
                "8 rows are a planar DLT, which is no camera: calibrate with points off one plane",
            ));
        }
        n => {
            return Err(
                text.refuse_end(format!("{n} rows: L1 to L11 are wanted, one a row, without a header"))
            );
        }
    }
    let dlts: Vec<Dlt> = (0..rows[0].len()).map(|c| Dlt { l: std::array::from_fn(|k| rows[k][c]) }).collect();
    let named = names_and_sizes(path, dlts.len(), &options.names, &options.sizes)?;
    let (origin, mut notes) = origin_of(path, &dlts, options.origin)?;
    notes.push(format!("pixels are taken as those of {} (--origin {})", describe(origin), origin.name()));
    let mut cameras = Vec::new();
    for (dlt, (name, size)) in dlts.iter().zip(named) {
        let geometric = |e: mavsight_geometry::GeometryError| {
            SessionError::value(path, format!("camera {name}"), e.to_string())
        };
        let ours =
            Dlt::from_matrix(&(origin.ours_from_theirs(size.height_px) * dlt.matrix())).map_err(geometric)?;
        let camera = upright(ours.camera(size).map_err(geometric)?);
        cameras.push(rig_camera(name, camera));
    }
    Ok(exact_rig(cameras, notes))
}

/// Takes rounding for what it is: skew and a difference of the focal lengths below a billionth of them are
/// none.
fn upright(mut camera: Camera) -> Camera {
    let k = &mut camera.intrinsics;
    if k.skew_px.abs() < 1e-9 * k.fx_px {
        k.skew_px = 0.0;
    }
    if (k.fx_px - k.fy_px).abs() < 1e-9 * k.fx_px {
        k.fy_px = k.fx_px;
    }
    camera
}

fn describe(origin: PixelOrigin) -> &'static str {
    match origin {
        PixelOrigin::TopLeftZero => "this program, from 0 at the top left",
        PixelOrigin::Dltdv8 => "DLTdv8, from 1 at the top left",
        PixelOrigin::Dltdv5 => "DLTdv5 to 7, from 1 at the lower left",
        PixelOrigin::Argus => "Argus, from 0 and the lower left",
    }
}

fn origin_of(
    path: &Path,
    dlts: &[Dlt],
    given: Option<PixelOrigin>,
) -> Result<(PixelOrigin, Vec<String>), SessionError> {
    let down: Vec<bool> = dlts.iter().map(|d| d.matrix().fixed_columns::<3>(0).determinant() > 0.0).collect();
    let count = down.iter().filter(|d| **d).count();
    let Some(origin) = given else {
        if count != 0 && count != down.len() {
            let detail = format!(
                "v grows down in {count} of {} cameras by their determinants: the world's origin lies behind some of them, or \
                 columns of two programs are mixed; give --origin",
                down.len()
            );
            return Err(SessionError::value(path, "origin", detail));
        }
        let by_argus = path.file_name().is_some_and(|n| n.to_string_lossy().contains("dlt-coefficients"));
        let origin = match (count > 0, by_argus) {
            (true, _) => PixelOrigin::Dltdv8,
            (false, true) => PixelOrigin::Argus,
            (false, false) => PixelOrigin::Dltdv5,
        };
        return Ok((origin, Vec::new()));
    };
    let against = down.iter().filter(|d| **d != origin.is_top_left()).count();
    if against == down.len() {
        let (way, other) =
            if origin.is_top_left() { ("up", "dltdv5 or argus") } else { ("down", "dltdv8 or zero") };
        let detail = format!(
            "{} is given, but by its determinant v grows {way} in every camera: --origin {other}; or the world's axes are left-handed",
            origin.name()
        );
        return Err(SessionError::value(path, "origin", detail));
    }
    let behind = down.iter().enumerate().filter(|(_, d)| **d != origin.is_top_left());
    let notes = behind.map(|(k, _)| {
        format!("camera {}: the world's origin lies behind it, or its column is of another program", k + 1)
    });
    Ok((origin, notes.collect()))
}

/// Writes the eleven coefficients of each camera, shortest digits that read back the same.
///
/// # Errors
/// A camera whose focal plane holds the world's origin; what the file system refuses.
pub fn write_coefficients(path: &Path, rig: &Rig, origin: PixelOrigin) -> Result<Vec<String>, SessionError> {
    let mut columns = Vec::new();
    let mut notes = Vec::new();
    for camera in &rig.cameras {
        let to = origin.theirs_from_ours(camera.camera.size.height_px);
        let dlt = Dlt::from_matrix(&(to * camera.camera.matrix()))
            .map_err(|e| SessionError::value(path, format!("camera {}", camera.name), e.to_string()))?;
        columns.push(dlt.l);
        if camera.camera.distortion != Default::default() {
            notes.push(format!(
                "camera {}: the coefficients are of undistorted points; its distortion goes into an Argus profile or another format",
                camera.name
            ));
        }
    }
    let row = |k: usize| columns.iter().map(|l| format!("{:?}", l[k])).collect::<Vec<_>>().join(",") + "\n";
    let text: String = (0..11).map(row).collect();
    write_whole(path, text.as_bytes())?;
    notes.push(format!("pixels are written as those of {}", describe(origin)));
    Ok(notes)
}

/// Reads DLTdv's control object: one header line, then x, y, z a line. Points become `p1`, `p2`, ... without
/// diameter.
///
/// # Errors
/// Names the line and column.
pub fn read_control_object(path: &Path) -> Result<Noted<Vec<ControlPointRow>>, SessionError> {
    let text = Text::read(path, "control object")?;
    let mut points = Vec::new();
    for line in text.filled().skip(1) {
        let separator = if line.text.contains(',') { ',' } else { '\t' };
        let [x, y, z] = line.numbers(separator)?[..] else {
            return Err(line.refuse("three numbers x, y, z with commas between are wanted"));
        };
        points.push(ControlPointRow {
            name: format!("p{}", points.len() + 1),
            position_m: [x, y, z],
            diameter_m: 0.0,
            color: Color::new(0xff, 0xff, 0xff),
            std_m: 0.0,
        });
    }
    if points.is_empty() {
        return Err(SessionError::EmptyTable { path: path.to_owned() });
    }
    let notes = vec![
        "units are taken as metres; points have neither colours nor diameters: click them, and name \
                      their pixels in control.observations"
            .to_owned(),
    ];
    Ok(Noted { value: points, notes })
}

/// Writes DLTdv's control object: names, diameters and colours have no place in it.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_object(path: &Path, points: &[ControlPointRow]) -> Result<Vec<String>, SessionError> {
    let row = |p: &ControlPointRow| {
        let [x, y, z] = p.position_m;
        format!("{x:?},{y:?},{z:?}\n")
    };
    let text: String = std::iter::once("x,y,z\n".to_owned()).chain(points.iter().map(row)).collect();
    write_whole(path, text.as_bytes())?;
    Ok(vec![format!(
        "points in order: {}",
        points.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ")
    )])
}
