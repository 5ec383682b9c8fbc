//! From control stills, or from a table of clicked pixels, to a rig.

use crate::{ControlPixel, ControlPointRow, PipelineError};
use mavsight_geometry::{Camera, ControlPoint, ImageSize, Matrix2, Vector2, Vector3};
use mavsight_pose::{
    CameraControl, LeftOut, LeftOutReason, MovedObject, Rig, Selection, calibrate_with, median,
    select_control_balls,
};
use mavsight_vision::{BallColor, Detection, Detector, Frame};

/// The control frame as one camera saw it.
pub struct ControlStill {
    /// Camera name.
    pub camera: String,
    /// The image.
    pub frame: Frame,
}

/// Smallest and largest apparent diameter of a ball that is searched for when nothing is known of the
/// camera: below 3 px a disc has no inside that shows its colour, above a tenth of the image it is not a
/// control ball.
pub(crate) fn diameter_range_px(size: ImageSize) -> std::ops::RangeInclusive<f64> {
    3.0..=f64::from(size.width_px) / 10.0
}

/// Finds the control balls in each still by colour and geometry, and solves for the cameras; then once more
/// with the images of the balls stretched as these cameras do. Together with objects that were moved before
/// the cameras the table may be as short as three points.
///
/// Two balls whose colours are exchanged in the table are left out and named.
///
/// # Errors
/// Too few balls, colours that cannot be distinguished, or points and objects that do not determine a
/// camera; each names the camera.
pub fn calibrate_from_stills(
    stills: &[ControlStill],
    table: &[ControlPointRow],
    objects: &[MovedObject],
) -> Result<Rig, PipelineError> {
    let colors: Vec<BallColor> =
        table.iter().map(|row| BallColor { name: row.name.clone(), rgb: row.color.rgb() }).collect();
    let detector = Detector::new(&colors)
        .map_err(|source| PipelineError::Vision { place: "control points".into(), source })?;
    let mut detectors = vec![detector; stills.len()];
    let first = rig_of(stills, objects, table, &mut detectors, None)?;
    for (detector, seen_by) in detectors.iter_mut().zip(&first.cameras) {
        *detector = detector.clone().with_camera(seen_by.camera);
    }
    rig_of(stills, objects, table, &mut detectors, Some(&first))
}

fn rig_of(
    stills: &[ControlStill],
    objects: &[MovedObject],
    table: &[ControlPointRow],
    detectors: &mut [Detector],
    first: Option<&Rig>,
) -> Result<Rig, PipelineError> {
    let seen: Vec<Result<Seen, PipelineError>> = std::iter::zip(stills, detectors)
        .map(|(still, detector)| seen_in_still(still, table, detector, !objects.is_empty()))
        .collect();
    let is_mirrored = |s: &Result<Seen, PipelineError>| matches!(s, Err(PipelineError::MirroredImage { .. }));
    if seen.len() > 1 && seen.iter().all(is_mirrored) {
        return Err(PipelineError::LeftHandedTable);
    }
    let seen: Vec<Seen> = seen.into_iter().collect::<Result<_, _>>()?;
    let swapped = swapped_pairs(&seen);
    let mut left_out = named_swaps(&swapped, table);
    let mut controls = Vec::with_capacity(stills.len());
    for (k, (still, seen)) in stills.iter().zip(&seen).enumerate() {
        let is_swapped = |i: usize| swapped.iter().any(|(a, b)| *a == i || *b == i);
        let mut control = CameraControl::exact(still.camera.clone(), still.frame.size, vec![], vec![]);
        let mut diameters_px = Vec::new();
        for (i, row) in table.iter().enumerate().filter(|(i, _)| !is_swapped(*i)) {
            let chosen = seen.selection.chosen[i];
            let Some(ball) = chosen.and_then(|index| seen.candidates[i].get(index)) else { continue };
            push_point(&mut control, row, ball.pixel, ball.covariance_px2);
            diameters_px.push(ball.diameter_px);
        }
        if let Some(camera) = first.and_then(|rig| rig.cameras.get(k)) {
            doubt_odd_sizes(&mut control, &diameters_px, &camera.camera);
        }
        controls.push(control);
        for i in seen.selection.elsewhere.iter().filter(|i| !is_swapped(**i)) {
            left_out.push(LeftOut {
                name: table[*i].name.clone(),
                camera: Some(still.camera.clone()),
                reason: LeftOutReason::Displaced,
            });
        }
    }
    let mut rig = solve(&controls, objects)?;
    left_out.append(&mut rig.left_out);
    rig.left_out = left_out;
    Ok(rig)
}

/// Adds a control point and its image.
fn push_point(
    control: &mut CameraControl,
    row: &ControlPointRow,
    pixel: Vector2<f64>,
    pixel_cov_px2: Matrix2<f64>,
) {
    let (name, point_in_world_m) = (row.name.clone(), row.position_m.into());
    control.points.push(ControlPoint { name, point_in_world_m, pixel, pixel_cov_px2 });
    control.ball_radius_m.push(row.diameter_m / 2.0);
    control.survey_std_m.push(row.std_m);
}

/// What one still shows of the control frame.
struct Seen {
    candidates: Vec<Vec<Detection>>,
    selection: Selection,
}

fn seen_in_still(
    still: &ControlStill,
    table: &[ControlPointRow],
    detector: &mut Detector,
    has_objects: bool,
) -> Result<Seen, PipelineError> {
    let size = still.frame.size;
    let candidates = detector.detect(&still.frame, diameter_range_px(size));
    let found = candidates.iter().filter(|c| !c.is_empty()).count();
    if found < 6 && has_objects {
        // Too few for their geometry to identify them: the most ball-like of each colour.
        let chosen = candidates.iter().map(|list| most_ball_like(list)).collect();
        return Ok(Seen { candidates, selection: Selection { chosen, ..Selection::default() } });
    }
    if table.len() < 6 {
        return Err(PipelineError::ControlTable { found: table.len() });
    }
    if found < 6 {
        let missing = table.iter().zip(&candidates).filter(|(_, c)| c.is_empty());
        let missing: Vec<&str> = missing.map(|(row, _)| row.name.as_str()).collect();
        return Err(PipelineError::ControlBalls {
            camera: still.camera.clone(),
            found,
            wanted: table.len(),
            missing: missing.join(", "),
        });
    }
    let select = |is_mirrored: bool| {
        let place = |c: &Detection| {
            let across = if is_mirrored { f64::from(size.width_px - 1) - c.pixel.x } else { c.pixel.x };
            (Vector2::new(across, c.pixel.y), c.score)
        };
        let scored: Vec<Vec<(Vector2<f64>, f64)>> =
            candidates.iter().map(|list| list.iter().map(place).collect()).collect();
        let positions: Vec<Vector3<f64>> = table.iter().map(|row| row.position_m.into()).collect();
        let names: Vec<&str> = table.iter().map(|row| row.name.as_str()).collect();
        select_control_balls(&scored, &positions, &names, size)
    };
    let camera = still.camera.clone();
    let selection = select(false).map_err(|source| match select(true) {
        Ok(_) => PipelineError::MirroredImage { camera },
        Err(_) => PipelineError::Pose { place: camera, source },
    })?;
    Ok(Seen { candidates, selection })
}

fn most_ball_like(list: &[Detection]) -> Option<usize> {
    (0..list.len()).max_by(|a, b| list[*a].score.total_cmp(&list[*b].score))
}

/// Pairs that a camera sees exchanged while none sees them in place: those are wrong in the table. Where
/// another camera sees them right, the first only took one colour for the other, which its geometry mends.
fn swapped_pairs(seen: &[Seen]) -> Vec<(usize, usize)> {
    let mut pairs: Vec<(usize, usize)> = seen.iter().flat_map(|s| s.selection.swapped.clone()).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let right = |s: &Seen, i: usize| {
        s.selection.chosen[i].is_some_and(|k| most_ball_like(&s.candidates[i]) == Some(k))
    };
    pairs.retain(|(a, b)| !seen.iter().any(|s| right(s, *a) && right(s, *b)));
    pairs
}

fn named_swaps(pairs: &[(usize, usize)], table: &[ControlPointRow]) -> Vec<LeftOut> {
    let both = pairs.iter().flat_map(|(a, b)| [(*a, *b), (*b, *a)]);
    both.map(|(i, with)| LeftOut {
        name: table[i].name.clone(),
        camera: None,
        reason: LeftOutReason::Swapped { with: table[with].name.clone() },
    })
    .collect()
}

/// What makes a ball appear larger or smaller than it is, beyond what all balls of the camera share (blur,
/// the light's fall towards the rim), moves its centre by up to as much: half the difference widens its
/// covariance.
fn doubt_odd_sizes(control: &mut CameraControl, diameters_px: &[f64], camera: &Camera) {
    let expected_px = |point: &ControlPoint, radius_m: f64| {
        let seen = camera.project(&point.point_in_world_m).ok()?;
        let spread = seen.d_pixel_d_point_in_world * seen.d_pixel_d_point_in_world.transpose();
        let diameter_px = 2.0 * radius_m * spread.determinant().powf(0.25);
        (diameter_px > 0.0).then_some(diameter_px)
    };
    let expected_px: Vec<Option<f64>> =
        control.points.iter().zip(&control.ball_radius_m).map(|(p, r)| expected_px(p, *r)).collect();
    let ratio = |(measured, expected): (&f64, &Option<f64>)| expected.map(|e| measured / e);
    let ratios = diameters_px.iter().zip(&expected_px).filter_map(ratio);
    let Some(usual) = median(ratios.collect()) else { return };
    for (point, (measured, expected)) in control.points.iter_mut().zip(diameters_px.iter().zip(&expected_px))
    {
        let odd_px = expected.map_or(0.0, |expected_px| 0.5 * (measured - usual * expected_px));
        point.pixel_cov_px2 += Matrix2::identity() * (odd_px * odd_px);
    }
}

/// Solves for the cameras from pixels that were measured elsewhere, of which there may be none, and from
/// moved objects.
///
/// # Errors
/// Points that do not determine a camera; each names the camera.
pub fn calibrate_from_observations(
    cameras: &[(String, ImageSize)],
    table: &[ControlPointRow],
    pixels: &[ControlPixel],
    objects: &[MovedObject],
) -> Result<Rig, PipelineError> {
    let mut controls = Vec::with_capacity(cameras.len());
    for (camera, size) in cameras {
        let mut control = CameraControl::exact(camera.clone(), *size, vec![], vec![]);
        for pixel in pixels.iter().filter(|p| &p.camera == camera) {
            let Some(row) = table.iter().find(|row| row.name == pixel.name) else { continue };
            let covariance_px2 = Matrix2::identity() * pixel.std_px.powi(2);
            push_point(&mut control, row, Vector2::new(pixel.u_px, pixel.v_px), covariance_px2);
        }
        controls.push(control);
    }
    solve(&controls, objects)
}

fn solve(controls: &[CameraControl], objects: &[MovedObject]) -> Result<Rig, PipelineError> {
    calibrate_with(controls, objects)
        .map_err(|source| PipelineError::Pose { place: "calibration".into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::Intrinsics;

    #[test]
    fn a_ball_that_appears_too_large_is_believed_less() {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let intrinsics = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
        let camera = Camera::looking_at(Vector3::new(0.0, -6.0, 0.0), Vector3::zeros(), intrinsics, size);
        let mut control = CameraControl::exact("cam".to_owned(), size, vec![], vec![]);
        let mut diameters_px = Vec::new();
        for k in 0..5 {
            let x_m = 0.5 * f64::from(k) - 1.0;
            control.points.push(ControlPoint {
                name: k.to_string(),
                point_in_world_m: Vector3::new(x_m, 0.0, 0.0),
                pixel: Vector2::zeros(),
                pixel_cov_px2: Matrix2::identity() * 1e-4,
            });
            control.ball_radius_m.push(0.03);
            // All appear 2 % too large.
            diameters_px.push(1.02 * 0.06 * intrinsics.fx_px / 6.0);
        }
        diameters_px[3] += 0.4;
        doubt_odd_sizes(&mut control, &diameters_px, &camera);
        let std_px: Vec<f64> = control.points.iter().map(|p| p.pixel_cov_px2[(0, 0)].sqrt()).collect();
        assert!((std_px[3] - 0.2).abs() < 0.03, "{std_px:?}");
        assert!([0, 1, 2, 4].iter().all(|k| std_px[*k] < 0.04), "{std_px:?}");
    }
}
