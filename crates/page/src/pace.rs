//! Bytes of a page, taken no faster than a person's page sends them.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Interval, MissedTickBehavior, interval};

/// A connection from which at most so many bytes are read in each interval. What is sent beyond waits at its
/// sender (flow control of TCP): of messages, pings and fragments alike none costs more than its share.
#[derive(Debug)]
pub(crate) struct Paced {
    stream: TcpStream,
    pause: Interval,
    burst_bytes: usize,
    left_bytes: usize,
}

impl Paced {
    pub(crate) fn new(stream: TcpStream, burst_bytes: usize, pause: Duration) -> Self {
        let mut pause = interval(pause);
        pause.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Self { stream, pause, burst_bytes: burst_bytes.max(1), left_bytes: 0 }
    }
}

impl AsyncRead for Paced {
    fn poll_read(self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        if this.left_bytes == 0 {
            ready!(this.pause.poll_tick(cx));
            this.left_bytes = this.burst_bytes;
        }
        let room = buf.remaining().min(this.left_bytes);
        let mut part = ReadBuf::new(buf.initialize_unfilled_to(room));
        ready!(Pin::new(&mut this.stream).poll_read(cx, &mut part))?;
        let read = part.filled().len();
        this.left_bytes -= read;
        buf.advance(read);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Paced {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.get_mut().stream).poll_write(cx, bytes)
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(cx)
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_shutdown(cx)
    }
}
