//! What a board remembers of its faults.

use std::time::Duration;

use softrig_formats::instant::{Instant, sleep};
use wire::command::Command;
use wire::history::{FaultRecord, LOGGED, MOMENTS, Moment};
use wire::reply::Refusal;

use super::client::Link;
use super::error::LinkError;

/// In which time a fault is in the EEPROM: 22 bytes, one a period, and as many of the one before.
const WRITTEN: Duration = Duration::from_secs(1);

impl Link {
    /// The faults in the board's log, the latest first; damaged records are left out.
    ///
    /// # Errors
    ///
    /// [`LinkError`]; a board that is armed refuses.
    pub fn fault_log(&mut self) -> Result<Vec<FaultRecord>, LinkError> {
        let written = Instant::now() + WRITTEN;
        let mut log = Vec::new();
        let mut back = 0;
        while back < LOGGED {
            let command = Command::Log(back);
            match self.request(command) {
                Ok(reply) => log.push(
                    FaultRecord::parse(&reply).ok_or_else(|| self.unexpected(command, &reply))?,
                ),
                Err(LinkError::Refused {
                    refusal: Refusal::Nothing,
                    ..
                }) => {}
                // It writes one just now: from the beginning, since all have moved on by one.
                Err(LinkError::Refused {
                    refusal: Refusal::NotNow,
                    ..
                }) if Instant::now() < written => {
                    sleep(Duration::from_millis(50));
                    log.clear();
                    back = 0;
                    continue;
                }
                Err(error) => return Err(error),
            }
            back += 1;
        }
        Ok(log)
    }

    /// The second before the latched fault, in order of time; empty without a fault.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn past(&mut self) -> Result<Vec<Moment>, LinkError> {
        let mut past = Vec::new();
        for back in 0..MOMENTS {
            let command = Command::Past(back);
            match self.request(command) {
                Ok(reply) => past
                    .push(Moment::parse(&reply).ok_or_else(|| self.unexpected(command, &reply))?),
                Err(LinkError::Refused {
                    refusal: Refusal::Nothing,
                    ..
                }) => break,
                Err(error) => return Err(error),
            }
        }
        past.reverse();
        Ok(past)
    }
}
