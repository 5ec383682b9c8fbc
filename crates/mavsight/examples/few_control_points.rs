//! Is a camera that sees five of eight control balls as good as it says? Beside the laboratory's two cameras, each set
//! up anew within a tenth of a metre, a third looks past three of the balls; it is calibrated by them, by the aircraft
//! that is carried about for ten seconds, and by the other two. The squared error of its centre over what its
//! covariance says has a mean of 3 where that is true.
//!
//! `cargo run --release -p mavsight --example few_control_points -- 10`

use mavsight::flight::Vehicle;
use mavsight::geometry::{Camera, Isometry3, UnitQuaternion, Vector3};
use mavsight::lab;
use mavsight::pipeline::{CameraFeed, ControlStill, TimedFrame, aircraft_of, calibrate_from_stills};
use mavsight::random::Random;
use mavsight::scene::{Room, Sensor};
use mavsight::score::VirtualCamera;
use mavsight::vision::Frame;
use std::f64::consts::TAU;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Of a camera's place and of what it looks at.
const SET_UP_STD_M: f64 = 0.1;
/// The 95 % quantile of χ² of three degrees of freedom.
const INSIDE: f64 = 7.815;
const RATE_HZ: f64 = 15.0;
const FRAMES: u64 = 150;
/// Control balls that the third camera sees; none is this near to the rim of the image, which would show a part of it.
const SEEN: usize = 5;
const RIM_PX: f64 = 15.0;

/// The laboratory's cameras, a little elsewhere, and the third.
fn set_up(random: &mut Random) -> Outcome<Vec<VirtualCamera>> {
    let mut off = || Vector3::from_fn(|_, _| random.normal()) * SET_UP_STD_M;
    let mut cameras = lab::cameras();
    for VirtualCamera { camera, .. } in &mut cameras {
        let (centre, aim) = (camera.centre_in_world() + off(), Vector3::new(0.0, 0.0, 1.5) + off());
        *camera = Camera::looking_at(centre, aim, camera.intrinsics, camera.size);
    }
    let mut third = cameras[0].clone();
    let (like, centre) = (third.camera, Vector3::new(0.4, -5.5, 2.0) + off());
    let places: Vec<Vector3<f64>> = lab::control_points().iter().map(|p| p.position_m.into()).collect();
    let camera_at = |k: u32| {
        let aim = Vector3::new(0.1 * f64::from(k % 30), 0.0, 1.0 + 0.1 * f64::from(k / 30));
        Camera::looking_at(centre, aim, like.intrinsics, like.size)
    };
    let count = |camera: &Camera, margin_px: f64| {
        let in_view = |p: &&Vector3<f64>| {
            camera.project(p).is_ok_and(|seen| camera.size.contains(&seen.pixel, margin_px))
        };
        places.iter().filter(in_view).count()
    };
    let shows_five = |c: &Camera| [RIM_PX, -RIM_PX].iter().all(|margin_px| count(c, *margin_px) == SEEN);
    third.camera = (0..300).map(camera_at).find(shows_five).ok_or("no view of five balls")?;
    third.name = "cam3".to_owned();
    cameras.push(third);
    Ok(cameras)
}

/// The aircraft on its way through the room.
fn carried(t_s: f64) -> Isometry3<f64> {
    let wave = |hz: f64, shift: f64| (TAU * hz * t_s + shift).sin();
    let at = Vector3::new(0.3 + 0.9 * wave(0.17, 0.0), 0.8 * wave(0.23, 1.0), 1.5 + 0.6 * wave(0.31, 2.0));
    let turn = Vector3::new(0.5 * wave(0.21, 0.5), 0.5 * wave(0.19, 1.5), 1.5 * wave(0.11, 2.5));
    Isometry3::from_parts(at.into(), UnitQuaternion::from_scaled_axis(turn))
}

/// Squared error of the third camera's centre over what is claimed, its length, and the claim.
fn error(room: &Room, seed: u64) -> Outcome<[f64; 3]> {
    let (points, cameras, vehicle) =
        (lab::control_points(), set_up(&mut Random::new(seed, 4))?, Vehicle::paper());
    let (control, aircraft) = (lab::control_frame(&points), lab::aircraft(&vehicle));
    let films: Vec<_> = cameras.iter().enumerate().map(|(k, c)| lab::film(room, c, k, seed)).collect();
    let still = |(c, film): (&VirtualCamera, &mavsight::scene::Film<'_>)| -> Outcome<ControlStill> {
        let frame = Frame::from_rgb(c.camera.size, film.still(Some(&control)))?;
        Ok(ControlStill { camera: c.name.clone(), frame })
    };
    let stills = cameras.iter().zip(&films).map(still).collect::<Outcome<Vec<_>>>()?;
    let open_s = Sensor::default().exposure_fraction / RATE_HZ;
    let feed = |(camera, film)| {
        let (camera, film): (&VirtualCamera, &mavsight::scene::Film<'_>) = (camera, film);
        let (size, aircraft) = (camera.camera.size, &aircraft);
        let frames = (0..FRAMES).map(move |k| {
            let t_s = k as f64 / RATE_HZ;
            let rgb = film.frame(k, aircraft, |share| carried(t_s + share * open_s));
            let frame = Frame::from_rgb(size, rgb).expect("a frame of its size");
            Ok(TimedFrame { t_ns: (t_s * 1e9).round() as i64, frame })
        });
        CameraFeed::new(camera.name.clone(), None, Box::new(frames))
    };
    let flight = aircraft_of(&vehicle, cameras.iter().zip(&films).map(feed).collect())?;
    let rig = calibrate_from_stills(&stills, &points, &[flight])?;
    rig.notes().for_each(|note| println!("{note}"));
    let found = &rig.cameras[2];
    let error = found.camera.centre_in_world() - cameras[2].camera.centre_in_world();
    let solved = found.centre_cov_m2.cholesky().ok_or("a covariance that is none")?.solve(&error);
    Ok([error.dot(&solved), error.norm(), found.centre_cov_m2.trace().sqrt()])
}

fn main() -> Outcome<()> {
    let set_ups: u64 = std::env::args().nth(1).map_or(Ok(10), |word| word.parse())?;
    let room = Room::meeting_room();
    let (mut all, mut refused) = (Vec::new(), 0);
    for seed in 0..set_ups {
        match error(&room, seed) {
            Ok(found) => {
                let [square, off_m, claim_m] = found;
                println!("set-up {seed}: {:.2} mm of {:.2} mm, χ² {square:.2}", 1e3 * off_m, 1e3 * claim_m);
                all.push(found);
            }
            Err(error) => {
                refused += 1;
                println!("set-up {seed}: {error}");
            }
        }
    }
    let mean = |k: usize| all.iter().map(|e| e[k]).sum::<f64>() / all.len() as f64;
    let inside = all.iter().filter(|e| e[0] < INSIDE).count();
    println!("{} set-ups, {refused} refused", all.len());
    println!("squared error of the centre over its claim: mean {:.2} of 3, {inside} within 95 %", mean(0));
    println!(
        "mean error {:.2} mm, largest {:.2} mm",
        1e3 * mean(1),
        1e3 * all.iter().fold(0.0, |m, e| f64::max(m, e[1]))
    );
    Ok(())
}
