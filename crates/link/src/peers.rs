//! TCP connections to which more is written than a slow reader takes.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

/// What may wait for one reader: some seconds of events. One that lags further is cut off, and may come back.
const MOST_WAITING: usize = 1 << 18;

pub(crate) const MOST: usize = 32;

/// Those who have knocked at a listener that does not wait, at most so many that each place could be filled:
/// who knocks faster than that keeps nobody busy.
pub(crate) fn knocking(listener: &TcpListener) -> impl Iterator<Item = TcpStream> + '_ {
    std::iter::from_fn(|| listener.accept().ok().map(|(stream, _)| stream)).take(MOST)
}

/// A connection that never makes its writer wait.
pub(crate) struct Peer {
    pub(crate) stream: TcpStream,
    pub(crate) address: SocketAddr,
    waiting: Vec<u8>,
}

impl Peer {
    pub(crate) fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        let address = stream.peer_addr()?;
        Ok(Self { stream, address, waiting: Vec::new() })
    }

    /// Sends, or keeps for later what does not go now. False: it has gone, or lags too far; drop it.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> bool {
        if !self.flush() || self.waiting.len() + bytes.len() > MOST_WAITING {
            return false;
        }
        self.waiting.extend_from_slice(bytes);
        self.flush()
    }

    /// Sends what waits, as far as it goes. False: it has gone.
    pub(crate) fn flush(&mut self) -> bool {
        let mut sent = 0;
        while sent < self.waiting.len() {
            match self.stream.write(&self.waiting[sent..]) {
                Ok(0) => return false,
                Ok(n) => sent += n,
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => break,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        self.waiting.drain(..sent);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::time::{Duration, Instant};

    fn pair() -> (Peer, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let far = TcpStream::connect(listener.local_addr().expect("its address")).expect("connected");
        (Peer::new(listener.accept().expect("accepted").0).expect("a peer"), far)
    }

    #[test]
    fn a_reader_that_stops_is_cut_off_and_never_waited_for() {
        let (mut peer, _far) = pair();
        let line = [7; 1000];
        let begun = Instant::now();
        let lines = (0..100_000).take_while(|_| peer.push(&line)).count();
        assert!(lines > 100 && lines < 100_000, "{lines}");
        assert!(begun.elapsed() < Duration::from_secs(5));
        assert!(peer.waiting.len() <= MOST_WAITING);
    }

    #[test]
    fn a_reader_that_is_slow_gets_all_in_order() {
        let (mut peer, mut far) = pair();
        let total: u32 = 400_000;
        let reader = std::thread::spawn(move || {
            let mut all = Vec::new();
            std::thread::sleep(Duration::from_millis(100));
            far.read_to_end(&mut all).expect("read");
            all
        });
        for k in 0..total {
            while peer.waiting.len() > MOST_WAITING / 2 {
                assert!(peer.flush());
            }
            assert!(peer.push(&k.to_le_bytes()));
        }
        while !peer.waiting.is_empty() {
            assert!(peer.flush());
        }
        drop(peer);
        let want: Vec<u8> = (0..total).flat_map(u32::to_le_bytes).collect();
        assert!(reader.join().expect("read") == want);
    }

    #[test]
    fn who_knocks_all_the_time_keeps_nobody_busy() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        listener.set_nonblocking(true).expect("set");
        let address = listener.local_addr().expect("its address");
        let _knocks: Vec<_> =
            (0..2 * MOST).map(|_| TcpStream::connect(address).expect("connected")).collect();
        assert_eq!(knocking(&listener).count(), MOST);
        assert!(knocking(&listener).count() <= MOST);
        assert_eq!(knocking(&listener).count(), 0);
    }

    #[test]
    fn one_that_has_gone_is_noticed() {
        let (mut peer, far) = pair();
        drop(far);
        assert!((0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(5));
            !peer.push(&[0; 100])
        }));
    }
}
