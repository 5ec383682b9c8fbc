//! Writes a still and a frame of one camera: `cargo run --release -p mavsight-scene --example room --
//! FOLDER`.

use mavsight_geometry::{Camera, EulerAngles, ImageSize, Intrinsics, world_from_body};
use mavsight_scene::{Aircraft, ControlFrame, Film, PaintedBall, Room, Sensor};
use nalgebra::Vector3;

fn ball(centre: [f64; 3], radius_m: f64, linear: [f64; 3]) -> PaintedBall {
    PaintedBall { centre_m: Vector3::from(centre), radius_m, linear }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).ok_or("give a folder")?);
    let size = ImageSize { width_px: 640, height_px: 480 };
    let intrinsics = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
    let camera =
        Camera::looking_at(Vector3::new(4.5, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), intrinsics, size);
    let room = Room::meeting_room();
    let began = std::time::Instant::now();
    let film = Film::new(&room, camera, Sensor::default());
    println!("room: {:?}", began.elapsed());
    let colors = [[0.7, 0.02, 0.02], [0.02, 0.4, 0.03], [0.02, 0.04, 0.6], [0.8, 0.55, 0.01]];
    let places = [[0.225, 0.225], [0.225, -0.225], [-0.225, -0.225], [-0.225, 0.225]];
    let balls: Vec<PaintedBall> =
        places.iter().zip(colors).map(|(p, c)| ball([p[0], p[1], 0.1], 0.025, c)).collect();
    let aircraft = Aircraft::helicopter(&balls);
    let pose =
        world_from_body(Vector3::new(0.0, 0.0, 1.5), EulerAngles { psi_rad: -0.39, ..Default::default() });
    let began = std::time::Instant::now();
    let frame = film.frame(0, &aircraft, |_| pose);
    println!("frame: {:?}", began.elapsed());
    let corners: Vec<PaintedBall> = (0..8)
        .map(|k| {
            let x = if k & 1 == 0 { -1.5 } else { 1.5 };
            let y = if k & 2 == 0 { -1.5 } else { 1.5 };
            ball([x, y, if k & 4 == 0 { 0.0 } else { 3.0 }], 0.03, colors[k % 4])
        })
        .collect();
    let began = std::time::Instant::now();
    let still = film.still(Some(&ControlFrame::new(&corners)));
    println!("still: {:?}", began.elapsed());
    for (name, rgb) in [("frame.png", frame), ("still.png", still)] {
        image::save_buffer(folder.join(name), &rgb, size.width_px, size.height_px, image::ColorType::Rgb8)?;
    }
    Ok(())
}
