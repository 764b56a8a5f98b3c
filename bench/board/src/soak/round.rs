// SPDX-License-Identifier: GPL-3.0-or-later
//! A round: arm, run, inject a fault, remove it, clear.

use rand::{RngExt, seq::IndexedRandom};
use wire::{
    command::Command,
    protocol::{Named, check},
    reply::Refusal,
    state::State,
};

use super::{
    draw::{Misfortune, Phase, Plan, Protocol},
    session::{Outcome, Session},
};
use virtual_rig::fault::Fault;

/// Homing over the whole stroke, at the pace of the search (s).
const HOMING_S: f64 = 60.0;

/// A run is not waited for longer than this (s).
const PATIENCE_S: f64 = 40.0;

/// Until the air is out and the sensors are believed again (s).
const SETTLING_S: f64 = 1.2;

impl Session<'_> {
    pub(super) fn play_round(&mut self) -> Outcome {
        let plan = Plan::draw(&mut self.random);
        self.round = format!("{plan:?}");
        self.forget();
        self.pass(0.1)?;
        if plan.phase == Phase::Idle {
            self.suffer(&plan)?;
            return self.recover();
        }
        self.start_homing()?;
        if plan.phase == Phase::Homing {
            self.suffer(&plan)?;
            return self.recover();
        }
        self.until_ready()?;
        if plan.phase == Phase::Ready {
            self.suffer(&plan)?;
            return self.recover();
        }
        if self.start_run(&plan.protocol)? {
            self.suffer(&plan)?;
        }
        self.recover()
    }

    /// `arm`, which may be refused only while the air is on its way out.
    fn start_homing(&mut self) -> Outcome {
        let end_s = self.rig.time_s() + 4.0;
        loop {
            match self.ask(Command::Arm)? {
                Ok(_) => break,
                Err(Refusal::Pressurised) if self.rig.time_s() < end_s => self.pass(0.5)?,
                Err(refusal) => {
                    return self.violation(format!("a rig that is well was not armed: {refusal}"));
                }
            }
        }
        self.until(0.1, "homing", |session| session.state() == State::Homing)
    }

    fn until_ready(&mut self) -> Outcome {
        self.until(HOMING_S, "ready", |session| session.state() == State::Ready)
    }

    /// Loads and starts a protocol; whether it was one.
    fn start_run(&mut self, protocol: &Protocol) -> Outcome<bool> {
        let named = match protocol {
            Protocol::Named(named) => Some(*named),
            Protocol::Own(segments) => {
                let count = u8::try_from(segments.len()).unwrap_or(u8::MAX);
                self.obey(Command::Load(count))?;
                for (index, &segment) in (0..).zip(segments) {
                    self.obey(Command::Segment { index, segment })?;
                }
                if check(&segments[..]).is_err() {
                    return match self.ask(Command::Run(None))? {
                        Err(Refusal::BadProtocol) => Ok(false),
                        other => self.violation(format!("no protocol, and yet: {other:?}")),
                    };
                }
                None
            }
        };
        self.obey(Command::Run(named))?;
        self.summary.runs += 1;
        Ok(true)
    }

    fn suffer(&mut self, plan: &Plan) -> Outcome {
        self.pass(plan.after_s)?;
        let alone = plan.misfortunes.len() == 1;
        let mut mends: Vec<(Misfortune, f64)> = Vec::new();
        for &(kind, after_s, lasts_s) in &plan.misfortunes {
            if !alone {
                self.pass(after_s)?;
            }
            // At any instant of the firmware's period.
            let jitter_s = self.random.random_range(0.0..0.01);
            self.pass(jitter_s)?;
            let lasting = self.lasting();
            let is_cut = lasting.contains(&Misfortune::Broken(Fault::PowerCut));
            let is_unplugged = lasting.contains(&Misfortune::Broken(Fault::Unplugged));
            let is_possible = match kind {
                Misfortune::PortOpened => !is_unplugged && !is_cut,
                Misfortune::Broken(Fault::Hang | Fault::Deaf) => {
                    !is_cut && !self.rig.in_bootloader()
                }
                Misfortune::Broken(fault) => {
                    !lasting.contains(&kind) && (!is_cut || fault != Fault::BrownOut)
                }
                _ => true,
            };
            if is_possible {
                self.strike(kind, alone);
                mends.push((kind, self.rig.time_s() + lasts_s));
            }
        }
        if self.random.random_bool(0.5) {
            let soon_s = self.random.random_range(0.0..0.5);
            self.pass(soon_s)?;
            self.meddle();
        }
        mends.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (kind, at_s) in mends {
            let wait_s = at_s - self.rig.time_s();
            if wait_s > 0.0 {
                self.pass(wait_s)?;
            }
            self.mend(kind);
            // Whoever plugs a cable in again opens the port again, which resets the
            // board; some adapters do not.
            if kind == Misfortune::Broken(Fault::Unplugged) && self.random.random_bool(0.5) {
                self.strike(Misfortune::PortOpened, false);
            }
        }
        Ok(())
    }

    /// Somebody asks for what should not be had, and does not wait for the answer.
    fn meddle(&mut self) {
        let lasting = self.lasting();
        let is_forbidden = lasting.iter().any(|kind| kind.forbids_arming());
        let named = Named::ALL.choose(&mut self.random).copied();
        match self.random.random_range(0..6) {
            // Else it would be allowed, and the pump with it; also where a reset has made
            // the board forget what is mended meanwhile.
            0 | 1 if is_forbidden && !self.was_reset() => {
                self.send(Command::Arm);
            }
            2 => {
                self.send(Command::Run(named));
            }
            3 => {
                self.excuse_end_switch();
                self.send(Command::Clear);
            }
            4 => {
                self.send(Command::Tare);
            }
            _ => {
                self.send(Command::Status);
            }
        }
    }

    /// Everything is mended: faults are cleared, and the rig is idle in the end.
    fn recover(&mut self) -> Outcome {
        for kind in self.lasting() {
            self.mend(kind);
        }
        self.pass(SETTLING_S)?;
        let since_s = self.rig.time_s();
        self.until(3.0, "a sample", |session| session.is_heard(since_s))?;
        if self.state() == State::Running && self.random.random_bool(0.5) {
            let end_s = self.rig.time_s() + PATIENCE_S;
            while self.state() == State::Running && self.rig.time_s() < end_s {
                self.pass(0.05)?;
            }
            if self.state() == State::Ready {
                self.summary.ended += 1;
            }
        }
        if self.state() == State::Fault {
            self.pass(0.3)?;
            self.obey(Command::Clear)?;
            self.summary.clears += 1;
        } else if self.state() != State::Idle {
            self.obey(Command::Stop)?;
        }
        self.until(0.1, "idle", |session| session.state() == State::Idle)?;
        self.forget();
        Ok(())
    }
}
