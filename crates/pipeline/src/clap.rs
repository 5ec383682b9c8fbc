//! When a clap was heard: a start for clocks of which nothing else is known.

use crate::stream::Stream;
use mavsight_pose::Rig;

/// Speed of sound in a room of 20 °C.
const SOUND_M_S: f64 = 343.0;

/// A recording's sound comes between 5 ms before and 15 ms after its picture (EBU R37, 2007, at the
/// source): a width of 20 ms.
const SOUND_AND_PICTURE_S: f64 = 0.02;

/// What the sound of a recording has of a clap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Clap {
    /// By the recording's time stamps, s.
    At(f64),
    /// Nothing in its sound stands out.
    None,
    /// It has no sound.
    Silent,
}

/// Starts each clock of which no more is known from the clap that its camera and the first heard. From
/// wherever it came, it had not to go further to one camera than to the other by more than they are apart;
/// that and how far apart sound and picture of each may be are taken as evenly spread. Says what was found,
/// and what was not.
pub(crate) fn start_clocks(streams: &mut [Stream], rig: &Rig) -> Vec<String> {
    let Some((first, others)) = streams.split_first_mut() else { return Vec::new() };
    let Some(of_first) = first.clap else { return Vec::new() };
    let centre = |k: usize| rig.cameras.get(k).map(|c| c.camera.centre_in_world());
    let mut notes = Vec::new();
    for (k, stream) in others.iter_mut().enumerate().filter(|(_, s)| s.clock.offset_std_s > 0.0) {
        let (here_s, there_s) = match (of_first, stream.clap.unwrap_or(Clap::Silent)) {
            (Clap::At(here_s), Clap::At(there_s)) => (here_s, there_s),
            (here, there) => {
                let (name, what) =
                    if let Clap::At(_) = here { (&stream.name, there) } else { (&first.name, here) };
                let why = if what == Clap::Silent { "has no sound" } else { "has no clap that stands out" };
                notes.push(format!(
                    "{name} {why}: the clock of {} is estimated without. Clap once, loudly, in the middle between the cameras.",
                    stream.name
                ));
                continue;
            }
        };
        let apart_m = centre(0).zip(centre(k + 1)).map_or(0.0, |(a, b)| (a - b).norm());
        // Evenly spread over a width w is w/√12.
        let variance_s2 = ((2.0 * apart_m / SOUND_M_S).powi(2) + 2.0 * SOUND_AND_PICTURE_S.powi(2)) / 12.0;
        let std_s = variance_s2.sqrt();
        notes.extend(stream.start_clock(first, "clap", here_s, there_s, std_s));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::rig;
    use mavsight_geometry::Vector2;
    use mavsight_pose::{CameraClock, ClockPrior};

    fn heard(name: &str, clap: Clap, prior: ClockPrior) -> Stream {
        let mut stream = Stream::new(0, name.into(), prior, Vector2::y());
        stream.clap = Some(clap);
        stream
    }

    #[test]
    fn a_clap_is_where_an_unknown_clock_starts_and_a_known_one_is_kept() {
        let known = ClockPrior::known(CameraClock::default());
        let of_b = heard("b", Clap::At(2.75), ClockPrior::unknown());
        let mut streams = [heard("a", Clap::At(1.25), known), of_b, heard("c", Clap::At(9.0), known)];
        let notes = start_clocks(&mut streams, &rig());
        let b = streams[1].clock;
        // The cameras are 9 m apart: 26 ms of sound either way.
        let std_s = ((2.0 * 9.0 / 343.0_f64).powi(2) / 12.0 + 2.0 * 0.02_f64.powi(2) / 12.0).sqrt();
        assert!(
            (b.clock.offset_s - 1.5).abs() < 1e-9 && (b.offset_std_s / std_s - 1.0).abs() < 0.02,
            "{b:?}"
        );
        assert_eq!(streams[2].clock, known);
        assert!(notes.len() == 1 && notes[0].contains("puts b 1500.0 ± 17"), "{notes:?}");
    }

    #[test]
    fn who_heard_none_is_named_and_nothing_is_said_where_none_is_listened_for() {
        let known = ClockPrior::known(CameraClock::default());
        let at = |clap| [heard("a", Clap::At(1.0), known), heard("b", clap, ClockPrior::unknown())];
        for (clap, words) in [(Clap::None, "b has no clap that stands out"), (Clap::Silent, "b has no sound")]
        {
            let mut streams = at(clap);
            let notes = start_clocks(&mut streams, &rig());
            assert!(notes.len() == 1 && notes[0].starts_with(words), "{notes:?}");
            assert_eq!(streams[1].clock, ClockPrior::unknown());
        }
        let mut streams = at(Clap::At(2.0));
        streams[0].clap = Some(Clap::None);
        assert!(start_clocks(&mut streams, &rig())[0].starts_with("a has no clap"));
        streams.iter_mut().for_each(|s| s.clap = None);
        assert!(start_clocks(&mut streams, &rig()).is_empty());
    }
}
