//! Objects of a marker's colour that stand in the room while the aircraft moves.

use super::Stream;
use crate::spread::Spread;
use std::collections::{BTreeMap, BTreeSet};

/// Frames from which a track says that it stands: a second or two of video.
const LEAST_FRAMES: usize = 45;

/// What is of the aircraft moves with it: where half of the other colours move by so many pixels (root mean square), ten times
/// what stands may, a track that stands is of something else.
const MOVES_PX: f64 = 10.0 * crate::spread::STANDS_PX;

/// A colour and a track of it.
pub(super) type ColorTrack = (usize, u32);

/// Frames of a track, and how far it moves in them.
#[derive(Debug, Clone, Copy)]
struct Life {
    first: usize,
    last: usize,
    spread: Spread,
}

impl Stream {
    /// Tracks that are preferred and stand, while what is preferred of the other colours moves: the edge of a table is not the
    /// ball, however long it is seen.
    pub(super) fn standing(&self) -> BTreeSet<ColorTrack> {
        let mut lives: BTreeMap<ColorTrack, Life> = BTreeMap::new();
        for (frame, (_, seen)) in self.frames().enumerate() {
            for ball in seen.iter().filter(|s| s.is_preferred) {
                let new = Life { first: frame, last: frame, spread: Spread::default() };
                let life = lives.entry((ball.color(), ball.track_id)).or_insert(new);
                life.last = frame;
                life.spread.add(&ball.pixel);
            }
        }
        let stands =
            |(_, life): &(&ColorTrack, &Life)| life.spread.count() >= LEAST_FRAMES && life.spread.stands();
        let standing = lives.iter().filter(stands);
        standing.filter(|(of, life)| self.others_move(of.0, life)).map(|(of, _)| *of).collect()
    }

    /// Whether half of the other colours move in these frames.
    fn others_move(&self, color: usize, life: &Life) -> bool {
        let mut others: BTreeMap<usize, Spread> = BTreeMap::new();
        for (_, seen) in self.frames().take(life.last + 1).skip(life.first) {
            for ball in seen.iter().filter(|s| s.is_preferred && s.color() != color) {
                others.entry(ball.color()).or_default().add(&ball.pixel);
            }
        }
        let moving = others.values().filter(|spread| spread.std_px() > MOVES_PX).count();
        moving > 0 && 2 * moving >= others.len()
    }
}
