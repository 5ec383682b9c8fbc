//! The page with a flight that never was: `cargo run -p mavsight-page --example virtual [-- 127.0.0.1:8750]`.

mod flight;

use std::net::SocketAddr;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use flight::{PICTURE_PX, RATE_HZ, VirtualFlight};
use mavsight_link::Event;
use mavsight_page::{Command, Limits, Reach, Server, encode_preview};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address: SocketAddr = std::env::args().nth(1).as_deref().unwrap_or("127.0.0.1:8750").parse()?;
    let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
    let server = Server::start(address, reach, Limits::default())?;
    println!("{}", server.url());
    let mut flight = VirtualFlight::new(true);
    server.publish(&flight.scene());
    let mut recording_since = None;
    let begun = Instant::now();
    for sequence in 0_u64.. {
        let t_s = sequence as f64 / RATE_HZ;
        std::thread::sleep(Duration::from_secs_f64(t_s).saturating_sub(begun.elapsed()));
        let now_ns = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos() as i64;
        for event in flight.step(sequence, now_ns) {
            server.publish(&event);
        }
        let t_ns = (1e9 * t_s) as i64;
        for camera in 0..2 {
            if server.wants_preview(camera, t_ns) {
                let jpeg = encode_preview(PICTURE_PX.0, PICTURE_PX.1, flight.picture(camera, t_s))?;
                server.preview(camera as u8, t_ns, &jpeg);
            }
        }
        while let Some(command) = server.next_command(Duration::ZERO) {
            match command {
                Command::StartRecording => recording_since = Some(t_s),
                Command::StopRecording => recording_since = None,
                Command::Calibrate | Command::SelfCheck => {}
            }
            server.publish(&Event::Note {
                t_s,
                fault: false,
                text: format!("{command:?} carried out (virtually)."),
            });
            server.publish(&recording(recording_since, t_s));
        }
        if recording_since.is_some() && sequence.is_multiple_of(30) {
            server.publish(&recording(recording_since, t_s));
        }
    }
    Ok(())
}

fn recording(since_s: Option<f64>, t_s: f64) -> Event {
    let seconds = since_s.map_or(0.0, |since_s| t_s - since_s);
    Event::Recording {
        folder: since_s.map(|_| "recording-virtual".to_owned()),
        seconds,
        bytes: (seconds * 2.1e6) as u64,
        fault: None,
    }
}
