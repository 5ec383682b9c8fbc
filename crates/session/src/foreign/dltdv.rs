//! DLT coefficients of DLTdv and Argus, and DLTdv's control object.
//!
//! Comma separated, no header; eleven rows L1 to L11, one column a camera. The file does not say where v
//! begins. With right-handed world axes and the world's origin before the camera the left 3×3 block of the
//! matrix (L12 = 1) has a positive determinant where v grows down and a negative one where it grows up. Where
//! lenses were corrected first the coefficients are of undistorted points.

use super::pixels::PixelOrigin;
use super::rigs::{exact_rig, names_and_sizes, rig_camera};
use super::text::Text;
use super::{CameraOptions, Noted, numbered};
use crate::{SessionError, write_whole};
use mavsight_flight::Color;
use mavsight_geometry::{Camera, Dlt};
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::Rig;
use std::path::Path;

/// Reads `*DLTcoefs.csv` of DLTdv or `*-dlt-coefficients.csv` of Argus.
///
/// # Errors
/// Those of [`crate::foreign`] for readers of cameras; what the file system refuses.
pub fn read(path: &Path, options: &CameraOptions) -> Result<Noted<Rig>, SessionError> {
    let text = Text::read(path, "DLT coefficients")?;
    let separator = if text.filled().next().is_some_and(|l| l.text.contains('\t')) { '\t' } else { ',' };
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for line in text.filled() {
        let row = line.numbers(separator)?;
        let first = rows.first().map_or(row.len(), Vec::len);
        if first != row.len() {
            let detail = "one column a camera";
            return Err(
                line.refuse(format!("{} columns where the first row has {first}: {detail}", row.len()))
            );
        }
        rows.push(row);
    }
    if rows.len() != 11 {
        return Err(text.refuse_end(match rows.len() {
            8 => {
                "8 rows are a planar DLT, which is no camera: calibrate with points off one plane".to_owned()
            }
            n => format!("{n} rows: L1 to L11 are wanted, one a row, without a header"),
        }));
    }
    let dlts: Vec<Dlt> = (0..rows[0].len()).map(|c| Dlt { l: std::array::from_fn(|k| rows[k][c]) }).collect();
    let named = names_and_sizes(path, dlts.len(), &options.names, &options.sizes)?;
    let (origin, mut notes) = origin_of(path, &dlts, options.origin)?;
    notes.push(format!("pixels are taken as those of {} (--origin {})", origin.describe(), origin.name()));
    let mut cameras = Vec::new();
    for (dlt, (name, size)) in dlts.iter().zip(named) {
        let ours = Dlt::from_matrix(&(origin.ours_from_theirs(size.height_px) * dlt.matrix()));
        let camera = ours
            .and_then(|ours| ours.camera(size))
            .map_err(|e| SessionError::value(path, format!("camera {name}"), e.to_string()))?;
        cameras.push(rig_camera(name, upright(camera)));
    }
    Ok(exact_rig(cameras, notes))
}

/// Sets skew and a difference of the focal lengths to zero below a billionth of them: they are rounding.
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

/// The origin of the pixels: as given, where not all determinants belie it, or as they and the file's name
/// show; with a note on each camera that differs.
fn origin_of(
    path: &Path,
    dlts: &[Dlt],
    given: Option<PixelOrigin>,
) -> Result<(PixelOrigin, Vec<String>), SessionError> {
    let down: Vec<bool> = dlts.iter().map(|d| d.matrix().fixed_columns::<3>(0).determinant() > 0.0).collect();
    let (count, all) = (down.iter().filter(|d| **d).count(), down.len());
    let refuse = |detail: String| Err(SessionError::value(path, "origin", detail));
    let Some(origin) = given else {
        if count != 0 && count != all {
            return refuse(format!(
                "v grows down in {count} of {all} cameras by their determinants: the world's origin lies behind some of them, or \
                 columns of two programs are mixed; give --origin"
            ));
        }
        let by_argus = path.file_name().is_some_and(|n| n.to_string_lossy().contains("dlt-coefficients"));
        let up = if by_argus { PixelOrigin::Argus } else { PixelOrigin::Dltdv5 };
        return Ok((if count > 0 { PixelOrigin::Dltdv8 } else { up }, Vec::new()));
    };
    let behind: Vec<usize> = (0..all).filter(|k| down[*k] != origin.is_top_left()).collect();
    if behind.len() == all {
        let (way, other) =
            if origin.is_top_left() { ("up", "dltdv5 or argus") } else { ("down", "dltdv8 or zero") };
        return refuse(format!(
            "{} is given, but by its determinant v grows {way} in every camera: --origin {other}; or the world's axes are left-handed",
            origin.name()
        ));
    }
    let note = |k: usize| {
        format!("camera {}: the world's origin lies behind it, or its column is of another program", k + 1)
    };
    Ok((origin, behind.into_iter().map(note).collect()))
}

/// Writes the eleven coefficients of each camera, shortest digits that read back the same.
///
/// # Errors
/// Those of [`crate::foreign`] for writers of cameras; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, options: &CameraOptions) -> Result<Vec<String>, SessionError> {
    let is_of_argus = path.to_string_lossy().contains("dlt-coefficients");
    let usual = if is_of_argus { PixelOrigin::Argus } else { PixelOrigin::Dltdv8 };
    let origin = options.origin.unwrap_or(usual);
    let (mut columns, mut notes) = (Vec::new(), Vec::new());
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
    notes.push(format!("pixels are written as those of {}", origin.describe()));
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
        let position_m = line.numbers(separator)?.try_into();
        points.push(ControlPointRow {
            name: numbered(&[], points.len(), "p"),
            position_m: position_m
                .map_err(|_| line.refuse("three numbers x, y, z with commas between are wanted"))?,
            diameter_m: 0.0,
            color: Color::new(0xff, 0xff, 0xff),
            std_m: 0.0,
        });
    }
    if points.is_empty() {
        return Err(SessionError::no_rows(path));
    }
    let note = "units are taken as metres; points have neither colours nor diameters: click them, and name \
                their pixels in control.observations";
    Ok(Noted { value: points, notes: vec![note.to_owned()] })
}

/// Writes DLTdv's control object: names, diameters and colours have no place in it.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_object(path: &Path, points: &[ControlPointRow]) -> Result<Vec<String>, SessionError> {
    let mut text = "x,y,z\n".to_owned();
    for ControlPointRow { position_m: [x, y, z], .. } in points {
        text += &format!("{x:?},{y:?},{z:?}\n");
    }
    write_whole(path, text.as_bytes())?;
    let names: Vec<&str> = points.iter().map(|p| p.name.as_str()).collect();
    Ok(vec![format!("points in order: {}", names.join(", "))])
}
