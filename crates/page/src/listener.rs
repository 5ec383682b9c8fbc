//! One open page: events out, commands in.

use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Bytes, Message, Utf8Bytes};

use crate::Command;
use crate::connection::House;
use crate::hub::{Hub, Mailbox};
use crate::queue::Kind;

type Socket = WebSocketStream<TcpStream>;

/// Longest message that a page may send; a command has about forty.
const MESSAGE_LIMIT_BYTES: usize = 1024;
/// So many messages that are no command end the connection.
const NONSENSE_LIMIT: usize = 10;

/// Serves an open page until it leaves, is silent for too long, or the server ends.
pub(crate) async fn serve(stream: TcpStream, rest: Vec<u8>, mailbox: &Mailbox, house: &House) {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_LIMIT_BYTES))
        .max_frame_size(Some(MESSAGE_LIMIT_BYTES))
        .read_buffer_size(4096)
        .write_buffer_size(0);
    let mut socket = WebSocketStream::from_partially_read(stream, rest, Role::Server, Some(config)).await;
    let reason = exchange(&mut socket, mailbox, house).await;
    if let Some((code, text)) = reason {
        let frame = CloseFrame { code, reason: Utf8Bytes::from_static(text) };
        // Whether the farewell arrives is the other side's matter.
        let _ = timeout(house.limits.request_time, socket.close(Some(frame))).await;
    }
}

/// Passes messages to and fro; returns what to say at the end, if anything can be said any more.
async fn exchange(
    socket: &mut Socket,
    mailbox: &Mailbox,
    house: &House,
) -> Option<(CloseCode, &'static str)> {
    let limits = &house.limits;
    let mut beat = interval(limits.beat);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut ended = house.ended.clone();
    let (mut heard, mut nonsense) = (Instant::now(), 0);
    loop {
        tokio::select! {
            message = mailbox.next() => {
                if !matches!(timeout(limits.silence, socket.send(message)).await, Ok(Ok(()))) {
                    return None;
                }
            }
            incoming = socket.next() => {
                heard = Instant::now();
                match incoming {
                    Some(Ok(Message::Text(text))) => nonsense += usize::from(!carry_out(&text, mailbox, &house.hub)),
                    Some(Ok(Message::Binary(_))) => return Some((CloseCode::Unsupported, "only texts are understood")),
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return None,
                    Some(Ok(_)) => {}
                }
                if nonsense >= NONSENSE_LIMIT {
                    return Some((CloseCode::Policy, "too many messages that are no command"));
                }
            }
            _ = beat.tick() => {
                if heard.elapsed() > limits.silence {
                    return None;
                }
                let text = format!(r#"{{"event":"beat","dropped":{}}}"#, mailbox.dropped());
                mailbox.push(Kind::Beat, Message::text(text));
                if !matches!(timeout(limits.silence, socket.send(Message::Ping(Bytes::new()))).await, Ok(Ok(()))) {
                    return None;
                }
            }
            () = end(&mut ended) => return Some((CloseCode::Away, "the flight has ended")),
        }
    }
}

/// Waits for the server's end.
pub(crate) async fn end(ended: &mut watch::Receiver<bool>) {
    // An error says that the server is gone, which is the same.
    let _ = ended.wait_for(|&ended| ended).await;
}

/// Hands on what a page asks for; what cannot be is answered. Returns whether it was a command.
fn carry_out(text: &str, mailbox: &Mailbox, hub: &Hub) -> bool {
    let command = Command::parse(text);
    let answer = match command {
        Some(command) => hub.ask(command).err(),
        None => Some("The page asked for something that this program does not know: load the page again."),
    };
    if let Some(answer) = answer {
        mailbox.push(
            Kind::Note,
            Message::text(format!(r#"{{"event":"note","t_s":null,"fault":true,"text":"{answer}"}}"#)),
        );
    }
    command.is_some()
}
