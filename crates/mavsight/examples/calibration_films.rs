//! Calibration by a wand and by boards, filmed in the virtual room: `cargo run --release -p mavsight
//! --example calibration_films`.
//!
//! Wand: two balls 500 mm apart are waved for 20 s before the paper's cameras, and the control frame is
//! seen in one still each; what is compared is the distance between the cameras (scale) and their centres. Once in step,
//! and once with the second camera late by 10 ms, which nothing says.
//! An argument `SECONDS` makes it shorter. Board: 12 stills of 8 by 5 squares of 40 mm by one wide camera
//! with k1 = -0.25, k2 = 0.08, beside control balls; what is compared is the focal length, and the
//! reprojection RMS over the corners' own errors.

use anyhow::{Result, anyhow};
use mavsight::flight::Color;
use mavsight::geometry::{Camera, ImageSize, Intrinsics, Isometry3, Point3, UnitQuaternion, Vector3};
use mavsight::lab;
use mavsight::pipeline::{
    Board, CLICKED_STD_PX, CameraFeed, ControlPixel, ControlStill, TimedFrame, Wand, WandBall, board_of,
    calibrate_from_observations, calibrate_from_stills, wand_of,
};
use mavsight::scene::{Aircraft, Film, PaintedBall, Room, Sensor};
use mavsight::vision::{Frame, find_board};
use std::f64::consts::TAU;

const RATE_HZ: f64 = 30.0;
const LENGTH_M: f64 = 0.5;

fn frame_of(size: ImageSize, rgb: Vec<u8>) -> Result<Frame> {
    Ok(Frame::from_rgb(size, rgb)?)
}

/// The wand on its way through the volume.
fn waved(t_s: f64) -> Isometry3<f64> {
    let wave = |hz: f64, shift: f64| (TAU * hz * t_s + shift).sin();
    let at = Vector3::new(1.0 * wave(0.17, 0.0), 1.0 * wave(0.23, 1.0), 1.5 + 0.8 * wave(0.31, 2.0));
    let turn = Vector3::new(1.5 * wave(0.21, 0.5), 1.5 * wave(0.19, 1.5), 1.5 * wave(0.27, 2.5));
    Isometry3::from_parts(at.into(), UnitQuaternion::from_scaled_axis(turn))
}

fn wand(seconds: f64, late_s: f64, room: &Room) -> Result<()> {
    let colors = [[0xdb, 0x12, 0x12], [0x12, 0x8c, 0x3a]];
    let linear = |rgb: [u8; 3]| rgb.map(|c| (f64::from(c) / 255.0).powf(2.2));
    let ball = |side: f64, rgb| PaintedBall {
        centre_m: Vector3::new(0.5 * side * LENGTH_M, 0.0, 0.0),
        radius_m: 0.03,
        linear: linear(rgb),
    };
    let stick = Aircraft::stick(&[ball(-1.0, colors[0]), ball(1.0, colors[1])]);
    let (cameras, points) = (lab::cameras(), lab::control_points());
    let films: Vec<Film<'_>> = cameras.iter().enumerate().map(|(k, c)| lab::film(room, c, k, 7)).collect();
    let frames = (seconds * RATE_HZ) as u64;
    let open_s = Sensor::default().exposure_fraction / RATE_HZ;
    let feeds = cameras.iter().zip(&films).enumerate().map(|(c, (camera, film))| {
        let stick = &stick;
        let size = camera.camera.size;
        let frames = (0..frames).map(move |k| {
            let t_s = k as f64 / RATE_HZ;
            let rgb = film.frame(k, stick, |share| waved(t_s + c as f64 * late_s + share * open_s));
            let frame = Frame::from_rgb(size, rgb).expect("a frame of its size");
            Ok(TimedFrame { t_ns: (t_s * 1e9).round() as i64, frame })
        });
        Some(CameraFeed::new(camera.name.clone(), None, Box::new(frames)))
    });
    let balls = colors.map(|[r, g, b]| WandBall { color: Color::new(r, g, b), diameter_m: 0.06 });
    let how = Wand { length_m: LENGTH_M, length_std_m: 0.0, balls };
    let object = wand_of(&how, feeds.collect())?;
    let (seen, late_ms) = (object.observations.len(), 1e3 * late_s);
    println!(
        "wand: {seen} observations of {} frames, the second camera {late_ms:.0} ms late unknown to it",
        2 * frames
    );
    let control = lab::control_frame(&points);
    let stills = cameras
        .iter()
        .zip(&films)
        .map(|(c, film)| {
            let frame = frame_of(c.camera.size, film.still(Some(&control)))?;
            Ok(ControlStill { camera: c.name.clone(), frame })
        })
        .collect::<Result<Vec<_>>>()?;
    let sizes: Vec<(String, ImageSize)> = cameras.iter().map(|c| (c.name.clone(), c.camera.size)).collect();
    println!("| calibration by | scale error % | camera centres mm | claimed mm |");
    println!("|---|---|---|---|");
    for (name, rig) in [
        ("frame alone", calibrate_from_stills(&stills, &points, &[])),
        ("frame and wand", calibrate_from_stills(&stills, &points, std::slice::from_ref(&object))),
        ("wand alone", calibrate_from_observations(&sizes, &[], &[], std::slice::from_ref(&object))),
    ] {
        let rig = rig?;
        let apart = |a: &Camera, b: &Camera| (a.centre_in_world() - b.centre_in_world()).norm();
        let found = apart(&rig.cameras[0].camera, &rig.cameras[1].camera);
        let scale = found / apart(&cameras[0].camera, &cameras[1].camera) - 1.0;
        let error = |k: usize| {
            1e3 * (rig.cameras[k].camera.centre_in_world() - cameras[k].camera.centre_in_world()).norm()
        };
        let std = |k: usize| 1e3 * rig.cameras[k].centre_std_m.norm();
        let centres = match name {
            "wand alone" => "(axes of the first camera)".to_owned(),
            _ => format!("{:.2}, {:.2}", error(0), error(1)),
        };
        println!("| {name} | {:+.4} | {centres} | {:.2}, {:.2} |", 100.0 * scale, std(0), std(1));
    }
    Ok(())
}

fn board(room: &Room) -> Result<()> {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let mut camera = lab::cameras().swap_remove(0);
    let lens = Intrinsics::from_horizontal_fov(size, 70_f64.to_radians());
    camera.camera = Camera::looking_at(Vector3::new(0.0, -3.0, 1.5), Vector3::new(0.0, 0.0, 1.5), lens, size);
    (camera.camera.distortion.k1, camera.camera.distortion.k2) = (-0.25, 0.08);
    let (columns, rows, square_m) = (7, 4, 0.04);
    let sheet = Aircraft::board(columns, rows, square_m);
    let film = lab::film(room, &camera, 0, 11);
    let middle = Vector3::new(0.12, 0.06, 0.0);
    let mut stills = Vec::new();
    let mut errors = (0.0, 0.0);
    for k in 0..12u32 {
        let wave = |step: f64| (TAU * step * f64::from(k)).sin();
        let turn = Vector3::new(0.7 * wave(0.39), 0.7 * wave(0.61), 0.4 * wave(0.23));
        let turn = UnitQuaternion::from_scaled_axis(turn);
        let at = Vector3::new(0.22 * wave(0.27), 0.12 * wave(0.43), 0.62 + 0.08 * wave(0.17));
        let in_camera = Isometry3::from_parts((at - turn * middle).into(), turn);
        let pose = camera.camera.cam_from_world.inverse() * in_camera;
        let frame = frame_of(size, film.frame(u64::from(k), &sheet, |_| pose))?;
        for (n, corner) in find_board(&frame, columns, rows).into_iter().flatten().enumerate() {
            let (i, j) = ((n % columns) as f64, (n / columns) as f64);
            let place = pose * Point3::new(i * square_m, j * square_m, 0.0);
            errors.0 += (corner.pixel - camera.camera.project(&place.coords)?.pixel).norm_squared();
            errors.1 += 2.0;
        }
        stills.push(frame);
    }
    let frames = stills.into_iter().enumerate().map(|(k, frame)| Ok(TimedFrame { t_ns: k as i64, frame }));
    let feed = CameraFeed::new("wide", None, Box::new(frames));
    let how = Board { columns, rows, square_m, ..Board::default() };
    let object = board_of(&how, vec![Some(feed)])?;
    let put_in_px = f64::sqrt(errors.0 / errors.1);
    // The camera is located by control points clicked to half a pixel.
    let points = lab::control_points();
    let near = |p: [f64; 3]| [0.5 * p[0], 0.3 * p[1], 0.9 + 0.4 * p[2]];
    let points: Vec<_> = points
        .into_iter()
        .map(|p| mavsight::pipeline::ControlPointRow { position_m: near(p.position_m), diameter_m: 0.0, ..p })
        .collect();
    let pixels = points.iter().enumerate().map(|(k, p)| {
        let seen = camera.camera.project(&Vector3::from(p.position_m))?.pixel;
        let off = |step: f64| 0.5 * (TAU * step * (k as f64 + 1.0)).sin();
        let (camera, name) = ("wide".to_owned(), p.name.clone());
        Ok(ControlPixel {
            camera,
            name,
            u_px: seen.x + off(0.37),
            v_px: seen.y + off(0.71),
            std_px: CLICKED_STD_PX,
        })
    });
    let pixels = pixels.collect::<Result<Vec<_>>>()?;
    let sizes = [("wide".to_owned(), size)];
    let rig = calibrate_from_observations(&sizes, &points, &pixels, std::slice::from_ref(&object))?;
    let found = rig.cameras.first().ok_or_else(|| anyhow!("no camera"))?;
    println!(
        "board: {} corners, put in {put_in_px:.4} px; found {} f {:.2} px ({:+.3} %), k1 {:.4}, k2 {:.4}; reprojection RMS over all {:.4} px",
        object.observations.len(),
        found.model,
        found.camera.intrinsics.fx_px,
        100.0 * (found.camera.intrinsics.fx_px / lens.fx_px - 1.0),
        found.camera.distortion.k1,
        found.camera.distortion.k2,
        board_rms_px(&object, &rig)?,
    );
    Ok(())
}

/// Root mean square of the board's residuals with every pose fitted anew to some of its corners, over their
/// redundancy.
fn board_rms_px(object: &mavsight::pose::MovedObject, rig: &mavsight::pose::Rig) -> Result<f64> {
    let estimator = mavsight::pose::PoseEstimator::new(rig, &object.points);
    let (mut squares, mut n) = (0.0, 0.0);
    for place in object.observations.chunk_by(|a, b| a.t_ns == b.t_ns) {
        // A few corners of each view: a start from all of them would try every three.
        let some: Vec<_> = place.iter().filter(|o| o.marker % 4 == 0).cloned().collect();
        if some.len() < 4 {
            continue;
        }
        let pose = estimator.estimate(some[0].t_ns, &some, None)?;
        squares += pose.residual_px.unwrap_or(0.0).powi(2) * 2.0 * some.len() as f64;
        n += 2.0 * some.len() as f64 - 6.0;
    }
    Ok(f64::sqrt(squares / n))
}

fn main() -> Result<()> {
    let seconds = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(20.0);
    let room = Room::meeting_room();
    board(&room)?;
    wand(seconds, 0.0, &room)?;
    wand(seconds, 0.01, &room)
}
