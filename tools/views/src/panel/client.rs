//! A page that showed the secret: what it is sent, how often, and what it asks for.
//!
//! It has no queue. When it has taken the last points, and not before, the next ones are made of what the model
//! holds by then: a slow page gets fewer points, never older ones, and one that reads nothing costs nothing.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::time::{Duration, Instant};

use hil_session::clock::monotonic_ns;
use serde_json::Value;
use tungstenite::protocol::CloseFrame;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Bytes, Error, Message, WebSocket};

use super::board::Board;
use super::message::{self, Deed, View, Wish};

/// Interval between two looks for what the page says.
const LISTEN: Duration = Duration::from_millis(8);
/// Least interval between two messages with points.
const POINTS: Duration = Duration::from_millis(34);
/// Most bytes of points in a second, beyond which there are fewer messages.
const BYTES_PER_S: f64 = 1e6;
/// Points that may be under way: sent, and not seen by the page.
const UNDER_WAY: u32 = 3;
/// Interval between two looks at the state of the session.
const STATE: Duration = Duration::from_millis(150);
/// Interval between two looks at whether values were changed.
const TUNABLE: Duration = Duration::from_millis(500);
/// Interval after which the state is told although it is the same: the page knows by it that it is connected.
const ALIVE: Duration = Duration::from_secs(5);
/// Interval between two questions to the page for a sign of life, and limit for it.
const PING: Duration = Duration::from_secs(5);
const SILENT: Duration = Duration::from_secs(30);
/// Deeds that may wait.
const DEEDS: usize = 8;
/// Messages of a page that are read at one look.
const AT_ONCE: usize = 32;
/// Limit for a page to hear the end.
const END_LIMIT: Duration = Duration::from_secs(2);

/// Question or deed that waits for the session's answer.
enum Errand {
    /// Something that the session is to do, with its number.
    Do(u32, Deed),
    /// The values that can be changed.
    AskTunable,
}

pub(crate) struct Client<'a> {
    socket: WebSocket<TcpStream>,
    board: &'a Arc<Board>,
    view: View,
    /// Points that were sent, and those that were seen.
    sent: u32,
    seen: u32,
    /// Edition of the log, and how much of it was sent.
    logged: (u32, usize),
    /// The socket has not taken everything.
    is_full: bool,
    heard_at: Instant,
    work: SyncSender<Errand>,
    answers: Receiver<String>,
}

impl<'a> Client<'a> {
    pub(crate) fn new(socket: WebSocket<TcpStream>, board: &'a Arc<Board>) -> Self {
        let (work, asked) = sync_channel(DEEDS);
        let (answer, answers) = channel();
        let theirs = Arc::clone(board);
        // Not joined: an answer may take long when nobody wants it any more.
        std::thread::spawn(move || {
            if let Some(faults) = theirs.faults() {
                let _ = answer.send(faults.to_string()); // the page may have gone
            }
            for work in asked {
                let told = match work {
                    Errand::Do(number, deed) => Some(message::answer(number, &theirs.act(&deed))),
                    Errand::AskTunable => theirs.tunable().map(|told| told.to_string()),
                };
                if let Some(told) = told
                    && answer.send(told).is_err()
                {
                    return;
                }
            }
        });
        let rate = board.model.lock().rate();
        Self {
            socket,
            board,
            view: View::new(0, board.window_s, rate),
            sent: 0,
            seen: 0,
            logged: (0, 0),
            is_full: false,
            heard_at: Instant::now(),
            work,
            answers,
        }
    }

    /// Serves the page until it goes or nothing will come any more.
    ///
    /// # Errors
    /// If the page went away.
    pub(crate) fn serve(mut self) -> Result<(), Error> {
        let mut state = Value::Null;
        let mut is_described = false;
        let now = Instant::now();
        let (mut state_at, mut points_at, mut ping_at) = (now, now, now + PING);
        let mut told_at = now;
        let (mut retunings, mut tunable_at) = (None, now);
        loop {
            self.listen()?;
            let now = Instant::now();
            if now > self.heard_at + SILENT {
                return Err(Error::ConnectionClosed);
            }
            self.flush()?;
            if now > ping_at {
                ping_at = now + PING;
                self.say(Message::Ping(Bytes::new()))?;
            }
            if !self.is_full {
                if let (false, Some(about)) = (is_described, self.board.about()) {
                    is_described = true;
                    self.say(about.to_string().into())?;
                }
                while let Ok(answer) = self.answers.try_recv() {
                    self.say(answer.into())?;
                    state_at = now; // it may have changed
                }
                if now >= state_at || self.board.is_over() {
                    state_at = now + STATE;
                    let model = self.board.model.lock();
                    // The page knows by then how long a step is.
                    let log = is_described.then(|| message::log(model.log(), &mut self.logged));
                    let newest = message::state(&model, monotonic_ns());
                    drop(model);
                    if let Some(log) = log.flatten() {
                        self.say(log.to_string().into())?;
                    }
                    if newest != state || now > told_at + ALIVE {
                        self.say(newest.to_string().into())?;
                        (state, told_at) = (newest, now);
                    }
                }
                if now >= tunable_at && is_described {
                    let model = self.board.model.lock();
                    // Of a run that is held a change is seen by nobody until it goes on.
                    let seen = (!model.is_paused()).then(|| model.retunings());
                    drop(model);
                    let is_news = seen.is_none() || seen != retunings;
                    if is_news && self.work.try_send(Errand::AskTunable).is_ok() {
                        retunings = seen;
                    }
                    tunable_at = now + TUNABLE;
                }
                if now >= points_at && is_described {
                    let sent = self.points()?;
                    let pause = Duration::from_secs_f64(sent as f64 / BYTES_PER_S);
                    points_at = now + if pause > POINTS { pause } else { POINTS };
                }
            }
            if self.board.is_over() {
                return self.part();
            }
            std::thread::sleep(LISTEN);
        }
    }

    /// Sends what is new, if the page has seen enough of what it was sent; how many bytes that were.
    fn points(&mut self) -> Result<usize, Error> {
        if self.sent.wrapping_sub(self.seen) >= UNDER_WAY {
            return Ok(0);
        }
        let number = self.sent.wrapping_add(1);
        let points = self.view.points(&self.board.model.lock(), number);
        let Some(points) = points else { return Ok(0) };
        let size = points.len();
        self.sent = number;
        self.say(points.into())?;
        Ok(size)
    }

    /// Says something, now or as soon as the socket takes it.
    fn say(&mut self, message: Message) -> Result<(), Error> {
        match self.socket.send(message) {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                self.is_full = true;
                Ok(())
            }
            other => other,
        }
    }

    fn flush(&mut self) -> Result<(), Error> {
        match self.socket.flush() {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                self.is_full = true;
                Ok(())
            }
            other => {
                self.is_full = false;
                other
            }
        }
    }

    /// Hears what the page wants.
    fn listen(&mut self) -> Result<(), Error> {
        for _ in 0..AT_ONCE {
            let text = match self.socket.read() {
                Ok(Message::Text(text)) => text,
                Ok(Message::Binary(_)) => return Err(Error::ConnectionClosed),
                Ok(_) => {
                    self.heard_at = Instant::now();
                    continue;
                }
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            };
            self.heard_at = Instant::now();
            match message::wish(&text) {
                Ok(Wish::View { number, window_s }) => {
                    let rate = self.board.model.lock().rate();
                    self.view = View::new(number, window_s, rate);
                }
                Ok(Wish::Seen { number }) => {
                    // Of none that was not sent.
                    if self.sent.wrapping_sub(number) <= UNDER_WAY {
                        self.seen = number;
                    }
                }
                Ok(Wish::Do { number, deed }) => {
                    if let Err(TrySendError::Full(_)) = self.work.try_send(Errand::Do(number, deed))
                    {
                        let busy = Err("the session has not answered yet".into());
                        self.say(message::answer(number, &busy).into())?;
                    }
                }
                Err(_) => return Err(Error::ConnectionClosed), // no page of ours says that
            }
        }
        Ok(())
    }

    /// Tells the end, and waits for a while until it is heard.
    fn part(&mut self) -> Result<(), Error> {
        let text = match self.board.model.lock().ending() {
            Some(_) => "the session has ended, and its panel with it",
            None => "the panel was ended; the session goes on",
        };
        self.say(message::over(text).into())?;
        let frame = CloseFrame {
            code: CloseCode::Away,
            reason: "".into(),
        };
        let _ = self.socket.close(Some(frame)); // what cannot be said now is flushed below
        let since = Instant::now();
        while since.elapsed() < END_LIMIT {
            self.flush()?;
            self.listen()?;
            std::thread::sleep(LISTEN);
        }
        Ok(())
    }
}
