//! The operations of a board.

use std::time::Duration;

use softrig_formats::instant::Instant;
use wire::answer::{Bits, Identity, ImageSum, Machine, Raw, SettingsId, Status, Switches};
use wire::command::Command;
use wire::fault::Fault;
use wire::reply::Refusal;
use wire::settings::{Key, Settings};
use wire::state::State;

use super::client::{Event, Link};
use super::error::LinkError;

/// The last air of a run goes out in a fraction of a second: who arms before it has is
/// early, not wrong.
const VENTING: Duration = Duration::from_secs(3);
/// Homing goes through the syringe's whole length, slowly.
const HOMING: Duration = Duration::from_secs(90);
/// Measuring the stroke homes twice and goes through it twice.
const MEASURING: Duration = Duration::from_secs(400);
/// All settings are in EEPROM after this at the latest: 3.3 ms a byte.
const SAVING: Duration = Duration::from_secs(6);

/// A board's identity: an owned [`Identity`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Board {
    /// Version of the firmware.
    pub firmware: String,
    /// Version of the serial protocol.
    pub wire: u8,
    /// The settings in use.
    pub settings: SettingsId,
    /// The program in its flash; none for one whose build wrote no checksum.
    pub image: Option<ImageSum>,
}

impl From<Identity<'_>> for Board {
    fn from(identity: Identity<'_>) -> Self {
        let Identity {
            firmware,
            wire,
            settings,
            image,
        } = identity;
        Self {
            firmware: firmware.to_owned(),
            wire,
            settings,
            image,
        }
    }
}

/// Settings that were not changed, or not surely.
#[derive(Debug, thiserror::Error)]
#[error("{}", if *.accepted {
    "the board accepted the settings, and it is not certain that they are stored"
} else {
    "nothing was changed: the board still uses its old settings"
})]
pub struct NotChanged {
    /// Whether the board uses the new settings already.
    pub accepted: bool,
    /// The error of the link.
    pub source: Box<LinkError>,
}

/// The value of a setting that is a number.
pub fn float(bits: u32) -> f32 {
    f32::from_bits(bits)
}

impl Link {
    /// Asks for the state.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn status(&mut self) -> Result<Status, LinkError> {
        let reply = self.request(Command::Status)?;
        Status::parse(&reply).ok_or_else(|| self.unexpected(Command::Status, &reply))
    }

    /// Asks for the bits of a setting.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn get(&mut self, key: Key) -> Result<u32, LinkError> {
        let command = Command::Get(key);
        let reply = self.request(command)?;
        match Bits::parse(&reply) {
            Some(Bits(bits)) => Ok(bits),
            None => Err(self.unexpected(command, &reply)),
        }
    }

    /// Asks for what the ADC converts.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn raw(&mut self) -> Result<Raw, LinkError> {
        let reply = self.request(Command::Raw)?;
        Raw::parse(&reply).ok_or_else(|| self.unexpected(Command::Raw, &reply))
    }

    /// Asks which switches are open.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn switches(&mut self) -> Result<Switches, LinkError> {
        let reply = self.request(Command::Switches)?;
        Switches::parse(&reply).ok_or_else(|| self.unexpected(Command::Switches, &reply))
    }

    /// Asks what the board found out about its pump.
    ///
    /// # Errors
    ///
    /// [`LinkError`]; a firmware of before there was this request refuses it as unknown.
    pub fn machine(&mut self) -> Result<Machine, LinkError> {
        let reply = self.request(Command::Machine)?;
        Machine::parse(&reply).ok_or_else(|| self.unexpected(Command::Machine, &reply))
    }

    /// Reads all settings; `progress` hears how many of how many are read.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn read_settings(
        &mut self,
        mut progress: impl FnMut(u64, u64),
    ) -> Result<Settings, LinkError> {
        let mut words = *Settings::DEFAULT.words();
        let total = words.len() as u64;
        for (done, key) in (1..).zip(Key::all()) {
            let bits = self.get(key)?;
            if let Some(place) = key
                .index()
                .and_then(|index| words.get_mut(usize::from(index)))
            {
                *place = bits;
            }
            progress(done, total);
        }
        Ok(Settings::from_words(words))
    }

    /// Learns how long the board bears silence, and beats accordingly.
    ///
    /// # Errors
    ///
    /// [`LinkError`].
    pub fn learn_patience(&mut self) -> Result<(), LinkError> {
        let seconds = float(self.get(Key::HostTimeout)?);
        if seconds.is_finite() && seconds > 0.0 {
            self.set_patience(Duration::from_secs_f32(seconds.min(3600.0)));
        }
        Ok(())
    }

    /// Homes the plunger and waits until the rig is ready; `handler` gets every
    /// event meanwhile, and stops the wait by returning false.
    ///
    /// # Errors
    ///
    /// [`LinkError`]; the fault if homing ends in one.
    pub fn arm(&mut self, handler: &mut dyn FnMut(Event) -> bool) -> Result<bool, LinkError> {
        self.home(Command::Arm, HOMING, handler)
    }

    /// Measures the stroke between the end switches, as [`Self::arm`] homes; the board keeps it, and
    /// [`Self::machine`] tells it.
    ///
    /// # Errors
    ///
    /// [`LinkError`]; the fault if it ends in one.
    pub fn measure_stroke(
        &mut self,
        handler: &mut dyn FnMut(Event) -> bool,
    ) -> Result<bool, LinkError> {
        self.home(Command::Stroke, MEASURING, handler)
    }

    fn home(
        &mut self,
        command: Command,
        patience: Duration,
        handler: &mut dyn FnMut(Event) -> bool,
    ) -> Result<bool, LinkError> {
        let mut go_on = true;
        let vented = Instant::now() + VENTING;
        let asked = loop {
            let asked = self.request_with(command, &mut |event| go_on &= handler(event));
            let is_early = matches!(
                asked,
                Err(LinkError::Refused {
                    refusal: Refusal::Pressurised,
                    ..
                })
            );
            if !is_early || !go_on || Instant::now() > vented {
                break asked;
            }
            if let Some(event) = self.next_event(Duration::from_millis(100)) {
                go_on &= handler(event);
            }
        };
        match asked {
            // Or it was armed at first hearing, and only the reply was lost.
            Ok(_)
            | Err(LinkError::Refused {
                refusal: Refusal::NotNow,
                retried: true,
                ..
            }) => {}
            Err(LinkError::Refused {
                refusal: Refusal::LowSupply,
                ..
            }) => return Err(self.low_supply()),
            Err(error) => return Err(error),
        }
        // Telemetry that was on its way still says idle.
        let mut left_idle = false;
        let until = Instant::now() + patience;
        while go_on && Instant::now() < until {
            let Some(event) = self.next_event(Duration::from_millis(100)) else {
                if !self.is_connected() {
                    return Err(self.lost("while the rig was being armed"));
                }
                continue;
            };
            let sample = match &event {
                Event::Sample(received) => Some(received.sample),
                _ => None,
            };
            go_on &= handler(event);
            let Some(sample) = sample else { continue };
            match sample.state {
                State::Ready => return Ok(true),
                State::Homing => left_idle = true,
                State::Fault => return Err(self.not_armed(sample.fault)),
                State::Idle if left_idle => {
                    return Err(self.late(
                        "the board stopped homing without a fault",
                        "see `softrig monitor`, and arm again",
                    ));
                }
                State::Idle | State::Running => {}
            }
        }
        if !go_on {
            return Ok(false);
        }
        Err(self.late(
            &format!("the plunger was not homed within {} s", patience.as_secs()),
            "check the retracted end switch and the pump",
        ))
    }

    /// The error for a fault in telemetry.
    pub fn faulted(&self, code: u8) -> LinkError {
        let port = self.port().to_owned();
        let fault = Fault::from_code(code).unwrap_or(Fault::Internal);
        match self.silence() {
            // One that was latched before has nothing to do with this link.
            Some(silence) if fault == Fault::HostLost && !silence.longest.is_zero() => {
                LinkError::ComputerLost { port, silence }
            }
            _ => LinkError::Faulted { port, fault },
        }
    }

    /// The error for a board that stopped while it was armed, with what it measured of its sensor.
    fn not_armed(&mut self, code: u8) -> LinkError {
        if code != Fault::Late.code() {
            return self.faulted(code);
        }
        let Ok(Some(delay_ms)) = self.machine().map(|machine| machine.delay_ms) else {
            return self.faulted(code);
        };
        let sentence = Fault::Late.sentence();
        let (found, advice) = sentence.split_once(": ").unwrap_or((sentence, ""));
        let found = found.to_lowercase();
        self.late(
            &format!(
                "the board stopped with fault {code}: {found} (it shows the air {delay_ms} ms after it has gone)"
            ),
            advice,
        )
    }

    /// The error for a board that is not armed for its supply, with what that is.
    fn low_supply(&mut self) -> LinkError {
        let sentence = Refusal::LowSupply.sentence();
        let (found, advice) = sentence.split_once(": ").unwrap_or((sentence, ""));
        let supply = match self.machine().map(|machine| machine.supply_mv) {
            Ok(Some(mv)) => format!(" (it is {:.2} V)", f64::from(mv) / 1000.0),
            Ok(None) | Err(_) => String::new(),
        };
        self.late(&format!("nothing was moved: {found}{supply}"), advice)
    }

    /// The error for something that did not happen.
    pub fn late(&self, what: &str, advice: &str) -> LinkError {
        LinkError::Late {
            port: self.port().to_owned(),
            what: what.to_owned(),
            advice: advice.to_owned(),
        }
    }

    /// Changes settings: drafts all, saves, waits until the EEPROM has them,
    /// and compares every bit that the board then uses.
    ///
    /// `progress` hears how many of how many exchanges are done.
    ///
    /// # Errors
    ///
    /// [`NotChanged`]. Until the board has accepted all of them together it uses
    /// its old settings; a draft that failed is dropped.
    pub fn change_settings(
        &mut self,
        changes: &[(Key, u32)],
        mut progress: impl FnMut(u64, u64),
    ) -> Result<(), NotChanged> {
        self.check_rest(
            "settings are changed only while nothing moves: stop it first (`softrig monitor`, key s)",
        )
        .map_err(|source| NotChanged {
            accepted: false,
            source: Box::new(source),
        })?;
        let total = 2 * changes.len() as u64 + 1;
        let drafted = self.draft(changes, &mut |done| progress(done, total));
        if let Err(source) = drafted {
            // What failed may be the link itself.
            let _ = self.request(Command::Discard);
            return Err(NotChanged {
                accepted: false,
                source: Box::new(source),
            });
        }
        self.save()?;
        self.compare(changes, &mut |done| progress(done, total))
            .map_err(|source| NotChanged {
                accepted: true,
                source: Box::new(source),
            })
    }

    /// Refuses what needs a rig that does nothing; the advice is for one that moves.
    pub(crate) fn check_rest(&mut self, advice: &str) -> Result<(), LinkError> {
        let state = self.status()?.state;
        if matches!(state, State::Idle | State::Fault) {
            return Ok(());
        }
        Err(self.late(&format!("the board is {}", state.name()), advice))
    }

    fn draft(
        &mut self,
        changes: &[(Key, u32)],
        progress: &mut dyn FnMut(u64),
    ) -> Result<(), LinkError> {
        // A draft that someone left behind must not be saved with ours.
        self.request(Command::Discard)?;
        for (done, &(key, bits)) in (1..).zip(changes) {
            self.request(Command::Set { key, bits })?;
            progress(done);
        }
        Ok(())
    }

    fn compare(
        &mut self,
        changes: &[(Key, u32)],
        progress: &mut dyn FnMut(u64),
    ) -> Result<(), LinkError> {
        for (done, &(key, bits)) in (changes.len() as u64 + 2..).zip(changes) {
            let read_back = self.get(key)?;
            if read_back != bits {
                return Err(self.late(
                    &format!(
                        "{} was written as {bits:08x} and read back as {read_back:08x}",
                        softrig_formats::settings_file::key_text(key)
                    ),
                    "upload again; if it happens again the EEPROM is worn out",
                ));
            }
            progress(done);
        }
        Ok(())
    }

    /// Saves the draft and waits for the remark that the EEPROM has it.
    fn save(&mut self) -> Result<(), NotChanged> {
        let refused = |source| NotChanged {
            accepted: false,
            source: Box::new(source),
        };
        let unconfirmed = |source| NotChanged {
            accepted: true,
            source: Box::new(source),
        };
        let mut saved = false;
        let mut failed = false;
        let hear = |text: &str, saved: &mut bool, failed: &mut bool| {
            *failed |= text.starts_with("not saved");
            *saved |= text.starts_with("saved");
        };
        let accepted = self.request_with(Command::Save, &mut |event| {
            if let Event::Remark(text) = &event {
                hear(text, &mut saved, &mut failed);
            }
        });
        match accepted {
            // Or accepted at first hearing, and only the reply was lost.
            Ok(_)
            | Err(LinkError::Refused {
                refusal: Refusal::NotNow,
                retried: true,
                ..
            }) => {}
            Err(source) => {
                let _ = self.request(Command::Discard);
                return Err(refused(source));
            }
        }
        let until = Instant::now() + SAVING;
        loop {
            match (saved, failed) {
                (_, true) => break,
                (true, false) => return Ok(()),
                _ if Instant::now() >= until => break,
                _ => {}
            }
            let Some(event) = self.next_event(Duration::from_millis(50)) else {
                if !self.is_connected() {
                    return Err(unconfirmed(
                        self.lost("while the settings were being saved"),
                    ));
                }
                continue;
            };
            if let Event::Remark(text) = &event {
                hear(text, &mut saved, &mut failed);
            }
        }
        Err(unconfirmed(self.late(
            "the board did not confirm that the settings are in its EEPROM",
            "upload again; if it happens again the EEPROM is worn out",
        )))
    }
}
