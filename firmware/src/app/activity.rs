//! The present activity of the board, with its memory.
//!
//! The state of [`crate::safety`] says what the rig may do; an [`Activity`] is what it
//! does. Leaving an activity drops its memory, so that nothing of a run is left when the
//! next begins.

use wire::{
    decimal::Hundredths,
    fault::Fault,
    protocol::{ControlMode, Reference},
    settings::{Key, Settings},
    telemetry::Setpoint,
};

use model_core::predictor::Predictor;

use crate::{
    control::{self, Controller, Measured, limit},
    design::{PERIOD_S, RETURN_S, VENTING_PERIODS},
    homing::{self, Homing},
    io::{Outputs, Pump, Valve},
    monitor::Monitor,
    runner::{Memory, Runner},
    units::{DEG_PER_RAD, KPA_PER_PA},
};

/// Tolerance (microsteps) of the start position.
const BACK_STEPS: f32 = 3.0;

/// The present activity of the board.
#[derive(Clone, Debug)]
pub(super) enum Activity {
    /// None: idle, ready, or in a fault.
    None,
    /// Homing.
    Homing(Homing),
    /// A protocol.
    Playing(Play),
}

/// A protocol that is being played.
#[derive(Clone, Debug)]
pub(super) struct Play {
    runner: Runner,
    controller: Controller,
    setpoint: Setpoint,
    /// Periods for which the plunger has been back at its start.
    back: u8,
    /// Time (s) for which the plunger has been on its way there.
    returning: f32,
}

/// The inputs of a run in one period.
pub(super) struct PlayInputs<'a> {
    pub(super) settings: &'a Settings,
    /// The most that the pump may displace (µl), and by the air behind it.
    pub(super) largest: f32,
    pub(super) most: f32,
    pub(super) memory: &'a Memory,
    pub(super) predictor: &'a Predictor,
    pub(super) monitor: &'a Monitor,
    pub(super) measured: &'a Measured<'a>,
    /// Whether there is pressure with the valve open.
    pub(super) pressurised: bool,
}

/// The result of one period of a run.
pub(super) enum Progress {
    /// Going on.
    Playing(Outputs),
    /// The last segment is over, and the plunger is back at its start.
    Done(Outputs),
    /// The controller found something wrong.
    Failed(Fault),
}

impl Play {
    /// Begins a run.
    pub(super) fn new(runner: Runner) -> Self {
        Self {
            runner,
            controller: Controller::new(),
            setpoint: Setpoint::None,
            back: 0,
            returning: 0.0,
        }
    }

    /// The position in the protocol.
    pub(super) fn runner(&self) -> &Runner {
        &self.runner
    }

    /// The set-point now.
    pub(super) fn setpoint(&self) -> Setpoint {
        self.setpoint
    }

    /// The controller.
    #[cfg(test)]
    pub(super) fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Lets one control period pass.
    #[inline(never)]
    pub(super) fn step(&mut self, given: &PlayInputs) -> Progress {
        let delay_s = given.predictor.delay_s();
        let config =
            control::Config::of(given.settings, given.largest, given.most).with_delay(delay_s);
        let per_step = given.settings.number(Key::VolumePerStep);
        let reference = self.runner.reference(given.memory);
        let closed = |flow: f32| Outputs {
            pump: Pump::Rate(flow / per_step),
            valve: Valve::Closed,
            ..Outputs::default()
        };
        let outputs = match reference {
            Reference::Track { mode, level } => {
                self.back = 0;
                self.returning = 0.0;
                let mut measured = *given.measured;
                if mode == ControlMode::AngleClosedLoop {
                    measured.prediction = given.monitor.prediction();
                }
                let reference = (mode, level);
                let flow = self
                    .controller
                    .track(&config, given.predictor, reference, &measured);
                self.setpoint = if mode == ControlMode::Pressure {
                    let pressure = self.controller.pressure_setpoint();
                    Setpoint::Pressure(Hundredths::round(pressure * KPA_PER_PA))
                } else {
                    let angle = self.controller.angle_setpoint();
                    Setpoint::Angle(Hundredths::round(angle * DEG_PER_RAD))
                };
                closed(flow)
            }
            Reference::Hold => {
                self.setpoint = Setpoint::None;
                self.returning = 0.0;
                closed(0.0)
            }
            Reference::Release | Reference::Done => {
                self.controller = Controller::new();
                self.setpoint = Setpoint::None;
                let start = homing::Config::of(given.settings).start_volume();
                let gap = start - given.measured.volume;
                let is_back = limit::size(gap) <= BACK_STEPS * per_step;
                self.back = if is_back {
                    self.back.saturating_add(1)
                } else {
                    0
                };
                let flow = if is_back {
                    0.0
                } else {
                    config.pressure.approach(gap)
                };
                Outputs {
                    pump: Pump::Rate(flow / per_step),
                    ..Outputs::default()
                }
            }
        };
        if let Some(fault) = self.controller.fault() {
            return Progress::Failed(fault);
        }
        // Behind a narrow tube the air needs longer than the plunger.
        let is_back = self.back >= VENTING_PERIODS && !given.pressurised;
        if matches!(reference, Reference::Release | Reference::Done) && !is_back {
            self.returning += PERIOD_S;
            let stroke_s = given.largest / given.settings.number(Key::MaxFlow);
            if self.returning > RETURN_S + 2.0 * stroke_s {
                return Progress::Failed(Fault::Internal);
            }
        }
        if reference == Reference::Done {
            if is_back {
                return Progress::Done(outputs);
            }
        } else {
            self.runner.advance(given.memory, is_back);
        }
        Progress::Playing(outputs)
    }
}
