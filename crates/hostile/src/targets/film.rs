//! Films and images: MP4 with H.264, y4m, PNG, JPEG.

use crate::files::{with_file, written};
use crate::{Mutator, Outcome};
use mavsight_geometry::ImageSize;
use mavsight_session::{FrameSource, SessionError, VideoWriter, Y4mWriter, read_image, write_png};
use mavsight_vision::Frame;
use std::path::Path;

/// Frames that a film of an attack yields at most: what follows is more of the same.
const MOST_FRAMES: usize = 64;

/// A box that holds boxes, behind so many bytes of its own.
const HOLDERS: [(&[u8; 4], usize); 12] = [
    (b"moov", 0),
    (b"trak", 0),
    (b"mdia", 0),
    (b"minf", 0),
    (b"stbl", 0),
    (b"edts", 0),
    (b"dinf", 0),
    (b"udta", 0),
    (b"moof", 0),
    (b"traf", 0),
    (b"stsd", 8),
    (b"avc1", 78),
];

/// A box, or bytes between boxes, of which the kind is empty.
#[derive(Clone)]
struct Node {
    kind: Vec<u8>,
    own: Vec<u8>,
    inside: Vec<Node>,
}

fn nodes(bytes: &[u8]) -> Vec<Node> {
    let mut all = Vec::new();
    let mut rest = bytes;
    while let Some((head, _)) = rest.split_at_checked(8) {
        let size = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some(content) = rest.get(8..size.max(8)).filter(|_| size >= 8) else { break };
        let kind = head[4..8].to_vec();
        let holder = HOLDERS.iter().find(|(holder, own)| kind == holder[..] && content.len() >= *own);
        let (own, inside) = match holder {
            Some((_, own)) => (content[..*own].to_vec(), nodes(&content[*own..])),
            None => (content.to_vec(), Vec::new()),
        };
        all.push(Node { kind, own, inside });
        rest = &rest[size..];
    }
    if !rest.is_empty() {
        all.push(Node { kind: Vec::new(), own: rest.to_vec(), inside: Vec::new() });
    }
    all
}

/// The bytes of boxes, each with the size that it has.
fn coded(all: &[Node]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for Node { kind, own, inside } in all {
        let content = [&own[..], &coded(inside)].concat();
        if !kind.is_empty() {
            bytes.extend((content.len() as u32 + 8).to_be_bytes());
            bytes.extend(kind);
        }
        bytes.extend(content);
    }
    bytes
}

/// A film with mutations inside its boxes and of the boxes themselves, whose sizes are then right; in one of
/// four also of its bytes as they lie, with sizes that are wrong.
pub(crate) fn mutated(mutator: &mut Mutator, film: &[u8], count: usize) -> Vec<u8> {
    let mut all = nodes(film);
    for _ in 0..count {
        spoil(mutator, &mut all);
    }
    let mut bytes = coded(&all);
    if count > 0 && mutator.chance(4) {
        mutator.mutate(&mut bytes, &[film.to_vec()]);
    }
    bytes
}

fn spoil(mutator: &mut Mutator, all: &mut Vec<Node>) {
    if all.is_empty() {
        return;
    }
    let at = mutator.below(all.len());
    if !all[at].inside.is_empty() && !mutator.chance(6) {
        return spoil(mutator, &mut all[at].inside);
    }
    match mutator.below(12) {
        0 => drop(all.remove(at)),
        1 => {
            let (again, to) = (all[at].clone(), mutator.below(all.len() + 1));
            all.insert(to, again);
        }
        2 => {
            let other = mutator.below(all.len());
            all.swap(at, other);
        }
        3 => {
            let other = mutator.below(all.len());
            all[at].kind = all[other].kind.clone();
        }
        _ => {
            let own = all[at].own.clone();
            mutator.mutate(&mut all[at].own, &[own]);
        }
    }
}

/// A frame of a few pixels whose colours differ from number to number.
fn frame(number: u8) -> Frame {
    let size = ImageSize { width_px: 48, height_px: 32 };
    let rgb = (0..3 * size.area_px()).map(|k| (k as u8).wrapping_mul(7).wrapping_add(40 * number));
    Frame::from_rgb(size, rgb.collect()).unwrap()
}

pub(super) fn films() -> Vec<Vec<u8>> {
    let own = written("film.mp4", |path| {
        let mut writer = VideoWriter::create(path, frame(0).size)?;
        (0..4).try_for_each(|k| writer.push(33_333_333 * i64::from(k), &frame(k)))?;
        writer.finish()
    });
    // With pictures that are predicted from both sides, by another encoder.
    vec![own, include_bytes!("../../../session/tests/fixtures/testsrc.mp4").to_vec()]
}

/// Reads the frames; a reader that is refused its first is not asked for more.
fn frames(path: &Path) -> Result<usize, SessionError> {
    // No film of another codec starts a program.
    let source = FrameSource::open_or(path, None, "there-is-no-such-program")?;
    let size = source.size();
    let mut count = 0;
    for next in source.take(MOST_FRAMES) {
        match next {
            Ok((_, frame)) => {
                assert_eq!(frame.size, size);
                assert_eq!(frame.to_rgb().len(), 3 * size.area_px());
                count += 1;
            }
            Err(error) if count == 0 => return Err(error),
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    Ok(count)
}

pub(super) fn mp4(bytes: &[u8]) -> Outcome {
    with_file("attacked.mp4", bytes, frames).into()
}

pub(super) fn y4m_films() -> Vec<Vec<u8>> {
    let own = written("film.y4m", |path| {
        let mut writer = Y4mWriter::create(path, 30.0)?;
        (0..3).try_for_each(|k| writer.push(33_333_333 * i64::from(k), &frame(k)))?;
        Ok::<(), SessionError>(())
    });
    let mut other = b"YUV4MPEG2 W4 H2 F30000:1001 Ip C420mpeg2 XYSCSS=420MPEG2\n".to_vec();
    for k in 0..3 {
        other.extend(b"FRAME\n");
        other.extend([k; 12]);
    }
    vec![own, other]
}

pub(super) fn y4m(bytes: &[u8]) -> Outcome {
    with_file("attacked.y4m", bytes, frames).into()
}

pub(super) fn png_images() -> Vec<Vec<u8>> {
    vec![written("image.png", |path| write_png(path, &frame(1)))]
}

/// Sets the checksums of a PNG's chunks right.
pub(super) fn repair_png(mut bytes: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some(end) = (at + 8).checked_add(length).filter(|end| end + 4 <= bytes.len()) else { break };
        let checksum = crc32fast::hash(&bytes[at + 4..end]).to_be_bytes();
        bytes[end..end + 4].copy_from_slice(&checksum);
        at = end + 4;
    }
    bytes
}

pub(super) fn jpeg_images() -> Vec<Vec<u8>> {
    let (image, size) = (frame(1).to_rgb(), frame(1).size);
    let pixel = |x: usize, y: usize| {
        let at = 3 * (y * size.width_px as usize + x);
        [image[at], image[at + 1], image[at + 2]]
    };
    vec![mavsight_page::encode_preview(size.width_px, size.height_px, pixel).unwrap()]
}

pub(super) fn image(bytes: &[u8]) -> Outcome {
    with_file("attacked.png", bytes, read_image).into()
}
