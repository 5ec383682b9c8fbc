//! MP4 with H.264, decoded in this process.

use super::Opened;
use super::color::YuvCoding;
use super::mp4_guard::{Forward, overclaim};
use super::mp4_times::{Sample, samples};
use crate::SessionError;
use mavsight_geometry::ImageSize;
use mavsight_vision::Frame;
use re_mp4::{Avc1Box, Mp4, StsdBoxContent, TrackKind};
use rusty_h264::{DecodeError, Decoder};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

pub(crate) enum Failure {
    /// It is sound, but the built-in decoder does not read it; and why.
    Unsupported(String),
    /// It is damaged.
    Fatal(SessionError),
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        Self::Fatal(error)
    }
}

/// Opens an MP4 file and decodes its first picture, so that what cannot be decoded is known at once.
///
/// Only the sample being decoded is in memory.
pub(crate) fn open(path: &Path) -> Result<Opened, Failure> {
    let damaged = |detail: &str| {
        let remedy = "it may have been cut off while copied or recorded; copy it again";
        SessionError::file(path, format!("not a whole MP4 file ({detail}): {remedy}"))
    };
    let file = File::open(path).map_err(|e| SessionError::io(path, "open it", e))?;
    let length = file.metadata().map_err(|e| SessionError::io(path, "measure it", e))?.len();
    let mut reader = BufReader::new(file);
    let unread = |e| SessionError::io(path, "read it", e);
    let announced = announced_length(&mut reader, length).map_err(unread)?;
    if let Some(detail) = overclaim(&mut reader, (0, length), length).map_err(unread)? {
        return Err(damaged(&detail).into());
    }
    reader.rewind().map_err(unread)?;
    let mut forward = Forward::new(&mut reader).map_err(unread)?;
    // The parser indexes tables unchecked: a panic is a damaged file.
    let mp4 = catch_unwind(AssertUnwindSafe(|| Mp4::read(&mut forward, announced)))
        .map_err(|_| damaged("its tables contradict each other"))?
        .map_err(|e| damaged(&e.to_string()))?;
    let Some(track) = mp4.tracks().values().find(|t| t.kind == Some(TrackKind::Video)) else {
        let is_other = mp4.tracks().values().any(|t| t.kind.is_none());
        let has_sound = mp4.tracks().values().any(|t| t.kind == Some(TrackKind::Audio));
        let empty = if has_sound {
            SessionError::SoundAlone(path.to_owned())
        } else {
            SessionError::NoFrames(path.to_owned())
        };
        return Err(if is_other {
            Failure::Unsupported("its codec is not H.264".into())
        } else {
            empty.into()
        });
    };
    let StsdBoxContent::Avc1(avc1) = &track.trak(&mp4).mdia.minf.stbl.stsd.contents else {
        let codec = track.codec_string(&mp4).unwrap_or_else(|| "unknown".into());
        return Err(Failure::Unsupported(format!("its codec is {codec}, not H.264")));
    };
    if track.samples.is_empty() {
        return Err(SessionError::NoFrames(path.to_owned()).into());
    }
    let samples = samples(&mp4, track).map_err(|reason| Failure::Unsupported(reason.to_owned()))?;
    // What lies beyond the end was cut off: what comes before is read, and the count of frames shows it.
    let is_there = |s: &Sample| s.offset.saturating_add(s.size) <= length;
    let whole: Vec<Sample> = samples.iter().copied().take_while(is_there).collect();
    if whole.is_empty() {
        return Err(damaged(&format!("all of its {} samples lie beyond the end", samples.len())).into());
    }
    let declared = samples.iter().filter(|s| s.shown).count();
    let m = &track.trak(&mp4).tkhd.matrix;
    let quarters = quarters([m.a, m.b, m.c, m.d]);
    let mut frames = Mp4Frames::new(path, reader, avc1, whole);
    frames.decode_next()?;
    let (size, declared) = (frames.size, Some(declared));
    let is_reordered = Some(frames.ranks.iter().enumerate().any(|(place, rank)| place != *rank));
    Ok(Opened { size, declared, declared_s: None, quarters, is_reordered, frames: Box::new(frames) })
}

/// Length of the file before the media data at its end were cut off: where that box says that it ends, or the
/// file's own length. The reader is left at its start.
fn announced_length(reader: &mut BufReader<File>, length: u64) -> std::io::Result<u64> {
    let (mut at, mut announced) = (0_u64, length);
    let mut header = [0u8; 16];
    while at.saturating_add(16) <= length {
        reader.seek(SeekFrom::Start(at))?;
        reader.read_exact(&mut header)?;
        let [a, b, c, d, kind @ ..] = &header[..8] else { break };
        let size = match u32::from_be_bytes([*a, *b, *c, *d]) {
            0 => break,
            1 => header[8..].iter().fold(0, |sum, byte| (sum << 8) | u64::from(*byte)),
            size => u64::from(size),
        };
        let Some(end) = at.checked_add(size.max(8)) else { break };
        if end > length && kind == b"mdat" {
            announced = end;
        }
        at = end;
    }
    reader.seek(SeekFrom::Start(0))?;
    Ok(announced)
}

/// Quarters clockwise of a display matrix (ISO/IEC 14496-12, 6.2.2), 16.16 fixed point, a b c d.
fn quarters(matrix: [i32; 4]) -> u8 {
    match matrix.map(i32::signum) {
        [0, 1, -1, 0] => 1,
        [-1, 0, 0, -1] => 2,
        [0, -1, 1, 0] => 3,
        _ => 0,
    }
}

struct Mp4Frames {
    path: PathBuf,
    reader: BufReader<File>,
    decoder: Decoder,
    samples: Vec<Sample>,
    /// Place of each sample in order of time.
    ranks: Vec<usize>,
    /// Pictures that wait for earlier ones, with their samples, by rank.
    waiting: BTreeMap<usize, (Sample, Frame)>,
    /// By rank: whether a picture cannot be had.
    lost: Vec<bool>,
    next_sample: usize,
    next_rank: usize,
    /// Where decoding begins, with a new decoder: the first sample, or a key picture behind a damaged one.
    fresh_at: usize,
    length_bytes: usize,
    parameter_sets: Vec<u8>,
    coding: YuvCoding,
    size: ImageSize,
}

const START_CODE: [u8; 4] = [0, 0, 0, 1];

impl Mp4Frames {
    fn new(path: &Path, reader: BufReader<File>, avc1: &Avc1Box, samples: Vec<Sample>) -> Self {
        let avcc = &avc1.avcc.contents;
        let mut parameter_sets = Vec::new();
        for unit in avcc.sequence_parameter_sets.iter().chain(&avcc.picture_parameter_sets) {
            parameter_sets.extend_from_slice(&START_CODE);
            parameter_sets.extend_from_slice(&unit.bytes);
        }
        let coding = avcc
            .sequence_parameter_sets
            .first()
            .map_or_else(YuvCoding::default, |s| YuvCoding::from_sps(&s.bytes));
        let mut order: Vec<usize> = (0..samples.len()).collect();
        order.sort_by_key(|&i| (samples[i].t_ns, i));
        let mut ranks = vec![0; samples.len()];
        for (rank, &sample) in order.iter().enumerate() {
            ranks[sample] = rank;
        }
        Self {
            path: path.to_owned(),
            reader,
            decoder: Decoder::new(),
            lost: vec![false; samples.len()],
            samples,
            ranks,
            fresh_at: 0,
            waiting: BTreeMap::new(),
            next_sample: 0,
            next_rank: 0,
            length_bytes: usize::from(avcc.length_size_minus_one & 3) + 1,
            parameter_sets,
            coding,
            size: ImageSize { width_px: avc1.width.into(), height_px: avc1.height.into() },
        }
    }

    fn damaged(&self, sample: usize, detail: impl std::fmt::Display) -> SessionError {
        SessionError::frame(&self.path, self.ranks[sample], detail)
    }

    /// The sample as an Annex B byte stream, with the parameter sets before the first.
    fn annex_b(&mut self, index: usize) -> Result<Vec<u8>, SessionError> {
        let Sample { offset, size, .. } = self.samples[index];
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(0)];
        self.reader
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.reader.read_exact(&mut bytes))
            .map_err(|e| self.damaged(index, e))?;
        let mut stream = if index == self.fresh_at { self.parameter_sets.clone() } else { Vec::new() };
        stream.reserve(bytes.len() + 64);
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            let unit = rest.split_at_checked(self.length_bytes).and_then(|(length, after)| {
                let length = length.iter().fold(0usize, |n, b| (n << 8) | usize::from(*b));
                after.split_at_checked(length)
            });
            let Some((unit, after)) = unit else {
                return Err(self.damaged(index, "a NAL unit is longer than its sample"));
            };
            stream.extend_from_slice(&START_CODE);
            stream.extend_from_slice(unit);
            rest = after;
        }
        Ok(stream)
    }

    /// Decodes the next sample and puts its picture among the waiting ones.
    fn decode_next(&mut self) -> Result<(), Failure> {
        let index = self.next_sample;
        self.next_sample += 1;
        let stream = self.annex_b(index)?;
        let decoder = &mut self.decoder;
        let picture = catch_unwind(AssertUnwindSafe(|| decoder.decode(&stream)))
            .map_err(|_| self.damaged(index, "the decoder broke down on it"))?;
        let picture = match picture {
            Ok(Some(picture)) => picture,
            Ok(None) => return Err(self.damaged(index, "it holds no whole picture").into()),
            Err(DecodeError::Unsupported(what)) if index == 0 => {
                return Err(Failure::Unsupported(format!("its H.264 uses {what}")));
            }
            Err(error) => return Err(self.damaged(index, error).into()),
        };
        let side = |length: usize| u32::try_from(length).unwrap_or(0);
        let size = ImageSize { width_px: side(picture.width), height_px: side(picture.height) };
        if index == 0 && self.fresh_at == 0 {
            self.size = size;
        } else if size != self.size {
            let detail = format!("the size changes to {}×{}", picture.width, picture.height);
            return Err(self.damaged(index, detail).into());
        }
        let planes = [picture.y, picture.u, picture.v];
        let frame = Frame::from_yuv420(size, planes, self.coding.full_range, self.coding.matrix)
            .map_err(|e| self.damaged(index, e))?;
        self.waiting.insert(self.ranks[index], (self.samples[index], frame));
        Ok(())
    }

    /// Goes on at the key picture after a damaged sample: pictures between build on it and are lost.
    fn resume(&mut self) {
        let damaged = self.next_sample - 1;
        let next = (self.next_sample..self.samples.len()).find(|k| self.samples[*k].is_key);
        self.next_sample = next.unwrap_or(self.samples.len());
        self.fresh_at = self.next_sample;
        self.decoder = Decoder::new();
        for k in damaged..self.next_sample {
            self.lost[self.ranks[k]] = true;
        }
    }
}

impl Iterator for Mp4Frames {
    type Item = Result<(i64, Frame), SessionError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            while self.lost.get(self.next_rank) == Some(&true) {
                self.next_rank += 1;
            }
            // At the end some of the pictures that wait have no more to wait for: others were cut off.
            let is_end = self.next_sample >= self.samples.len();
            let is_next = self.waiting.keys().next() == Some(&self.next_rank);
            if is_next || is_end {
                let (rank, (sample, frame)) = self.waiting.pop_first()?;
                self.next_rank = rank + 1;
                if sample.shown {
                    return Some(Ok((sample.t_ns, frame)));
                }
                continue;
            }
            let error = match self.decode_next() {
                Ok(()) => continue,
                Err(Failure::Fatal(error)) => error,
                Err(Failure::Unsupported(detail)) => self.damaged(self.next_sample - 1, detail),
            };
            self.resume();
            return Some(Err(error));
        }
    }
}
