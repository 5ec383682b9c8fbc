//! Frame sources: both video paths agree, time stamps come from the container, damaged recordings are
//! refused.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Folder, data, ffmpeg, fixture};
use mavsight_pipeline::Clap;
use mavsight_session::{FrameSource, SessionError, find_clap, read_image, write_png};
use mavsight_vision::{Frame, Pixels, YuvMatrix};
use std::path::Path;

fn read(path: &Path) -> Result<Vec<(i64, Frame)>, SessionError> {
    FrameSource::open(path, None)?.collect()
}

fn refusal(path: &Path) -> String {
    read(path).unwrap_err().to_string()
}

fn same_frames(path: &Path) -> usize {
    let ours = FrameSource::open(path, None).unwrap();
    let theirs = FrameSource::open_with_ffmpeg(path, "ffmpeg").unwrap();
    assert_eq!(ours.size(), theirs.size());
    let (mut ours, mut theirs) = (ours, theirs);
    let mut count = 0;
    loop {
        match (ours.next(), theirs.next()) {
            (None, None) => return count,
            (Some(a), Some(b)) => {
                let ((t, frame), (wanted_t, wanted)) = (a.unwrap(), b.unwrap());
                assert_eq!(t, wanted_t, "time of frame {count}");
                assert!(frame == wanted, "frame {count} differs");
                count += 1;
            }
            (a, b) => panic!("after {count} frames: ours {}, ffmpeg's {}", a.is_some(), b.is_some()),
        }
    }
}

#[test]
fn paper_flight_is_the_same_by_both_paths() {
    let Some(flight) = data("paper-flight") else { return };
    if !ffmpeg() {
        return;
    }
    for name in ["cam1.mp4", "cam2.mp4"] {
        assert_eq!(same_frames(&flight.join(name)), 300, "{name}");
    }
}

#[test]
fn paper_flight_has_its_time_stamps() {
    let Some(flight) = data("paper-flight") else { return };
    let source = FrameSource::open(&flight.join("cam1.mp4"), None).unwrap();
    assert_eq!(source.declared_frames(), Some(300));
    let mut count = 0;
    for (k, item) in source.enumerate() {
        let (t_ns, frame) = item.unwrap();
        assert!((t_ns as f64 * 1e-9 - k as f64 / 30.0).abs() < 1e-9, "frame {k} at {t_ns} ns");
        assert!(matches!(frame.pixels, Pixels::Yuv420 { full_range: false, matrix: YuvMatrix::Bt709, .. }));
        count += 1;
    }
    assert_eq!(count, 300);
}

#[test]
fn reordered_frames_come_in_order_of_time() {
    let frames = read(&fixture()).unwrap();
    assert_eq!(frames.len(), 24);
    for (k, (t_ns, frame)) in frames.iter().enumerate() {
        assert!((*t_ns as f64 * 1e-9 - k as f64 / 30.0).abs() < 1e-9, "frame {k} at {t_ns} ns");
        assert_eq!((frame.size.width_px, frame.size.height_px), (160, 120));
    }
}

/// Cut, delayed, full-range and differently packed files, as ffmpeg makes and reads them.
#[test]
fn odd_files_are_the_same_by_both_paths() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let cases: [(&str, &[&str]); 5] = [
        ("cut.mp4", &["-ss", "0.2", "-i", "FIXTURE", "-c", "copy"]),
        ("late.mp4", &["-itsoffset", "0.25", "-i", "FIXTURE", "-c", "copy"]),
        (
            "full.mp4",
            &["-i", "FIXTURE", "-vf", "scale=out_range=full", "-pix_fmt", "yuvj420p", "-c:v", "libx264"],
        ),
        ("fragments.mp4", &["-i", "FIXTURE", "-c", "copy", "-movflags", "frag_keyframe+empty_moov"]),
        ("moov-first.mov", &["-i", "FIXTURE", "-c", "copy", "-movflags", "faststart"]),
    ];
    for (name, arguments) in cases {
        let fixture = fixture();
        let arguments =
            arguments.iter().map(|a| if *a == "FIXTURE" { fixture.as_os_str() } else { a.as_ref() });
        let made = std::process::Command::new("ffmpeg")
            .args(["-v", "error", "-y"])
            .args(arguments)
            .arg(folder.path(name))
            .status()
            .unwrap();
        assert!(made.success(), "{name}");
        let count = same_frames(&folder.path(name));
        assert!(count >= 17, "{name}: {count} frames");
    }
}

#[test]
fn another_container_goes_through_ffmpeg() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let made = std::process::Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(fixture())
        .args(["-c", "copy"])
        .arg(folder.path("clip.mkv"))
        .status()
        .unwrap();
    assert!(made.success());
    let frames = read(&folder.path("clip.mkv")).unwrap();
    let wanted = read(&fixture()).unwrap();
    assert_eq!(frames.len(), wanted.len());
    for ((t, frame), (wanted_t, wanted)) in frames.iter().zip(&wanted) {
        assert!((t - wanted_t).abs() < 1_000_000, "Matroska counts milliseconds");
        assert!(frame == wanted);
    }
}

/// Two seconds of quiet at 44.1 kHz with a click that fades in 5 ms, as a WAV file.
fn click(at_s: f64) -> Vec<u8> {
    let rate = 44_100_u32;
    let sample = |k: u32| {
        let t_s = f64::from(k) / f64::from(rate) - at_s;
        let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        if t_s < 0.0 { 0 } else { (sign * 20_000.0 * (-t_s / 0.005).exp()) as i16 }
    };
    let sound: Vec<u8> = (0..2 * rate).map(sample).flat_map(i16::to_le_bytes).collect();
    let mut wav = b"RIFF".to_vec();
    wav.extend((36 + sound.len() as u32).to_le_bytes());
    wav.extend(b"WAVEfmt ");
    wav.extend(16_u32.to_le_bytes());
    wav.extend([1_u16, 1].iter().flat_map(|v| v.to_le_bytes()));
    wav.extend([rate, 2 * rate].iter().flat_map(|v| v.to_le_bytes()));
    wav.extend([2_u16, 16].iter().flat_map(|v| v.to_le_bytes()));
    wav.extend(b"data");
    wav.extend((sound.len() as u32).to_le_bytes());
    wav.extend(sound);
    wav
}

#[test]
fn a_clap_is_heard_in_the_sound_of_a_video_at_the_video_s_time() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let sound = folder.write("click.wav", click(0.75));
    // The sound may begin after the picture.
    for (name, codec, late_s) in [("a.mp4", "aac", 0.0), ("b.mp4", "aac", 0.5), ("c.mkv", "pcm_s16le", 0.25)]
    {
        let clip = folder.path(name);
        let made = std::process::Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(fixture())
            .args(["-itsoffset", &late_s.to_string(), "-i"])
            .arg(&sound)
            .args(["-map", "0:v", "-map", "1:a", "-c:v", "copy", "-c:a", codec])
            .arg(&clip)
            .status()
            .unwrap();
        assert!(made.success());
        let Clap::At(t_s) = find_clap(&clip).unwrap() else { panic!("{name}: no clap") };
        assert!((t_s - 0.75 - late_s).abs() < 2e-3, "{name}: {t_s}");
    }
    assert_eq!(find_clap(&fixture()).unwrap(), Clap::Silent);
    let text = find_clap(&folder.write("none.mp4", b"no video")).unwrap_err().to_string();
    assert!(text.contains("none.mp4") && text.contains("ffmpeg failed"), "{text}");
    assert!(find_clap(&folder.path("missing.mp4")).is_err());
}

#[test]
fn another_container_without_ffmpeg_says_how_to_get_it() {
    let folder = Folder::new();
    let clip = folder.write("clip.mkv", b"\x1a\x45\xdf\xa3");
    let error = FrameSource::open_with_ffmpeg(&clip, "no-such-ffmpeg").unwrap_err();
    assert!(matches!(error, SessionError::NeedsFfmpeg { .. }));
    let text = error.to_string();
    assert!(text.contains("clip.mkv") && text.contains("apt-get install ffmpeg"), "{text}");
}

#[test]
fn a_container_that_is_no_video_is_refused() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let clip = folder.write("clip.avi", b"RIFF\x00\x00\x00\x00AVI LIST");
    let text = refusal(&clip);
    assert!(text.contains("clip.avi") && text.contains("ffmpeg failed"), "{text}");
}

#[test]
fn a_truncated_mp4_is_refused_at_any_length() {
    let folder = Folder::new();
    let bytes = std::fs::read(fixture()).unwrap();
    for percent in [0, 1, 10, 50, 90, 99] {
        let clip = folder.write("cut.mp4", &bytes[..bytes.len() * percent / 100]);
        let text = refusal(&clip);
        assert!(text.contains("cut.mp4"), "{percent} %: {text}");
    }
}

/// Every byte of the tables in turn: never a panic out of the library, and a success only with all frames.
#[test]
fn a_spoilt_mp4_never_ends_the_process() {
    let folder = Folder::new();
    let bytes = std::fs::read(fixture()).unwrap();
    let moov = bytes.windows(4).position(|w| w == b"moov").unwrap();
    let quiet = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let outcomes: Vec<_> = (moov..bytes.len())
        .step_by(3)
        .map(|at| {
            let mut spoilt = bytes.clone();
            spoilt[at] ^= 0x81;
            let clip = folder.write("spoilt.mp4", &spoilt);
            std::panic::catch_unwind(|| FrameSource::open(&clip, None).map(Iterator::count).is_ok())
        })
        .collect();
    std::panic::set_hook(quiet);
    assert!(outcomes.iter().all(Result::is_ok));
    assert!(outcomes.iter().any(|o| matches!(o, Ok(false))), "some spoilt tables must be refused");
}

#[test]
fn a_damaged_sample_is_named() {
    let folder = Folder::new();
    let mut bytes = std::fs::read(fixture()).unwrap();
    let mdat = bytes.windows(4).position(|w| w == b"mdat").unwrap();
    let middle = mdat + 4 + (bytes.len() - mdat) / 3;
    bytes[middle..middle + 400].fill(0xff);
    let text = refusal(&folder.write("damaged.mp4", &bytes));
    assert!(text.contains("damaged.mp4") && text.contains("frame "), "{text}");
}

/// `none.mp4` is what ffmpeg leaves when it is asked to copy no frame.
#[test]
fn a_video_of_zero_frames_is_refused() {
    let clip = fixture().with_file_name("none.mp4");
    let error = read(&clip).unwrap_err();
    assert!(matches!(error, SessionError::NoFrames { .. }), "{error}");
    assert!(error.to_string().contains("none.mp4"), "{error}");
}

#[test]
fn an_image_sequence_is_timed_by_its_rate() {
    let folder = Folder::new();
    let frames = read(&fixture()).unwrap();
    for (k, (_, frame)) in frames.iter().take(4).enumerate() {
        write_png(&folder.path(&format!("frame_{:05}.png", k + 7)), frame).unwrap();
    }
    let pattern = folder.path("frame_%05d.png");
    let source = FrameSource::open(&pattern, Some(25.0)).unwrap();
    assert_eq!(source.declared_frames(), Some(4));
    for (k, item) in source.enumerate() {
        let (t_ns, frame) = item.unwrap();
        assert_eq!(t_ns, 40_000_000 * k as i64);
        assert_eq!(frame.to_rgb(), frames[k].1.to_rgb());
    }
    let text = FrameSource::open(&pattern, None).unwrap_err().to_string();
    assert!(text.contains("frame_rate_hz"), "{text}");
    std::fs::remove_file(folder.path("frame_00008.png")).unwrap();
    let items: Vec<_> = FrameSource::open(&pattern, Some(25.0)).unwrap().collect();
    let text = items[1].as_ref().unwrap_err().to_string();
    assert!(text.contains("frame_00008.png") && text.contains("frame_00007.png"), "{text}");
    let times: Vec<i64> = items.iter().flatten().map(|f| f.0).collect();
    assert_eq!(times, [0, 80_000_000, 120_000_000], "a missing frame leaves its time empty");
    let text = FrameSource::open(&folder.path("other_%d.jpg"), Some(25.0)).unwrap_err().to_string();
    assert!(text.contains("other_%d.jpg") && text.contains("no frames"), "{text}");
}

/// A file of a few hundred bytes may say that its picture has hundreds of millions of pixels.
#[test]
fn a_picture_that_claims_more_than_cameras_film_is_refused_before_it_is_decoded() {
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new(&mut jpeg);
    image::ImageEncoder::write_image(encoder, &[90; 192], 8, 8, image::ExtendedColorType::Rgb8).unwrap();
    let header = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    let side = 20_000_u16.to_be_bytes();
    jpeg[header + 5..header + 9].copy_from_slice(&[side, side].concat());
    let text = read_image(&Folder::new().write("still.jpg", &jpeg)).unwrap_err().to_string();
    assert!(text.contains("20000×20000, 1200 MB when decoded, and at most 200 MB"), "{text}");
}

#[test]
fn an_image_that_is_none_is_refused() {
    let folder = Folder::new();
    let text = read_image(&folder.write("still.png", b"not an image")).unwrap_err().to_string();
    assert!(text.contains("still.png"), "{text}");
    let text = read_image(&folder.path("absent.png")).unwrap_err().to_string();
    assert!(text.contains("absent.png") && text.contains("no such file"), "{text}");
}

/// Makes a file by ffmpeg from the fixture; the word FIXTURE stands for it.
fn made(folder: &Folder, name: &str, arguments: &[&str]) -> std::path::PathBuf {
    let fixture = fixture();
    let arguments = arguments.iter().map(|a| if *a == "FIXTURE" { fixture.as_os_str() } else { a.as_ref() });
    let status = std::process::Command::new("ffmpeg")
        .args(["-v", "error", "-y"])
        .args(arguments)
        .arg(folder.path(name))
        .status()
        .unwrap();
    assert!(status.success(), "{name}");
    folder.path(name)
}

/// A telephone held upright leaves a matrix in the container: both paths turn the frames as ffmpeg's own
/// rotation does.
#[test]
fn rotated_files_are_upright_by_both_paths() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let bytes = std::fs::read(fixture()).unwrap();
    let matrix = bytes.windows(4).position(|w| w == b"tkhd").unwrap() + 44;
    for (degrees, quarters, [a, b, c, d]) in
        [(90, 1, [0, 1, -1, 0]), (180, 2, [-1, 0, 0, -1]), (270, 3, [0, -1, 1, 0i32])]
    {
        let mut turned = bytes.clone();
        for (at, value) in [(0, a), (4, b), (12, c), (16, d)] {
            turned[matrix + at..matrix + at + 4].copy_from_slice(&(value << 16).to_be_bytes());
        }
        let clip = folder.write("turned.mp4", turned);
        assert_eq!(same_frames(&clip), 24);
        let upright = made(
            &folder,
            "upright.avi",
            &["-i", clip.to_str().unwrap(), "-c:v", "rawvideo", "-pix_fmt", "yuv420p"],
        );
        let (ours, theirs) = (read(&clip).unwrap(), read(&upright).unwrap());
        assert_eq!(ours[5].1.size, theirs[5].1.size, "{degrees}");
        let luma = |f: &Frame| match &f.pixels {
            Pixels::Yuv420 { y, .. } => y.clone(),
            Pixels::Rgb(_) => panic!("video is in planes"),
        };
        assert!(luma(&ours[5].1) == luma(&theirs[5].1), "{degrees}° differs");
        let plain = read(&fixture()).unwrap();
        assert!(ours[5].1 == plain[5].1.turned(quarters));
        let readout = FrameSource::open(&clip, None).unwrap().readout();
        assert_eq!(readout, [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]][usize::from(quarters)]);
    }
}

#[test]
fn a_variable_rate_is_that_of_the_stamps_by_both_paths() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let pick = "select='not(eq(mod(n,5),3))'";
    let clip = made(
        &folder,
        "vfr.mp4",
        &["-i", "FIXTURE", "-vf", pick, "-fps_mode", "vfr", "-c:v", "libx264", "-bf", "0"],
    );
    assert_eq!(same_frames(&clip), 19);
    let times: Vec<i64> = read(&clip).unwrap().iter().map(|f| f.0 / 1_000_000).collect();
    assert_eq!(times[..6], [0, 33, 66, 133, 166, 200]);
}

/// Damage in one group of pictures costs that group alone; what is lost is counted.
#[test]
fn reading_goes_on_behind_a_damaged_sample() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let clip = made(
        &folder,
        "groups.mp4",
        &["-i", "FIXTURE", "-c:v", "libx264", "-g", "8", "-sc_threshold", "0", "-bf", "0"],
    );
    let whole = read(&clip).unwrap();
    let mut bytes = std::fs::read(&clip).unwrap();
    let mdat = bytes.windows(4).position(|w| w == b"mdat").unwrap();
    let moov = bytes.windows(4).rposition(|w| w == b"moov").unwrap();
    let middle = mdat + (moov - mdat) * 45 / 100;
    bytes[middle..middle + 300].fill(0xff);
    let items: Vec<_> = FrameSource::open(&folder.write("spoilt.mp4", &bytes), None).unwrap().collect();
    let frames: Vec<&(i64, Frame)> = items.iter().flatten().collect();
    assert!(
        items[..items.len() - 1].iter().any(|i| i.as_ref().is_err_and(|e| e.to_string().contains("frame ")))
    );
    for k in (0..8).chain(16..24) {
        let found = frames.iter().find(|f| f.0 == whole[k].0).unwrap_or_else(|| panic!("frame {k} is lost"));
        assert!(found.1 == whole[k].1, "frame {k} differs");
    }
    let last = items.last().unwrap().as_ref().unwrap_err();
    assert!(matches!(last, SessionError::FrameCount { declared: 24, .. }), "{last}");
}

#[test]
fn a_file_that_breaks_off_yields_what_it_holds_and_says_how_much_is_missing() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    for name in ["cut.mp4", "cut.mkv"] {
        let clip =
            made(&folder, name, &["-i", "FIXTURE", "-c:v", "libx264", "-bf", "0", "-movflags", "faststart"]);
        let bytes = std::fs::read(&clip).unwrap();
        let clip = folder.write(name, &bytes[..bytes.len() * 6 / 10]);
        let items: Vec<_> = FrameSource::open(&clip, None).unwrap().collect();
        let read = items.iter().flatten().count();
        assert!((6..22).contains(&read), "{name}: {read}");
        let words: Vec<String> =
            items.iter().filter_map(|i| i.as_ref().err()).map(ToString::to_string).collect();
        assert!(!words.is_empty() && words.iter().all(|w| w.contains(name)), "{name}: {words:?}");
        if name == "cut.mp4" {
            assert!(
                words[0].contains("24 frames") && words[0].contains(&format!("{read} were read")),
                "{words:?}"
            );
        }
    }
}

/// Fields woven from a progressive film of twice the rate, and taken apart again.
#[test]
fn fields_come_at_twice_the_rate_in_their_order() {
    if !ffmpeg() {
        return;
    }
    let folder = Folder::new();
    let clip = made(
        &folder,
        "woven.avi",
        &["-i", "FIXTURE", "-vf", "tinterlace=interleave_top", "-c:v", "rawvideo", "-pix_fmt", "yuv420p"],
    );
    let plain = read(&fixture()).unwrap();
    let source = FrameSource::open(&clip, None).unwrap().fields(mavsight_session::FieldOrder::TopFirst);
    let fields: Vec<(i64, Frame)> = source.map(Result::unwrap).collect();
    assert_eq!(fields.len(), 24);
    let row = |f: &Frame, y: usize| match &f.pixels {
        Pixels::Yuv420 { y: luma, .. } => luma[160 * y..160 * (y + 1)].to_vec(),
        Pixels::Rgb(_) => panic!("video is in planes"),
    };
    for (k, (t_ns, field)) in fields.iter().enumerate() {
        assert!((t_ns - fields[0].0 - plain[k].0).abs() < 1000, "field {k} at {t_ns} ns");
        for y in (k % 2..120).step_by(2) {
            assert!(row(field, y) == row(&plain[k].1, y), "field {k}, row {y}");
        }
    }
}
