//! Videos for people: MP4 with H.264, encoded in-process.

use crate::SessionError;
use crate::files::PartFile;
use mavsight_geometry::ImageSize;
use mavsight_vision::{Frame, Pixels, YuvMatrix};
use rusty_h264::{Encoder, EncoderConfig, Preset, YuvPlanes};
use shiguredo_mp4::boxes::{Avc1Box, AvccBox, SampleEntry, UnknownBox, VisualSampleEntryFields};
use shiguredo_mp4::mux::{Mp4FileMuxer, Sample};
use shiguredo_mp4::{BoxSize, BoxType, TrackKind, Uint};
use std::io::{Seek, SeekFrom, Write};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

/// Quantization of H.264 at which thin lines are still sharp.
const QUANTIZER: u8 = 20;
/// Frames from one that stands by itself to the next: where a player can jump to.
const KEYFRAMES: u32 = 30;
/// Ticks a second: microseconds.
const TIMESCALE: NonZeroU32 = NonZeroU32::new(1_000_000).expect("above zero");
/// How long the only frame of a video is shown.
const ALONE_NS: i64 = 1_000_000_000;

/// A video that is written frame by frame, each at its own time; the file is there when it is whole, and nothing where it was
/// dropped before.
pub struct VideoWriter {
    path: PathBuf,
    file: PartFile,
    out: std::fs::File,
    encoder: Encoder,
    muxer: Mp4FileMuxer,
    size: ImageSize,
    matrix: YuvMatrix,
    at: u64,
    /// The frame whose duration the next one gives: time, place, and whether it stands by itself.
    last: Option<(i64, Coded)>,
    interval_ns: i64,
}

/// A frame that is in the file, but not yet in its index.
struct Coded {
    entry: Option<SampleEntry>,
    offset: u64,
    bytes: usize,
    is_key: bool,
}

impl VideoWriter {
    /// A video of frames of one size, both sides even, at most 65534 px.
    ///
    /// # Errors
    /// A name that does not end in `.mp4`, a size that cannot be encoded, and what the file system refuses.
    pub fn create(path: &Path, size: ImageSize) -> Result<Self, SessionError> {
        if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("mp4")) {
            return Err(SessionError::express(path, "write it", "a video is written as .mp4"));
        }
        let ImageSize { width_px, height_px } = size;
        let is_even = |side: u32| side > 0 && side.is_multiple_of(2) && side < 1 << 16;
        if !is_even(width_px) || !is_even(height_px) {
            let reason = format!("no video has {width_px}×{height_px} px: both must be even and below 65536");
            return Err(SessionError::express(path, "write it", reason));
        }
        let mut config = EncoderConfig::baseline(width_px as usize, height_px as usize);
        (config.qp, config.gop_size, config.preset) = (QUANTIZER, KEYFRAMES, Preset::Fast);
        let refused = |e: &dyn std::fmt::Debug| SessionError::express(path, "write it", format!("{e:?}"));
        let encoder = Encoder::new(config).map_err(|e| refused(&e))?;
        let muxer = Mp4FileMuxer::new().map_err(|e| refused(&e))?;
        let head = muxer.initial_boxes_bytes();
        let file = PartFile::write(path, |out| out.write_all(head))?;
        let at = head.len() as u64;
        let out = file.append().map_err(|e| SessionError::io(path, "write it", e))?;
        // What players take for the matrix of a video that names none.
        let matrix = if height_px >= 720 { YuvMatrix::Bt709 } else { YuvMatrix::Bt601 };
        let (path, last) = (path.to_owned(), None);
        Ok(Self { path, file, out, encoder, muxer, size, matrix, at, last, interval_ns: ALONE_NS })
    }

    /// Adds a frame that is shown from a time on; times rise.
    ///
    /// # Errors
    /// A frame of another size, and what the file system refuses.
    pub fn push(&mut self, t_ns: i64, frame: &Frame) -> Result<(), SessionError> {
        if let Some((before_ns, coded)) = self.last.take() {
            self.interval_ns = (t_ns - before_ns).max(1000);
            self.index(coded)?;
        }
        let coded = self.encode(frame)?;
        self.last = Some((t_ns, coded));
        Ok(())
    }

    /// Ends the video; its last frame is shown as long as the one before it.
    ///
    /// # Errors
    /// A video without frames, and what the file system refuses.
    pub fn finish(mut self) -> Result<(), SessionError> {
        let (_, last) = self.last.take().ok_or_else(|| SessionError::NoFrames(self.path.clone()))?;
        self.index(last)?;
        let Self { path, file, mut out, mut muxer, .. } = self;
        let boxes =
            muxer.finalize().map_err(|e| SessionError::express(&path, "write it", format!("{e:?}")))?;
        let mut put = |offset: u64, bytes: &[u8]| {
            out.seek(SeekFrom::Start(offset))?;
            out.write_all(bytes)
        };
        for (offset, bytes) in boxes.offset_and_bytes_pairs() {
            put(offset, bytes).map_err(|e| SessionError::io(&path, "write it", e))?;
        }
        file.keep()
    }

    fn encode(&mut self, frame: &Frame) -> Result<Coded, SessionError> {
        let refused = |what: String| SessionError::express(&self.path, "write it", what);
        if frame.size != self.size {
            return Err(refused("a frame has another size than the video".into()));
        }
        let coded = frame.to_yuv420(self.matrix);
        let Pixels::Yuv420 { y, u, v, .. } = &coded.pixels else {
            return Err(refused("a frame cannot be encoded".into()));
        };
        let (width, height) = (self.size.width_px as usize, self.size.height_px as usize);
        let planes = YuvPlanes { width, height, y, u, v, stride_y: width, stride_c: width / 2 };
        let stream = self.encoder.encode_planes(&planes).map_err(|e| refused(format!("{e:?}")))?;
        let units: Vec<&[u8]> = units(&stream).collect();
        let of_kind = |kind: u8| units.iter().filter(move |u| u[0] & 31 == kind).map(|u| u.to_vec());
        let (sps, pps): (Vec<_>, Vec<_>) = (of_kind(7).collect(), of_kind(8).collect());
        let entry = (!sps.is_empty() && self.at == self.muxer.initial_boxes_bytes().len() as u64)
            .then(|| entry(self.size, sps, pps, self.matrix));
        let is_key = of_kind(5).next().is_some();
        let mut bytes = Vec::with_capacity(stream.len());
        for unit in units.iter().filter(|u| !matches!(u[0] & 31, 7 | 8)) {
            bytes.extend_from_slice(&(unit.len() as u32).to_be_bytes());
            bytes.extend_from_slice(unit);
        }
        self.out.write_all(&bytes).map_err(|e| SessionError::io(&self.path, "write it", e))?;
        let offset = self.at;
        self.at += bytes.len() as u64;
        Ok(Coded { entry, offset, bytes: bytes.len(), is_key })
    }

    fn index(&mut self, coded: Coded) -> Result<(), SessionError> {
        let sample = Sample {
            track_kind: TrackKind::Video,
            sample_entry: coded.entry,
            keyframe: coded.is_key,
            timescale: TIMESCALE,
            duration: u32::try_from(self.interval_ns / 1000).unwrap_or(u32::MAX),
            composition_time_offset: None,
            data_offset: coded.offset,
            data_size: coded.bytes,
        };
        let refused =
            |e: &dyn std::fmt::Debug| SessionError::express(&self.path, "write it", format!("{e:?}"));
        self.muxer.append_sample(&sample).map_err(|e| refused(&e))
    }
}

/// What the index says of the coded frames: size, parameter sets, and the colours' primaries, curve and matrix (ISO/IEC
/// 23091-2: 1 of BT.709, 6 of BT.601, 13 the curve of sRGB).
fn entry(size: ImageSize, sps: Vec<Vec<u8>>, pps: Vec<Vec<u8>>, matrix: YuvMatrix) -> SampleEntry {
    let matrix = if matrix == YuvMatrix::Bt709 { 1 } else { 6 };
    let mut colours = b"nclx".to_vec();
    for value in [1_u16, 13, matrix] {
        colours.extend_from_slice(&value.to_be_bytes());
    }
    colours.push(0);
    let colours = UnknownBox {
        box_type: BoxType::Normal(*b"colr"),
        box_size: BoxSize::U32(8 + colours.len() as u32),
        payload: colours,
    };
    let profile = |k: usize| sps.first().and_then(|s| s.get(k)).copied().unwrap_or_default();
    SampleEntry::Avc1(Avc1Box {
        visual: VisualSampleEntryFields {
            data_reference_index: VisualSampleEntryFields::DEFAULT_DATA_REFERENCE_INDEX,
            width: size.width_px as u16,
            height: size.height_px as u16,
            horizresolution: VisualSampleEntryFields::DEFAULT_HORIZRESOLUTION,
            vertresolution: VisualSampleEntryFields::DEFAULT_VERTRESOLUTION,
            frame_count: VisualSampleEntryFields::DEFAULT_FRAME_COUNT,
            compressorname: VisualSampleEntryFields::NULL_COMPRESSORNAME,
            depth: VisualSampleEntryFields::DEFAULT_DEPTH,
        },
        avcc_box: AvccBox {
            avc_profile_indication: profile(1),
            profile_compatibility: profile(2),
            avc_level_indication: profile(3),
            length_size_minus_one: Uint::new(3),
            sps_list: sps,
            pps_list: pps,
            chroma_format: None,
            bit_depth_luma_minus8: None,
            bit_depth_chroma_minus8: None,
            sps_ext_list: Vec::new(),
        },
        unknown_boxes: vec![colours],
    })
}

/// The units of a stream in which each begins behind 0, 0, 1 (H.264, annex B).
fn units(stream: &[u8]) -> impl Iterator<Item = &[u8]> {
    let starts: Vec<usize> = (0..stream.len().saturating_sub(2))
        .filter(|k| stream[*k..*k + 3] == [0, 0, 1])
        .chain([stream.len()])
        .collect();
    let pairs = starts.windows(2).map(|pair| (pair[0] + 3, pair[1])).collect::<Vec<_>>();
    pairs.into_iter().filter_map(|(from, to)| {
        let unit = &stream[from..to];
        let end = unit.iter().rposition(|byte| *byte != 0)?;
        Some(&unit[..=end])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameSource;

    #[test]
    fn frames_come_back_at_their_times_with_their_colours() {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("film.mp4");
        let size = ImageSize { width_px: 64, height_px: 48 };
        let colours = [[200, 30, 40], [30, 180, 60], [50, 60, 210], [240, 240, 240]];
        let times_ns = [500_000_000_i64, 533_000_000, 600_000_000, 633_000_000];
        let mut film = VideoWriter::create(&path, size).expect("begun");
        for (t_ns, rgb) in times_ns.iter().zip(colours) {
            assert!(!path.exists(), "half a video is at its place");
            film.push(*t_ns, &Frame::from_rgb(size, rgb.repeat(size.area_px())).expect("a frame"))
                .expect("added");
        }
        film.finish().expect("whole");
        let read: Vec<_> = FrameSource::open(&path, None)
            .expect("opened")
            .collect::<Result<Vec<_>, _>>()
            .expect("all frames");
        assert_eq!(read.len(), 4);
        for (k, (t_ns, frame)) in read.iter().enumerate() {
            assert!((t_ns - read[0].0 - (times_ns[k] - times_ns[0])).abs() < 2000, "{k}: {t_ns}");
            let seen = frame.rgb(31, 20);
            assert!((0..3).all(|c| seen[c].abs_diff(colours[k][c]) < 8), "{k}: {seen:?} of {:?}", colours[k]);
        }
    }

    #[test]
    fn what_cannot_be_a_video_is_refused_and_leaves_nothing() {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("film.mp4");
        let size = |width_px: u32| ImageSize { width_px, height_px: 48 };
        assert!(VideoWriter::create(&folder.path().join("film.mkv"), size(64)).is_err());
        assert!(
            VideoWriter::create(&path, size(63)).is_err() && VideoWriter::create(&path, size(0)).is_err()
        );
        let mut film = VideoWriter::create(&path, size(64)).expect("begun");
        assert!(film.push(0, &Frame::from_rgb(size(32), vec![0; 3 * 32 * 48]).expect("a frame")).is_err());
        assert!(matches!(film.finish(), Err(SessionError::NoFrames(_))));
        assert_eq!(std::fs::read_dir(folder.path()).expect("read").count(), 0);
    }
}
