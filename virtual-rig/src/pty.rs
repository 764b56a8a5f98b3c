// SPDX-License-Identifier: GPL-3.0-or-later
//! A pseudo-terminal that stands in for the board's USB port.
//!
//! The other end looks like any serial port. Nobody holds it open here, so the
//! kernel reports a hang-up exactly as long as no client has it open: that is
//! how opening and closing are noticed, where a real board sees DTR.

use std::{
    io,
    os::fd::OwnedFd,
    path::{Path, PathBuf},
    time::Duration,
};

use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    fs::{Mode, OFlags},
    io::Errno,
    pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
    termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr},
};

/// The board's end of a pseudo-terminal.
pub struct Port {
    master: OwnedFd,
    path: PathBuf,
    connected: bool,
}

/// What a client did with the port since the last look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing.
    None,
    /// It opened it.
    Opened,
    /// It closed it; the bytes that it had sent before.
    Closed,
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
        let slave = rustix::fs::open(
            &path,
            OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC,
            Mode::empty(),
        )?;
        let mut settings = tcgetattr(&slave)?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings)?;
        let flags = rustix::fs::fcntl_getfl(&master)?;
        rustix::fs::fcntl_setfl(&master, flags | OFlags::NONBLOCK)?;
        Ok(Self {
            master,
            path,
            connected: false,
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
        let change = match (self.connected, connected) {
            (false, true) => Change::Opened,
            (true, false) => {
                // The next client must not read what this one left.
                tcflush(&self.master, QueueSelector::OFlush)?;
                Change::Closed
            }
            _ => Change::None,
        };
        self.connected = connected;
        Ok(change)
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

    fn poll(&self, wanted: PollFlags, time: Duration) -> io::Result<PollFlags> {
        let mut polled = [PollFd::new(&self.master, wanted)];
        let time = Timespec::try_from(time).map_err(io::Error::other)?;
        match poll(&mut polled, Some(&time)) {
            Ok(_) | Err(Errno::INTR) => Ok(polled[0].revents()),
            Err(error) => Err(error.into()),
        }
    }
}
