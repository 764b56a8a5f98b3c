//! Requests, samples and counts of lost lines.

use std::collections::VecDeque;
use std::time::Duration;

use softrig_formats::instant::{Instant, sleep};
use wire::answer::Identity;
use wire::command::{Command, Request};
use wire::reply::VERSION;
use wire::telemetry::Telemetry;

use super::board::Board;
use super::error::LinkError;
use super::heart::Silence;
use super::line::{Incoming, command_text};
use super::transport::Connector;
use super::worker::{BEAT_ID, FromBoard, Heard, Worker};

/// How long to wait for what.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// For the first answer after opening, which resets the board: its
    /// bootloader takes one to two seconds.
    pub handshake: Duration,
    /// Silence after which the first question is asked. Earlier it would meet
    /// the bootloader, and every byte keeps that one from starting the firmware.
    pub listen: Duration,
    /// For a reply.
    pub reply: Duration,
    /// How often to ask.
    pub attempts: u8,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            handshake: Duration::from_secs(6),
            listen: Duration::from_secs(3),
            reply: Duration::from_millis(700),
            attempts: 4,
        }
    }
}

/// A sample with the circumstances of its arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// The sample.
    pub sample: Telemetry,
    /// When it arrived.
    pub arrived: Instant,
    /// Whether the board's clock started again since the sample before.
    pub restarted: bool,
    /// Lines that were lost in front of it.
    pub dropped: u16,
}

/// An event on a link.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A sample.
    Sample(Received),
    /// A remark for people.
    Remark(String),
    /// A whole line that is no sample, reply or remark: of the self-test, or of a kind that is not
    /// known.
    Other(String),
    /// A line that was damaged on the way.
    Useless,
    /// The connection broke; [`Link::reconnect`] tries to mend it.
    Lost(String),
}

/// Counts of lines received and lost so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Samples.
    pub samples: u64,
    /// Lines that the board sent and that did not arrive, by their numbers;
    /// damaged ones among them.
    pub dropped: u64,
    /// Lines that were damaged on the way.
    pub damaged: u64,
    /// Whole lines of a kind that this version does not know.
    pub unknown: u64,
    /// Restarts of the board that were noticed.
    pub restarts: u64,
    /// How often the connection broke.
    pub lost: u64,
}

/// A connection to a board.
pub struct Link {
    connector: Box<dyn Connector>,
    timing: Timing,
    worker: Option<Worker>,
    board: Board,
    counters: Counters,
    backlog: VecDeque<Event>,
    last: Option<Telemetry>,
    banner_seen: bool,
    id: u8,
    /// When the board said anything that makes sense.
    heard: Instant,
    /// When a sample came.
    sampled: Instant,
}

impl std::fmt::Debug for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Link")
            .field("port", &self.connector.name())
            .field("board", &self.board)
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

impl Link {
    /// Opens the port and waits until the board has said who it is.
    ///
    /// # Errors
    ///
    /// [`LinkError`] when the port cannot be opened, stays silent, or something
    /// else than this version's firmware is behind it.
    pub fn open(connector: impl Connector + 'static, timing: Timing) -> Result<Self, LinkError> {
        let mut link = Self {
            connector: Box::new(connector),
            timing,
            worker: None,
            board: Board::default(),
            counters: Counters::default(),
            backlog: VecDeque::new(),
            last: None,
            banner_seen: false,
            id: 0,
            heard: Instant::now(),
            sampled: Instant::now(),
        };
        link.connect()?;
        // What came before the board was known is nobody's: counted or
        // recorded alone, the two would not agree.
        link.counters = Counters::default();
        link.backlog.clear();
        Ok(link)
    }

    /// Tries once to open the port again.
    ///
    /// # Errors
    ///
    /// Like [`Link::open`]; try again later.
    pub fn reconnect(&mut self) -> Result<(), LinkError> {
        self.connect()
    }

    /// The port's name.
    pub fn port(&self) -> &str {
        self.connector.name()
    }

    /// Whether a simulator is behind it.
    pub fn is_simulated(&self) -> bool {
        self.connector.is_simulated()
    }

    /// The board's identity.
    pub fn board(&self) -> &Board {
        &self.board
    }

    /// The counts so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Whether the port is open.
    pub fn is_connected(&self) -> bool {
        self.worker.is_some()
    }

    /// The last sample.
    pub fn last(&self) -> Option<&Telemetry> {
        self.last.as_ref()
    }

    /// The next event, if one happens within `wait`.
    pub fn next_event(&mut self, wait: Duration) -> Option<Event> {
        if let Some(event) = self.backlog.pop_front() {
            return Some(event);
        }
        let until = Instant::now() + wait;
        loop {
            let Some(incoming) = self.receive(until) else {
                if self.worker.is_none() {
                    sleep(until.saturating_duration_since(Instant::now()));
                }
                return None;
            };
            if let Some(event) = self.absorb(incoming) {
                return Some(event);
            }
        }
    }

    /// Asks, and keeps what else happens for [`Link::next_event`].
    ///
    /// # Errors
    ///
    /// [`LinkError`] when the board refuses or does not answer.
    pub fn request(&mut self, command: Command) -> Result<String, LinkError> {
        let mut meanwhile = VecDeque::new();
        let outcome = self.request_with(command, &mut |event| meanwhile.push_back(event));
        self.backlog.append(&mut meanwhile);
        outcome
    }

    /// Asks, and passes on what else happens as soon as it does.
    ///
    /// # Errors
    ///
    /// Like [`Link::request`].
    pub fn request_with(
        &mut self,
        command: Command,
        handler: &mut dyn FnMut(Event),
    ) -> Result<String, LinkError> {
        while let Some(event) = self.backlog.pop_front() {
            handler(event);
        }
        // Numbers from 1 to 254; all attempts share one, so that a late reply
        // counts.
        self.id = self.id % (BEAT_ID - 1) + 1;
        let id = self.id;
        for attempt in 1..=self.timing.attempts {
            self.send(Request { id, command })?;
            let until = Instant::now() + self.timing.reply;
            while let Some(incoming) = self.receive_surely(until) {
                if let FromBoard::Line(Incoming::Reply { id: to, outcome }, _) = &incoming
                    && *to == id
                {
                    return outcome.clone().map_err(|refusal| LinkError::Refused {
                        port: self.port().to_owned(),
                        command: command_text(command),
                        refusal,
                        retried: attempt > 1,
                    });
                }
                let lost = match &incoming {
                    FromBoard::Lost(reason) => Some(reason.clone()),
                    FromBoard::Line(..) => None,
                };
                if let Some(event) = self.absorb(incoming) {
                    handler(event);
                }
                if let Some(reason) = lost {
                    return Err(self.lost(reason));
                }
            }
        }
        Err(LinkError::NoReply {
            port: self.port().to_owned(),
            command: command_text(command),
            attempts: self.timing.attempts,
        })
    }

    pub(super) fn lost(&self, reason: impl Into<String>) -> LinkError {
        LinkError::Lost {
            port: self.port().to_owned(),
            reason: reason.into(),
        }
    }

    pub(super) fn unexpected(&self, command: Command, reply: &str) -> LinkError {
        LinkError::Unexpected {
            port: self.port().to_owned(),
            command: command_text(command),
            reply: reply.to_owned(),
        }
    }

    /// How long the board bears silence while it is armed.
    pub(super) fn set_patience(&self, patience: Duration) {
        if let Some(worker) = &self.worker {
            worker.set_patience(patience);
        }
    }

    fn take_heard(&self) -> Heard {
        self.worker
            .as_ref()
            .map(Worker::take_heard)
            .unwrap_or_default()
    }

    /// For how long nothing that the board says has come: no sample, no reply, no remark.
    pub fn quiet_for(&self) -> Duration {
        self.heard.elapsed()
    }

    /// For how long no sample has come.
    pub fn without_sample_for(&self) -> Duration {
        self.sampled.elapsed()
    }

    /// What came instead of samples since this was asked last, in words.
    pub fn what_came(&self) -> String {
        let heard = self.take_heard();
        if heard.is_nothing() {
            "not a byte came".into()
        } else {
            format!("{heard}; none of them is a sample of a softrig board")
        }
    }

    /// How long the board had to wait for a sign of life since it was armed.
    pub(super) fn silence(&self) -> Option<Silence> {
        Some(self.worker.as_ref()?.silence())
    }

    fn send(&mut self, request: Request) -> Result<(), LinkError> {
        let Some(worker) = &self.worker else {
            return Err(self.lost("the port is closed"));
        };
        let sent = worker.send(&request);
        sent.map_err(|error| {
            self.worker = None;
            self.counters.lost += 1;
            self.backlog.push_back(Event::Lost(error.to_string()));
            self.lost(error.to_string())
        })
    }

    fn receive(&mut self, until: Instant) -> Option<FromBoard> {
        self.worker.as_ref()?.receive(until)
    }

    fn receive_surely(&mut self, until: Instant) -> Option<FromBoard> {
        self.worker.as_ref()?.receive_surely(until)
    }

    /// Counts what came; what is worth knowing is returned.
    fn absorb(&mut self, incoming: FromBoard) -> Option<Event> {
        let (line, arrived) = match incoming {
            FromBoard::Line(line, arrived) => (line, arrived),
            FromBoard::Lost(reason) => {
                self.worker = None;
                self.counters.lost += 1;
                return Some(Event::Lost(reason));
            }
        };
        if line.is_whole() {
            self.heard = arrived;
        }
        match line {
            Incoming::Sample(sample) => Some(Event::Sample(self.count(sample, arrived))),
            Incoming::Remark(text) => {
                self.banner_seen |= text.starts_with("softrig ");
                Some(Event::Remark(text))
            }
            // A beat's, or one that came after it was given up.
            Incoming::Reply { .. } => None,
            Incoming::Other(text) => {
                self.counters.unknown += 1;
                Some(Event::Other(text))
            }
            Incoming::Damaged => {
                self.counters.damaged += 1;
                Some(Event::Useless)
            }
        }
    }

    fn count(&mut self, sample: Telemetry, arrived: Instant) -> Received {
        let banner = std::mem::take(&mut self.banner_seen);
        let (restarted, dropped) = match self.last {
            None => (false, 0),
            Some(last) => {
                // A clock that wraps after 49 days moves on by little.
                let went_back = sample.time_ms < last.time_ms
                    && sample.time_ms.wrapping_sub(last.time_ms) > 1 << 31;
                let restarted = banner || went_back;
                let missed = sample.sequence.wrapping_sub(last.sequence.wrapping_add(1));
                (restarted, if restarted { 0 } else { missed })
            }
        };
        self.sampled = arrived;
        self.counters.samples += 1;
        self.counters.dropped += u64::from(dropped);
        self.counters.restarts += u64::from(restarted);
        self.last = Some(sample);
        Received {
            sample,
            arrived,
            restarted,
            dropped,
        }
    }

    /// Opens the port and exchanges names.
    fn connect(&mut self) -> Result<(), LinkError> {
        // The port can be opened only once.
        self.worker = None;
        let channel = self.connector.open()?;
        self.worker = Some(Worker::start(channel));
        let outcome = self.handshake();
        if outcome.is_err() {
            self.worker = None;
        } else {
            // What came until now is the board's; its first sample is yet to come.
            self.take_heard();
            self.sampled = Instant::now();
        }
        outcome
    }

    /// Listens first: a question is only asked once the firmware is heard, or
    /// after a silence that outlasts any bootloader.
    fn handshake(&mut self) -> Result<(), LinkError> {
        let hello = Request {
            id: BEAT_ID - 1,
            command: Command::Hello,
        };
        let again = Duration::from_millis(300);
        let started = Instant::now();
        let mut asked: Option<Instant> = None;
        let (mut whole, mut damaged) = (0, 0);
        while started.elapsed() < self.timing.handshake {
            let pause = asked.is_none_or(|asked| asked.elapsed() > again);
            let incoming = self.receive(Instant::now() + Duration::from_millis(50));
            let ask = match &incoming {
                Some(FromBoard::Line(line, _)) => {
                    if let Incoming::Reply { id, outcome } = line
                        && *id == hello.id
                    {
                        let reply = outcome.clone().unwrap_or_default();
                        return self.introduce(&reply);
                    }
                    whole += u32::from(line.is_whole());
                    damaged += u32::from(!line.is_whole());
                    line.is_whole() && pause
                }
                Some(FromBoard::Lost(reason)) => return Err(self.lost(reason.clone())),
                None => {
                    started.elapsed() > self.timing.listen
                        && asked.is_none_or(|asked| asked.elapsed() > 3 * again)
                }
            };
            if let Some(incoming) = incoming
                && let Some(event) = self.absorb(incoming)
            {
                self.backlog.push_back(event);
            }
            if ask {
                self.send(hello)?;
                asked = Some(Instant::now());
            }
        }
        let port = self.port().to_owned();
        let heard = self.take_heard();
        Err(if heard.is_nothing() {
            LinkError::Silent {
                port,
                seconds: started.elapsed().as_secs_f32(),
            }
        } else {
            let lines = format!("{whole} readable and {damaged} damaged lines");
            LinkError::NotSoftrig {
                port,
                heard: format!("{heard} ({lines})"),
            }
        })
    }

    fn introduce(&mut self, reply: &str) -> Result<(), LinkError> {
        let identity =
            Identity::parse(reply).ok_or_else(|| self.unexpected(Command::Hello, reply))?;
        if identity.wire != VERSION {
            return Err(LinkError::OtherVersion {
                port: self.port().to_owned(),
                theirs: identity.wire,
            });
        }
        self.board = identity.into();
        Ok(())
    }
}
