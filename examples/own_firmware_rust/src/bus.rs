//! The embedded bus (`docs/bus.md`, "The protocol, to the byte").

use std::io::{Error, ErrorKind};
use std::os::fd::{AsRawFd, FromRawFd};
use std::os::unix::net::UnixDatagram;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use crate::contract::Frame;
use crate::sys;

const MAGIC: &[u8; 4] = b"RRB1";
const HELLO: u8 = 1;
const WELCOME: u8 = 2;
const REFUSED: u8 = 3;
const BYE: u8 = 4;
const FRAMES: u8 = 5;
const EXCLUSIVE: u8 = 2;
const CLOSES_EPOCH: u8 = 1;
const HEADER: usize = 32;
const LARGEST: usize = 65_537;
/// A host answers when it next sends or receives, which may be after it has compiled.
const ANSWER: Duration = Duration::from_secs(10);
const PAUSE: Duration = Duration::from_millis(5);

/// What a sender has sent at once.
pub struct Batch {
    pub frames: Vec<Frame>,
    pub closes_epoch: bool,
    pub epoch: u64,
    pub time_ns: i64,
}

/// A node on the bus. A thread receives, so that two nodes that send never wait for each other.
pub struct Bus {
    socket: UnixDatagram,
    number: [u8; 4],
    received: Receiver<Result<Batch, String>>,
}

struct Datagram<'a> {
    bytes: &'a [u8],
}

impl<'a> Datagram<'a> {
    fn of(bytes: &'a [u8]) -> Result<Self, String> {
        match bytes {
            [] => Err("its host is gone".into()),
            _ if bytes.len() < HEADER || !bytes.starts_with(MAGIC) => {
                Err("a datagram of another protocol".into())
            }
            _ => Ok(Self { bytes }),
        }
    }

    fn field<const N: usize>(&self, at: usize) -> [u8; N] {
        std::array::from_fn(|k| self.bytes[at + k])
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes[HEADER..]).into_owned()
    }

    fn batch(&self, at_ns: i64) -> Batch {
        let frames = self.bytes[HEADER..].chunks_exact(16).map(|bytes| {
            let (head, data) = bytes.split_at(8);
            Frame {
                id: u32::from_le_bytes(std::array::from_fn(|k| head[k])),
                length: head[4],
                data: u64::from_le_bytes(std::array::from_fn(|k| data[k])),
                at_ns,
            }
        });
        Batch {
            frames: frames.collect(),
            closes_epoch: self.bytes[5] & CLOSES_EPOCH != 0,
            epoch: u64::from_le_bytes(self.field(16)),
            time_ns: i64::from_le_bytes(self.field(24)),
        }
    }
}

fn header(kind: u8, flags: u8, count: usize, number: [u8; 4]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend([kind, flags]);
    bytes.extend((count as u16).to_le_bytes());
    bytes.extend(number);
    bytes.resize(HEADER, 0);
    bytes
}

/// Connect to the socket of a channel as soon as somebody hosts it.
fn connect(path: &str, patience: Duration) -> Result<UnixDatagram, String> {
    let deadline = Instant::now() + patience;
    loop {
        let fd = sys::seqpacket_socket().map_err(|error| error.to_string())?;
        // SAFETY: the descriptor is new and nobody else's.
        let socket = unsafe { UnixDatagram::from_raw_fd(fd) };
        match socket.connect(path) {
            Ok(()) => return Ok(socket),
            Err(error) if is_too_early(&error) && Instant::now() < deadline => thread::sleep(PAUSE),
            Err(error) => return Err(error.to_string()),
        }
    }
}

fn is_too_early(error: &Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::NotFound | ErrorKind::ConnectionRefused | ErrorKind::WouldBlock
    )
}

impl Bus {
    /// Attach to the bus at a path as `firmware`. Times of arrival count from `origin`.
    pub fn attach(path: &str, patience: Duration, origin: Instant) -> Result<Self, String> {
        let fail = |error: Error| error.to_string();
        let socket = connect(path, patience)?;
        if !sys::is_host_trusted(socket.as_raw_fd()) {
            return Err("its host is another user's".into());
        }
        sys::enlarge_send_buffer(socket.as_raw_fd());
        let name = b"firmware";
        let hello = [&header(HELLO, EXCLUSIVE, name.len(), [0; 4])[..], name].concat();
        socket.send(&hello).map_err(fail)?;
        socket.set_read_timeout(Some(patience.max(ANSWER))).map_err(fail)?;
        let mut bytes = vec![0; LARGEST];
        let count = socket.recv(&mut bytes).map_err(fail)?;
        let answer = Datagram::of(&bytes[..count])?;
        match answer.bytes[4] {
            WELCOME => {}
            REFUSED | BYE => return Err(answer.text()),
            kind => return Err(format!("answers HELLO by {kind}")),
        }
        let number = answer.field(8);
        socket.set_read_timeout(None).map_err(fail)?;
        let listener = socket.try_clone().map_err(fail)?;
        let (sender, received) = mpsc::channel();
        thread::spawn(move || {
            loop {
                let batch = listen(&listener, &mut bytes, origin);
                let is_over = batch.is_err();
                if sender.send(batch).is_err() || is_over {
                    return;
                }
            }
        });
        Ok(Self { socket, number, received })
    }

    /// The next batch.
    pub fn receive(&self) -> Result<Batch, String> {
        self.received.recv().map_err(|error| error.to_string())?
    }

    /// The next batch, if one comes in time.
    pub fn receive_within(&self, patience: Duration) -> Result<Option<Batch>, String> {
        match self.received.recv_timeout(patience) {
            Ok(batch) => batch.map(Some),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Send all frames of an epoch.
    pub fn send(&self, frames: &[Frame], epoch: u64, time_ns: i64) -> Result<(), String> {
        let mut bytes = header(FRAMES, CLOSES_EPOCH, frames.len(), self.number);
        bytes[16..24].copy_from_slice(&epoch.to_le_bytes());
        bytes[24..32].copy_from_slice(&time_ns.to_le_bytes());
        for frame in frames {
            bytes.extend(frame.id.to_le_bytes());
            bytes.extend([frame.length, 0, 0, 0]);
            bytes.extend(frame.data.to_le_bytes());
        }
        self.socket.send(&bytes).map(drop).map_err(|error| error.to_string())
    }

    pub fn leave(self) {
        // The host notices the end, too, if it does not get this.
        let _ = self.socket.send(&header(BYE, 0, 0, self.number));
    }
}

/// Wait for the next batch; NOTE, COUNTS and frames of CAN FD are skipped.
fn listen(socket: &UnixDatagram, bytes: &mut [u8], origin: Instant) -> Result<Batch, String> {
    loop {
        let count = socket.recv(bytes).map_err(|error| error.to_string())?;
        let at_ns = origin.elapsed().as_nanos() as i64;
        let datagram = Datagram::of(&bytes[..count])?;
        match datagram.bytes[4] {
            FRAMES => return Ok(datagram.batch(at_ns)),
            BYE => return Err(datagram.text()),
            _ => {}
        }
    }
}
