//! When somebody clapped, by the sound of a recording.

use super::ffmpeg;
use crate::SessionError;
use mavsight_pipeline::Clap;
use std::io::{BufReader, Read};
use std::path::Path;
use std::process::Command;

const RATE_HZ: usize = 48_000;

/// Samples of a block, a millisecond: sound goes a third of a metre in it.
const BLOCK: usize = RATE_HZ / 1000;

/// Blocks before a block whose mean loudness it rises over.
const BEFORE: usize = 20;

/// A clap and its echoes in a room last so many blocks, in which nothing else is looked for.
const ECHO: usize = 600;

/// A clap is at its loudest within so many blocks.
const ONSET: usize = 3;

/// A clap rises more than all else by this factor in amplitude, as a flash does in brightness.
const ALONE: f64 = 2.0;

/// Finds the one sudden sound of a recording that is more than twice as loud as any other, to a millisecond.
///
/// The sound is read through the ffmpeg program, at the times of its stamps, as its first differences: steps
/// and knocks of low pitch count for less than a clap.
///
/// # Errors
/// A file that is missing or that ffmpeg refuses, or no ffmpeg.
pub fn find_clap(path: &Path) -> Result<Clap, SessionError> {
    crate::error::require_file(path, "video")?;
    let mut command = Command::new(ffmpeg::program());
    command
        .args(["-v", "error", "-nostdin", "-copyts", "-i"])
        .arg(path)
        // Silence is filled in where the sound begins after time zero or has gaps.
        .args(["-map", "0:a:0", "-vn", "-ac", "1", "-af", "aresample=async=1:first_pts=0"])
        .args(["-ar", &RATE_HZ.to_string(), "-f", "s16le", "pipe:1"]);
    let ffmpeg::Process { mut child, stdout: sound, stderr: mut words } =
        ffmpeg::start(command, path, "a clap is looked for in its sound")?;
    let failed = |detail: String| SessionError::ffmpeg(path, detail);
    let said = std::thread::spawn(move || {
        let mut text = Vec::new();
        words.read_to_end(&mut text).map(|_| String::from_utf8_lossy(&text).into_owned())
    });
    let heard = loudness_of(BufReader::new(sound));
    let status = child.wait();
    let said = said.join().ok().and_then(Result::ok).unwrap_or_default();
    let loudness = heard.map_err(|e| failed(e.to_string()))?;
    if said.contains("matches no streams") {
        return Ok(Clap::Silent);
    }
    match status {
        Ok(status) if status.success() => Ok(clap_in(&loudness)),
        Ok(status) => Err(failed(format!("{status}: {}", said.trim()))),
        Err(error) => Err(failed(error.to_string())),
    }
}

/// Root mean squares of the first differences of a sound, block by block.
fn loudness_of(mut sound: impl Read) -> std::io::Result<Vec<f64>> {
    let (mut loudness, mut last) = (Vec::new(), 0.0);
    let mut bytes = [0_u8; 2 * BLOCK];
    loop {
        match sound.read_exact(&mut bytes) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(loudness),
            read => read?,
        }
        let mut squares = 0.0;
        for pair in bytes.chunks_exact(2) {
            let sample = f64::from(i16::from_le_bytes([pair[0], pair[1]]));
            squares += (sample - std::mem::replace(&mut last, sample)).powi(2);
        }
        loudness.push((squares / BLOCK as f64).sqrt());
    }
}

/// The block that rises over those before it by more than twice what any other does that is no echo of it.
fn clap_in(loudness: &[f64]) -> Clap {
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let rise = |w: &[f64]| w[BEFORE] - mean(&w[..BEFORE]);
    let rises: Vec<f64> = loudness.windows(BEFORE + 1).map(rise).collect();
    let largest = |is_wanted: &dyn Fn(&usize) -> bool| {
        (0..rises.len()).filter(is_wanted).max_by(|a, b| rises[*a].total_cmp(&rises[*b]))
    };
    let Some(loudest) = largest(&|_| true) else { return Clap::None };
    let other = largest(&|k| k.abs_diff(loudest) >= ECHO).map_or(0.0, |k| rises[k].max(0.0));
    // Sixteen bits of silence differ by one.
    if rises[loudest] <= ALONE * other.max(1.0) {
        return Clap::None;
    }
    // The first block of a clap may hold half of it, and the next be the louder.
    let mut onset = loudest.saturating_sub(ONSET)..loudest;
    let first = onset.find(|k| rises[loudest] <= ALONE * rises[*k]).unwrap_or(loudest);
    Clap::At(((first + BEFORE) as f64 + 0.5) * BLOCK as f64 / RATE_HZ as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of a room with claps that fade in 30 ms, s and amplitude of each.
    fn room(length_s: f64, claps: &[(f64, f64)]) -> Vec<u8> {
        let mut random = mavsight_random::Random::new(5, 0);
        let mut noise = || random.uniform() - 0.5;
        let count = (length_s * RATE_HZ as f64) as usize;
        let sample = |k: usize| {
            let t_s = k as f64 / RATE_HZ as f64;
            let hum = 3000.0 * (std::f64::consts::TAU * 50.0 * t_s).sin();
            let clapped = claps.iter().filter(|c| t_s >= c.0).map(|c| c.1 * (-(t_s - c.0) / 0.03).exp());
            let value = hum + noise() * (40.0 + 2.0 * clapped.sum::<f64>());
            value.clamp(-32768.0, 32767.0) as i16
        };
        (0..count).map(sample).flat_map(i16::to_le_bytes).collect()
    }

    fn heard(bytes: &[u8]) -> Clap {
        clap_in(&loudness_of(bytes).unwrap())
    }

    #[test]
    fn a_clap_is_found_to_a_millisecond_beside_hum_and_softer_sounds() {
        for at_s in [1.2345, 3.0, 0.1] {
            let Clap::At(found_s) = heard(&room(4.0, &[(at_s, 9000.0), (2.0, 3000.0)])) else {
                panic!("{at_s}: none")
            };
            assert!((found_s - at_s).abs() < 1.5e-3, "{found_s} is not {at_s}");
        }
    }

    #[test]
    fn what_does_not_stand_out_is_none() {
        assert_eq!(heard(&room(4.0, &[(1.0, 9000.0), (3.0, 6000.0)])), Clap::None);
        assert_eq!(heard(&vec![0; 200_000]), Clap::None);
        assert_eq!(heard(&[]), Clap::None);
    }
}
