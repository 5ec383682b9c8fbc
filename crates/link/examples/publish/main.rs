//! Flies a circle through every outlet of a file, for trying clients without cameras:
//!
//!     cargo run -p mavsight-link --example publish -- outlets.toml 60
//!
//! `outlets.toml` has the sections of `[live]`: `[mavlink]`, `[natnet]`, `[vrpn]`, `[json]`, `[zenoh]`.

mod circle;

use mavsight_link::{Body, LinkOptions, open};
use std::error::Error;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, seconds, rest @ ..] = &words[..] else {
        return Err("publish OUTLETS.toml SECONDS [RATE_HZ]".into());
    };
    let rate_hz: f64 = rest.first().map_or(Ok(60.0), |text| text.parse())?;
    let seconds: f64 = seconds.parse()?;
    let options: LinkOptions = toml::from_str(&std::fs::read_to_string(file)?)?;
    let mut outlets = open(&options, &Body::new("circle", circle::markers()))?;
    for outlet in &mut outlets {
        println!("{} is open", outlet.name());
        outlet.event(&circle::scene())?;
    }
    let begun = Instant::now();
    for sequence in 0..(seconds * rate_hz) as u64 {
        let due = Duration::from_secs_f64(sequence as f64 / rate_hz);
        std::thread::sleep(due.saturating_sub(begun.elapsed()));
        let fix = circle::fix(sequence, circle::now_ns());
        let event = circle::event(&fix);
        for outlet in &mut outlets {
            if let Err(fault) = outlet.send(&fix).and_then(|()| outlet.event(&event)) {
                eprintln!("{fault}");
            }
        }
    }
    Ok(())
}
