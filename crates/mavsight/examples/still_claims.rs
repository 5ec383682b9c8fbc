//! Are cameras as good as a calibration from one still each says? The laboratory's two cameras, each set up
//! anew within a tenth of a metre, film the control frame; the squared error of a camera's centre over what
//! its covariance says has a mean of 3 where that is true.
//!
//! `cargo run --release -p mavsight --example still_claims -- 60`

use mavsight::geometry::{Camera, Vector3};
use mavsight::lab;
use mavsight::pipeline::{ControlStill, calibrate_from_stills};
use mavsight::random::Random;
use mavsight::scene::Room;
use mavsight::score::VirtualCamera;
use mavsight::vision::Frame;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Of a camera's place and of what it looks at.
const SET_UP_STD_M: f64 = 0.1;
/// The 95 % quantile of χ² of three degrees of freedom.
const INSIDE: f64 = 7.815;

/// The laboratory's cameras, a little elsewhere.
fn set_up(random: &mut Random) -> Vec<VirtualCamera> {
    let mut off = || Vector3::from_fn(|_, _| random.normal()) * SET_UP_STD_M;
    let mut cameras = lab::cameras();
    for VirtualCamera { camera, .. } in &mut cameras {
        let (centre, aim) = (camera.centre_in_world() + off(), Vector3::new(0.0, 0.0, 1.5) + off());
        *camera = Camera::looking_at(centre, aim, camera.intrinsics, camera.size);
    }
    cameras
}

/// Squared error of each camera's centre: over what is claimed, and in m² beside the claim.
fn errors(room: &Room, seed: u64) -> Outcome<Vec<[f64; 3]>> {
    let (points, cameras) = (lab::control_points(), set_up(&mut Random::new(seed, 3)));
    let control = lab::control_frame(&points);
    let still = |(index, c): (usize, &VirtualCamera)| -> Outcome<ControlStill> {
        let rgb = lab::film(room, c, index, seed).still(Some(&control));
        Ok(ControlStill { camera: c.name.clone(), frame: Frame::from_rgb(c.camera.size, rgb)? })
    };
    let stills = cameras.iter().enumerate().map(still).collect::<Outcome<Vec<_>>>()?;
    let rig = calibrate_from_stills(&stills, &points, &[])?;
    let of_camera = |(c, found): (&VirtualCamera, &mavsight::pose::RigCamera)| {
        let error = found.camera.centre_in_world() - c.camera.centre_in_world();
        let solved = found.centre_cov_m2.cholesky().ok_or("a covariance that is none")?.solve(&error);
        Ok([error.dot(&solved), error.norm_squared(), found.centre_cov_m2.trace()])
    };
    cameras.iter().zip(&rig.cameras).map(of_camera).collect()
}

fn main() -> Outcome<()> {
    let set_ups: u64 = std::env::args().nth(1).map_or(Ok(60), |word| word.parse())?;
    let room = Room::meeting_room();
    let (mut all, mut refused) = (Vec::new(), 0);
    for seed in 0..set_ups {
        eprint!("\rset-up {} of {set_ups}", seed + 1);
        match errors(&room, seed) {
            Ok(found) => all.extend(found),
            Err(error) => {
                refused += 1;
                println!("set-up {seed}: {error}");
            }
        }
    }
    eprintln!();
    let mean = |k: usize| all.iter().map(|e| e[k]).sum::<f64>() / all.len() as f64;
    let inside = all.iter().filter(|e| e[0] < INSIDE).count();
    println!("{} cameras in {} set-ups, {refused} refused", all.len(), set_ups - refused);
    println!("squared error of a centre over its claim: mean {:.2} of 3", mean(0));
    println!("inside their 95 % regions: {:.1} %", 100.0 * inside as f64 / all.len() as f64);
    println!("RMS {:.2} mm, claimed {:.2} mm", 1e3 * mean(1).sqrt(), 1e3 * mean(2).sqrt());
    Ok(())
}
