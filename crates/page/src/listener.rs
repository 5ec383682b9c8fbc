//! One open page: events out, commands in.

use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Bytes, Message, Utf8Bytes};

use crate::Command;
use crate::access::Right;
use crate::hub::Seat;
use crate::pace::Paced;
use crate::queue::Kind;

type Socket = WebSocketStream<Paced>;

/// Longest message that a page may send; a command has about forty.
const MESSAGE_LIMIT_BYTES: usize = 1024;
/// The connection ends after this many messages that are no command, or one that it may not give.
const NONSENSE_LIMIT: usize = 10;

/// Serves an open page until it leaves, is silent too long, or the server ends; `received` came before.
pub(crate) async fn serve(stream: TcpStream, received: Bytes, seat: Seat) {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_LIMIT_BYTES))
        .max_frame_size(Some(MESSAGE_LIMIT_BYTES))
        .read_buffer_size(4096)
        .write_buffer_size(0);
    let (received, limits) = (received.to_vec(), seat.hub.limits);
    let stream = Paced::new(stream, limits.burst_bytes, limits.pause);
    let mut socket = WebSocketStream::from_partially_read(stream, received, Role::Server, Some(config)).await;
    if let Some((code, text)) = exchange(&mut socket, &seat).await {
        let frame = CloseFrame { code, reason: Utf8Bytes::from_static(text) };
        // Whether it arrives is the page's matter.
        let _ = timeout(limits.request_time, socket.close(Some(frame))).await;
    }
}

/// Passes messages both ways; returns the reason of the end if the page can still hear it.
async fn exchange(socket: &mut Socket, seat: &Seat) -> Option<(CloseCode, &'static str)> {
    let (hub, mailbox) = (&seat.hub, &seat.mailbox);
    let limits = &hub.limits;
    let mut beat = interval(limits.beat);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let end = hub.end();
    tokio::pin!(end);
    let (mut heard, mut nonsense) = (Instant::now(), 0);
    loop {
        let sent = tokio::select! {
            message = mailbox.next() => timeout(limits.silence, socket.send(message)).await,
            incoming = socket.next() => {
                heard = Instant::now();
                match incoming? {
                    Ok(Message::Text(text)) => nonsense += usize::from(!carry_out(&text, seat)),
                    Ok(Message::Binary(_)) => return Some((CloseCode::Unsupported, "only texts are understood")),
                    Ok(Message::Close(_)) | Err(_) => return None,
                    Ok(_) => {}
                }
                if nonsense >= NONSENSE_LIMIT {
                    return Some((CloseCode::Policy, "too many messages that are no command"));
                }
                continue;
            }
            _ = beat.tick() => {
                if heard.elapsed() > limits.silence {
                    return None;
                }
                let text = format!(r#"{{"event":"beat","dropped":{}}}"#, mailbox.dropped());
                mailbox.push(Kind::Beat, Message::text(text));
                timeout(limits.silence, socket.send(Message::Ping(Bytes::new()))).await
            }
            () = &mut end => return Some((CloseCode::Away, "the flight has ended")),
        };
        if !matches!(sent, Ok(Ok(()))) {
            return None;
        }
    }
}

/// Passes a page's command on, and answers one that cannot be carried out. Returns whether it was a command
/// that the page may give.
fn carry_out(text: &str, seat: &Seat) -> bool {
    let Seat { hub, mailbox } = seat;
    let command = Command::parse(text);
    let answer = match command {
        Some(_) if mailbox.right == Right::Look => {
            Some("This page may look only: for commands open the address that this flight has printed.")
        }
        Some(command) => hub.ask(command).err(),
        None => Some("The page sent a command that this program does not know: load the page again."),
    };
    if let Some(answer) = answer {
        let note = format!(r#"{{"event":"note","t_s":null,"fault":true,"text":"{answer}"}}"#);
        mailbox.push(Kind::Note, Message::text(note));
    }
    command.is_some() && mailbox.right == Right::Command
}
