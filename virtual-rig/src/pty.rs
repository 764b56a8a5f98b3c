// SPDX-License-Identifier: GPL-3.0-or-later
//! A pseudo-terminal in place of the board's USB port.
//!
//! The other end looks like any serial port. This program does not hold it open, so the
//! kernel reports a hang-up exactly while no client has it open. That shows opening and
//! closing, where a real board sees DTR. A client that follows another within a
//! millisecond is detected by watching the file.

use std::{
    io,
    mem::MaybeUninit,
    os::fd::OwnedFd,
    path::{Path, PathBuf},
    time::Duration,
};

use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::{Mode, OFlags, inotify},
    io::Errno,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr},
};

/// The board's end of a pseudo-terminal.
pub struct Port {
    master: OwnedFd,
    path: PathBuf,
    connected: bool,
    /// Reports every opening and closing.
    watch: OwnedFd,
}

/// A client's action on the port since the last look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing.
    None,
    /// It opened it.
    Opened,
    /// It closed it.
    Closed,
    /// One closed it and the next has already opened it.
    Reopened,
}

impl Port {
    /// Creates a pseudo-terminal in raw mode that nobody has open.
    pub fn new() -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let name = ptsname(&master, Vec::new())?;
        let name = name.into_string().map_err(io::Error::other)?;
        let path = PathBuf::from(name);
        // A terminal would echo and translate line ends. The settings stay when
        // this end is closed again, and only then is there a hang-up to see.
        let client = open_client_end(&path)?;
        let mut settings = tcgetattr(&client)?;
        settings.make_raw();
        tcsetattr(&client, OptionalActions::Now, &settings)?;
        let flags = rustix::fs::fcntl_getfl(&master)?;
        rustix::fs::fcntl_setfl(&master, flags | OFlags::NONBLOCK)?;
        let watch = inotify::init(inotify::CreateFlags::NONBLOCK | inotify::CreateFlags::CLOEXEC)?;
        inotify::add_watch(
            &watch,
            &path,
            inotify::WatchFlags::OPEN | inotify::WatchFlags::CLOSE,
        )?;
        Ok(Self {
            master,
            path,
            connected: false,
            watch,
        })
    }

    /// The path that clients open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether a client has the port open.
    pub fn connected(&self) -> bool {
        self.connected
    }

    /// Looks whether a client came or went.
    pub fn look(&mut self) -> io::Result<Change> {
        let events = self.poll(PollFlags::IN, Duration::ZERO)?;
        let connected = !events.contains(PollFlags::HUP);
        let closed_then_opened = self.closed_then_opened()?;
        let change = match (self.connected, connected) {
            (false, true) => Change::Opened,
            (true, false) => {
                self.forget_unread()?;
                Change::Closed
            }
            (true, true) if closed_then_opened => {
                self.forget_unread()?;
                Change::Reopened
            }
            _ => Change::None,
        };
        self.connected = connected;
        Ok(change)
    }

    /// The next client must not read what this one left.
    fn forget_unread(&self) -> io::Result<()> {
        tcflush(open_client_end(&self.path)?, QueueSelector::IFlush)?;
        // That was nobody else.
        self.closed_then_opened()?;
        Ok(())
    }

    fn closed_then_opened(&self) -> io::Result<bool> {
        let mut buffer = [MaybeUninit::uninit(); 512];
        let mut events = inotify::Reader::new(&self.watch, &mut buffer);
        let (mut closed, mut reopened) = (false, false);
        loop {
            match events.next() {
                Ok(event) => {
                    let what = event.events();
                    closed |= what.intersects(
                        inotify::ReadFlags::CLOSE_WRITE | inotify::ReadFlags::CLOSE_NOWRITE,
                    );
                    reopened |= closed && what.contains(inotify::ReadFlags::OPEN);
                }
                Err(Errno::AGAIN) => return Ok(reopened),
                Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Reads what has arrived, without waiting.
    pub fn read(&mut self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut buffer = [0; 1024];
        loop {
            match rustix::io::read(&self.master, &mut buffer) {
                // Hung up.
                Ok(0) | Err(Errno::IO | Errno::AGAIN) => return Ok(bytes),
                Ok(length) => bytes.extend_from_slice(&buffer[..length]),
                Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Writes as much of `bytes` as there is room for and removes it.
    pub fn write(&mut self, bytes: &mut Vec<u8>) -> io::Result<()> {
        while !bytes.is_empty() {
            match rustix::io::write(&self.master, bytes) {
                Ok(length) => {
                    bytes.drain(..length);
                }
                Err(Errno::AGAIN) => return Ok(()),
                Err(Errno::INTR) => {}
                // The client went away; the next look tells.
                Err(Errno::IO) => bytes.clear(),
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Waits until there is room to write, the client goes, or time is up.
    pub fn wait_for_room(&mut self, time: Duration) -> io::Result<()> {
        self.poll(PollFlags::OUT, time).map(drop)
    }

    /// Waits until the client sends something, at most for `time`.
    ///
    /// # Errors
    ///
    /// Errors of the operating system.
    pub fn wait_for_bytes(&mut self, time: Duration) -> io::Result<()> {
        self.poll(PollFlags::IN, time).map(drop)
    }

    fn poll(&self, wanted: PollFlags, time: Duration) -> io::Result<PollFlags> {
        let mut polled = [PollFd::new(&self.master, wanted)];
        let time = Timespec::try_from(time).map_err(io::Error::other)?;
        match poll(&mut polled, Some(&time)) {
            Ok(_) | Err(Errno::INTR) => Ok(polled[0].revents()),
            Err(error) => Err(error.into()),
        }
    }
}

fn open_client_end(path: &Path) -> io::Result<OwnedFd> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    Ok(rustix::fs::open(path, flags, Mode::empty())?)
}
