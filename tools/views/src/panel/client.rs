//! Authenticated page: sends updates to the page and handles its requests.
//!
//! There is no queue of points. Once the page has taken the last points, the next points are made from the current
//! model: a slow page gets fewer points, never older ones, and a page that reads nothing costs nothing.

use std::net::TcpStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::time::{Duration, Instant};

use hil_session::clock::monotonic_ns;
use serde_json::Value;
use shared_types::time::Step;
use tungstenite::{Error, WebSocket};

use super::board::Board;
use super::live_search::{LiveSearch, refusal};
use super::message::{self, Action, ClientMessage, View};
use super::server::Source;
use super::wire::{LISTEN, Wire};

/// Minimum interval between two messages with points.
const POINTS: Duration = Duration::from_millis(34);
/// Maximum bytes of points per second; larger messages are sent less often.
const BYTES_PER_S: f64 = 1e6;
/// Maximum number of messages with points that the page has not acknowledged.
const UNDER_WAY: u32 = 3;
/// Interval between updates of the session's state.
const STATE: Duration = Duration::from_millis(150);
/// Interval between answers to a search.
const SEARCH: Duration = Duration::from_millis(200);
/// Interval between checks for changed values.
const TUNABLE: Duration = Duration::from_millis(500);
/// Interval after which an unchanged state is sent again, as a sign of life for the page.
const ALIVE: Duration = Duration::from_secs(5);
/// Maximum number of queued actions.
const ACTIONS: usize = 8;
/// Maximum number of a page's messages handled at a time.
const AT_ONCE: usize = 32;

/// Query or action that awaits the session's answer.
enum Errand {
    /// Action with its number.
    Do(u32, Action),
    /// Query for the tunable values.
    AskTunable,
}

impl Source for Board {
    fn serve(self: Arc<Self>, socket: WebSocket<TcpStream>) {
        let _ = Client::new(socket, &self).serve(); // a disconnected page is not an error
    }

    fn end(&self) {
        Self::end(self);
    }
}

pub(crate) struct Client<'a> {
    wire: Wire,
    board: &'a Arc<Board>,
    view: View,
    /// Number of the points sent last, and of the points acknowledged last.
    sent: u32,
    seen: u32,
    /// Edition of the log, and the number of events sent.
    logged: (u32, usize),
    /// Edition of the branches sent last.
    branched: u32,
    /// Number and formula of a search that waits for the first record.
    sought: Option<(u32, String)>,
    search: Option<LiveSearch>,
    work: SyncSender<Errand>,
    answers: Receiver<String>,
}

impl<'a> Client<'a> {
    pub(crate) fn new(socket: WebSocket<TcpStream>, board: &'a Arc<Board>) -> Self {
        let (work, errands) = sync_channel(ACTIONS);
        let (answer, answers) = channel();
        let theirs = Arc::clone(board);
        // Not joined: it may still wait for an answer that is no longer needed.
        std::thread::spawn(move || {
            if let Some(faults) = theirs.faults() {
                let _ = answer.send(faults.to_string()); // the page may be closed
            }
            for work in errands {
                let text = match work {
                    Errand::Do(number, action) => {
                        Some(message::answer(number, &theirs.act(&action)))
                    }
                    Errand::AskTunable => theirs.tunable().map(|text| text.to_string()),
                };
                if let Some(text) = text
                    && answer.send(text).is_err()
                {
                    return;
                }
            }
        });
        let rate = board.model.lock().rate();
        Self {
            wire: Wire::new(socket),
            board,
            view: View::new(0, board.window_s, rate),
            sent: 0,
            seen: 0,
            logged: (0, 0),
            branched: 0,
            sought: None,
            search: None,
            work,
            answers,
        }
    }

    /// Serves the page until it disconnects or the session ends.
    ///
    /// # Errors
    /// If the page disconnected.
    pub(crate) fn serve(mut self) -> Result<(), Error> {
        let mut state = Value::Null;
        let mut is_described = false;
        let now = Instant::now();
        let (mut state_at, mut points_at) = (now, now);
        let (mut told_at, mut searched_at) = (now, now);
        let (mut retunings, mut tunable_at) = (None, now);
        loop {
            self.listen()?;
            self.search()?;
            let now = Instant::now();
            self.wire.tend()?;
            if !self.wire.is_full() {
                if let (false, Some(about)) = (is_described, self.board.about()) {
                    is_described = true;
                    self.wire.say(about.to_string().into())?;
                }
                if let Some(branches) = self.board.branches.news(&mut self.branched) {
                    self.wire.say(branches.to_string().into())?;
                }
                while let Ok(answer) = self.answers.try_recv() {
                    self.wire.say(answer.into())?;
                    state_at = now; // it may have changed
                }
                if now >= state_at || self.board.is_over() {
                    state_at = now + STATE;
                    let model = self.board.model.lock();
                    // By now the page knows the length of a step.
                    let log = is_described.then(|| message::log(model.log(), &mut self.logged));
                    let newest = message::state(&model, monotonic_ns());
                    drop(model);
                    if let Some(log) = log.flatten() {
                        self.wire.say(log.to_string().into())?;
                    }
                    if newest != state || now > told_at + ALIVE {
                        self.wire.say(newest.to_string().into())?;
                        (state, told_at) = (newest, now);
                    }
                }
                let search = self.search.as_mut().filter(|_| now >= searched_at);
                if let Some(news) = search.and_then(LiveSearch::news) {
                    self.wire.say(news.to_string().into())?;
                    searched_at = now + SEARCH;
                }
                if now >= tunable_at && is_described {
                    let model = self.board.model.lock();
                    // A change of a paused run takes effect only when it resumes.
                    let current = (!model.is_paused()).then(|| model.retunings());
                    drop(model);
                    let is_news = current.is_none() || current != retunings;
                    if is_news && self.work.try_send(Errand::AskTunable).is_ok() {
                        retunings = current;
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

    /// Sends new points if the page has acknowledged enough of the previous ones; returns their size in bytes.
    fn points(&mut self) -> Result<usize, Error> {
        if self.sent.wrapping_sub(self.seen) >= UNDER_WAY {
            return Ok(0);
        }
        let number = self.sent.wrapping_add(1);
        let points = self.view.points(&self.board.model.lock(), number);
        let Some(points) = points else { return Ok(0) };
        let size = points.len();
        self.sent = number;
        self.wire.say(points.into())?;
        Ok(size)
    }

    /// Starts the search that the page asked for, and goes on with it.
    fn search(&mut self) -> Result<(), Error> {
        let kept = &self.board.kept;
        if let Some((number, formula)) = &self.sought
            && let Some(started) = LiveSearch::start(kept, *number, formula)
        {
            match started {
                Ok(search) => self.search = Some(search),
                Err(error) => {
                    let refusal = refusal(*number, formula, &error);
                    self.wire.say(refusal.to_string().into())?;
                }
            }
            self.sought = None;
        }
        if let Some(search) = &mut self.search {
            search.turn(kept);
        }
        Ok(())
    }

    /// Handles the page's messages.
    fn listen(&mut self) -> Result<(), Error> {
        for _ in 0..AT_ONCE {
            let Some(message) = self.wire.next()? else {
                return Ok(());
            };
            match message {
                ClientMessage::View { number, window_s } => {
                    let rate = self.board.model.lock().rate();
                    self.view = View::new(number, window_s, rate);
                }
                ClientMessage::Seen { number } => {
                    // Ignores numbers that were never sent.
                    if self.sent.wrapping_sub(number) <= UNDER_WAY {
                        self.seen = number;
                    }
                }
                ClientMessage::Do { number, action } => {
                    if let Err(TrySendError::Full(_)) =
                        self.work.try_send(Errand::Do(number, action))
                    {
                        let busy = Err("the session has not answered yet".into());
                        self.wire.say(message::answer(number, &busy).into())?;
                    }
                }
                // A new formula takes the place of the one before.
                ClientMessage::Where { number, formula } => {
                    self.search = None;
                    self.sought =
                        Some((number, formula)).filter(|(_, text)| !text.trim().is_empty());
                }
                ClientMessage::Branch { step } => self.board.branches.start(Step(step)),
                keep @ ClientMessage::Keep { .. } => {
                    let about = self.board.about();
                    let answer = about.and_then(|about| self.board.keeper.answer(&keep, &about));
                    if let Some(answer) = answer {
                        self.wire.say(answer.to_string().into())?;
                    }
                }
                other => {
                    if let Some(answer) = self.board.answer(&other) {
                        self.wire.say(answer)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Announces the end.
    fn part(&mut self) -> Result<(), Error> {
        let text = match self.board.model.lock().ending() {
            Some(_) => "the session has ended",
            None => "the panel was closed; the session continues",
        };
        self.wire.part(text)
    }
}
