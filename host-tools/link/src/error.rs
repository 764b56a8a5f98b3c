//! Errors of the link between `softrig` and a board, with advice.

use wire::fault::Fault;
use wire::reply::{Refusal, VERSION};

use super::heart::Silence;
use softrig_formats::error::InputError;

/// A failed exchange with a board.
///
/// Every message names the port and ends in an action, as those of
/// [`InputError`] do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The port cannot be opened: an argument is wrong or a right is missing.
    #[error(transparent)]
    Open(#[from] InputError),
    /// The port is open and nothing comes.
    #[error(
        "{port}: not a byte came in {seconds:.1} s; check that the board has power, and flash the firmware with `softrig flash --port {port}`"
    )]
    Silent {
        /// The port.
        port: String,
        /// How long was listened.
        seconds: f32,
    },
    /// Something comes, and it is not our firmware.
    #[error(
        "{port}: {heard}, but no softrig firmware answered; check that this is the right port (`softrig ports`), or flash the firmware with `softrig flash --port {port}`"
    )]
    NotSoftrig {
        /// The port.
        port: String,
        /// The text received.
        heard: String,
    },
    /// The firmware speaks another version of the protocol.
    #[error(
        "{port}: the firmware speaks version {theirs} of the serial protocol, softrig version {VERSION}; {}",
        if *.theirs < VERSION {
            "flash matching firmware with `softrig flash`"
        } else {
            "update softrig to match the firmware"
        }
    )]
    OtherVersion {
        /// The port.
        port: String,
        /// The board's version.
        theirs: u8,
    },
    /// No reply, although asked more than once.
    #[error(
        "{port}: the board did not answer `{command}`, asked {attempts} times; check the cable, and press the board's reset button if it stays silent"
    )]
    NoReply {
        /// The port.
        port: String,
        /// The request.
        command: String,
        /// How often.
        attempts: u8,
    },
    /// The board understood and will not.
    #[error("{port}: the board refused `{command}`: {refusal}")]
    Refused {
        /// The port.
        port: String,
        /// The request.
        command: String,
        /// Why not.
        refusal: Refusal,
        /// Whether it had been asked more than once: the first request may have
        /// been obeyed and its reply lost.
        retried: bool,
    },
    /// A reply that makes no sense.
    #[error(
        "{port}: the board answered `{command}` with \"{reply}\"; check that firmware and softrig have one version"
    )]
    Unexpected {
        /// The port.
        port: String,
        /// The request.
        command: String,
        /// The answer.
        reply: String,
    },
    /// The connection broke.
    #[error("{port}: the connection was lost ({reason}); check the cable and the board's power")]
    Lost {
        /// The port.
        port: String,
        /// The system's message.
        reason: String,
    },
    /// The board stopped by itself.
    #[error("{port}: the board stopped with fault {} ({}). {}", .fault.code(), .fault.name(), .fault.sentence())]
    Faulted {
        /// The port.
        port: String,
        /// Why.
        fault: Fault,
    },
    /// The board heard nothing of us, and stopped.
    #[error("{port}: the board stopped with fault {} ({}): {silence}; then record again with --clear", Fault::HostLost.code(), Fault::HostLost.name())]
    ComputerLost {
        /// The port.
        port: String,
        /// Times of the heartbeats around it.
        silence: Silence,
    },
    /// The board did not reach a state in time.
    #[error("{port}: {what}; {advice}")]
    Late {
        /// The port.
        port: String,
        /// The event that did not happen.
        what: String,
        /// Advice.
        advice: String,
    },
}
