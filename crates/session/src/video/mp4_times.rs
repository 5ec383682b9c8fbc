//! Presentation times of an MP4 track, edit list included.

use re_mp4::{Mp4, Track};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) offset: u64,
    pub(crate) size: u64,
    pub(crate) t_ns: i64,
    /// Whether the edit list shows it.
    pub(crate) shown: bool,
    /// Whether it builds on no other.
    pub(crate) is_key: bool,
}

/// The samples with their times: composition time less the edit's start, plus any empty edit before it, as
/// ffmpeg takes them. `Err` says why the track needs another reader.
pub(crate) fn samples(mp4: &Mp4, track: &Track) -> Result<Vec<Sample>, &'static str> {
    let trak = track.trak(mp4);
    let timescale = i128::from(track.timescale);
    let movie_timescale = i128::from(mp4.moov.mvhd.timescale);
    if timescale == 0 || movie_timescale == 0 {
        return Err("its time scale is zero");
    }
    let shift = i128::from(composition_shift(mp4, track));
    let entries = trak.edts.as_ref().and_then(|e| e.elst.as_ref()).map_or(&[][..], |e| &e.entries[..]);
    let mut delay_ns = 0;
    let mut edit = None;
    for entry in entries {
        if entry.media_time == u64::from(u32::MAX) || entry.media_time == u64::MAX {
            delay_ns += i128::from(entry.segment_duration) * 1_000_000_000 / movie_timescale;
        } else if edit.replace((i128::from(entry.media_time), i128::from(entry.segment_duration))).is_some() {
            return Err("its edit list has several parts");
        }
    }
    let (start, duration) = edit.unwrap_or((0, 0));
    let ns = |ticks: i128| {
        let numerator = ticks * 1_000_000_000;
        (numerator + timescale / 2).div_euclid(timescale)
    };
    Ok(track
        .samples
        .iter()
        .map(|sample| {
            let ticks = i128::from(sample.composition_timestamp) + shift - start;
            // The edit's length is rounded to the movie's coarser ticks: one of them is allowed.
            let over = duration > 0 && ticks * movie_timescale >= (duration + 1) * timescale;
            Sample {
                offset: sample.offset,
                size: sample.size,
                t_ns: i64::try_from(ns(ticks) + delay_ns).unwrap_or(i64::MAX),
                shown: ticks >= 0 && !over,
                is_key: sample.is_sync,
            }
        })
        .collect())
}

/// What re_mp4 took off the composition times to let the first one be zero: undone, since the edit list
/// counts from the file's own zero. The first decoding time is zero in the file.
fn composition_shift(mp4: &Mp4, track: &Track) -> i64 {
    if !mp4.moofs.is_empty() {
        return 0;
    }
    let Some(first) = track.samples.first() else { return 0 };
    let ctts = track.trak(mp4).mdia.minf.stbl.ctts.as_ref();
    let lowest = ctts.and_then(|c| c.entries.iter().map(|e| i64::from(e.sample_offset)).min()).unwrap_or(0);
    -first.decode_timestamp - (-lowest).max(0)
}
