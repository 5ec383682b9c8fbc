//! The bounded queue of one page, from which the oldest message falls out first.

use std::collections::VecDeque;

use mavsight_link::Event;
use tokio_tungstenite::tungstenite::Message;

/// The subject of a message, which limits how many of it wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Scene,
    Pose,
    Detections(usize),
    Camera(usize),
    Parameters,
    Recording,
    Note,
    Preview(u8),
    Beat,
}

impl Kind {
    pub(crate) fn of(event: &Event) -> Self {
        match event {
            Event::Scene(_) => Self::Scene,
            Event::Pose(_) => Self::Pose,
            Event::Detections { camera, .. } => Self::Detections(*camera),
            Event::Camera { camera, .. } => Self::Camera(*camera),
            Event::Parameters { .. } => Self::Parameters,
            Event::Recording { .. } => Self::Recording,
            Event::Note { .. } => Self::Note,
        }
    }

    /// Whether pages that open later get it too; messages of a past instant are not sent again.
    pub(crate) fn is_state(self) -> bool {
        !matches!(self, Self::Pose | Self::Detections(_) | Self::Preview(_) | Self::Beat)
    }

    /// How many wait at most: of a state the newest; of instants those of a quarter of a second at 120 Hz, so
    /// that a pause of that length leaves no gap and a slower page sees the newest; of notes a page full.
    fn depth(self) -> usize {
        match self {
            Self::Pose | Self::Detections(_) | Self::Note => 30,
            _ => 1,
        }
    }
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Queue {
    waiting: VecDeque<(Kind, Message)>,
    pub(crate) dropped: u64,
}

impl Queue {
    /// Adds a message; if too many of its kind wait, the oldest of them falls out.
    pub(crate) fn push(&mut self, kind: Kind, message: Message) {
        if self.waiting.iter().filter(|(other, _)| *other == kind).count() >= kind.depth()
            && let Some(oldest) = self.waiting.iter().position(|(other, _)| *other == kind)
        {
            self.waiting.remove(oldest);
            self.dropped += u64::from(kind == Kind::Pose);
        }
        self.waiting.push_back((kind, message));
    }

    pub(crate) fn pop(&mut self) -> Option<Message> {
        self.waiting.pop_front().map(|(_, message)| message)
    }

    /// Forgets the states of cameras, whose numbers other cameras may have now.
    pub(crate) fn forget_cameras(&mut self) {
        self.waiting.retain(|(kind, _)| !matches!(kind, Kind::Camera(_)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drain(mut queue: Queue) -> Vec<String> {
        std::iter::from_fn(|| queue.pop()).map(|message| message.to_text().unwrap().to_owned()).collect()
    }

    #[test]
    fn of_many_poses_the_newest_remain_in_order() {
        let mut queue = Queue::default();
        for count in 0..1000 {
            queue.push(Kind::Pose, Message::text(count.to_string()));
        }
        assert_eq!(queue.dropped, 970);
        assert_eq!(drain(queue), (970..1000).map(|count| count.to_string()).collect::<Vec<_>>());
    }

    #[test]
    fn a_state_replaces_its_older_self_and_nothing_else() {
        let mut queue = Queue::default();
        queue.push(Kind::Camera(0), Message::text("a0"));
        queue.push(Kind::Camera(1), Message::text("b0"));
        queue.push(Kind::Pose, Message::text("p"));
        queue.push(Kind::Camera(0), Message::text("a1"));
        assert_eq!(queue.dropped, 0);
        assert_eq!(drain(queue), ["b0", "p", "a1"]);
    }
}
