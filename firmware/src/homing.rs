//! Homing: finds the position of the plunger.
//!
//! The step counter is lost at every reset. With the valve open, the plunger moves back
//! until the end switch closes, then slowly forward until it releases; that edge is
//! volume zero. Then it moves to a start position somewhat inside, so that the return
//! after a release does not hit the switch.

use wire::{
    fault::Fault,
    settings::{Key, Settings},
};

use crate::{
    design::homing::{
        EDGE_SHARE, FASTEST_SEARCH, LONGEST_BACK_OFF, LONGEST_SEARCH, LONGEST_STANDSTILL,
        SEARCH_SHARE, START_SHARE, START_UL,
    },
    io::{Inputs, Outputs, Pump, Valve},
};

/// Periods for which a released switch has to stay so.
const CLEAR: u8 = 10;

/// Periods that the pump is given to stop, and the board to set its counter.
const SETTLING: u8 = 5;

/// Distances and speeds, from the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    max_volume: f32,
    max_flow: f32,
    volume_per_step: f32,
}

impl Config {
    /// Reads the settings.
    pub fn of(settings: &Settings) -> Self {
        Self {
            max_volume: settings.number(Key::MaxVolume),
            max_flow: settings.number(Key::MaxFlow),
            volume_per_step: settings.number(Key::VolumePerStep),
        }
    }

    /// The volume (µl) from which every run starts.
    pub fn start_volume(&self) -> f32 {
        START_UL.min(self.max_volume * START_SHARE)
    }

    fn rate(&self, share: f32) -> f32 {
        FASTEST_SEARCH.min(self.max_flow * share) / self.volume_per_step
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Going back to the switch.
    Search,
    /// It answers: standing still, and looking whether it goes on. A spike on its wire does not.
    Stop,
    /// Leaving it.
    BackOff,
    /// It let go: standing still, the counter becomes zero.
    Zero,
    /// Going to the start position.
    Approach,
}

/// The progress of homing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Homing {
    phase: Phase,
    /// Position (microsteps) at which the phase began.
    from: i32,
    before: i32,
    /// Periods spent standing.
    standing: u8,
    /// Periods for which the pushed-in switch has been open.
    clear: u8,
}

/// The result of one period of homing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// Going on.
    Moving(Outputs),
    /// The plunger is at its start position.
    Done,
    /// The switch cannot be right, or the plunger does not move.
    Failed(Fault),
}

impl Homing {
    /// Starts wherever the plunger is.
    pub fn start(inputs: &Inputs) -> Self {
        Self {
            phase: if inputs.retracted_end {
                Phase::Stop
            } else {
                Phase::Search
            },
            from: inputs.steps,
            before: inputs.steps,
            standing: 0,
            clear: if inputs.pushed_end { 0 } else { CLEAR },
        }
    }

    /// Lets one control period pass.
    pub fn step(&mut self, config: &Config, inputs: &Inputs) -> Progress {
        let moved = inputs.steps.wrapping_sub(self.from) as f32 * config.volume_per_step;
        let moves = inputs.steps != self.before;
        self.before = inputs.steps;
        match self.phase {
            Phase::Stop | Phase::Zero => {
                self.standing = self.standing.saturating_add(1);
            }
            _ if moves => self.standing = 0,
            _ => {
                self.standing = self.standing.saturating_add(1);
                if self.standing > LONGEST_STANDSTILL {
                    return Progress::Failed(Fault::Stall);
                }
            }
        }
        let settled = self.standing >= SETTLING;
        let let_go = config.max_volume * LONGEST_BACK_OFF;
        // A lever that is left may bounce once more.
        let is_clear = self.clear >= CLEAR;
        if !is_clear {
            self.clear = if inputs.pushed_end { 0 } else { self.clear + 1 };
        }
        let mut set_steps = None;
        match self.phase {
            Phase::Search if inputs.pushed_end && (is_clear || -moved > let_go) => {
                return Progress::Failed(Fault::MotorReversed);
            }
            // The search goes on from where it began, so that switches that flicker cannot
            // make it endless.
            Phase::Search if inputs.retracted_end => self.enter(Phase::Stop, self.from),
            Phase::Search if -moved > config.max_volume * LONGEST_SEARCH => {
                return Progress::Failed(Fault::Stall);
            }
            Phase::Stop if !inputs.retracted_end => self.enter(Phase::Search, self.from),
            Phase::Stop if settled => self.enter(Phase::BackOff, inputs.steps),
            Phase::BackOff if inputs.pushed_end => return Progress::Failed(Fault::EndSwitch),
            Phase::BackOff if !inputs.retracted_end => {
                self.enter(Phase::Zero, 0);
                self.before = 0;
                set_steps = Some(0);
            }
            Phase::BackOff if moved > let_go => {
                return Progress::Failed(Fault::RetractedSwitch);
            }
            Phase::Zero if settled => self.enter(Phase::Approach, inputs.steps),
            Phase::Approach
                if inputs.steps as f32 * config.volume_per_step >= config.start_volume() =>
            {
                return Progress::Done;
            }
            _ => {}
        }
        let pump = match self.phase {
            Phase::Search => Pump::Rate(-config.rate(SEARCH_SHARE)),
            Phase::BackOff | Phase::Approach => Pump::Rate(config.rate(EDGE_SHARE)),
            Phase::Stop | Phase::Zero => Pump::Brake,
        };
        Progress::Moving(Outputs {
            pump,
            valve: Valve::Open,
            set_steps,
            light: false,
        })
    }

    fn enter(&mut self, phase: Phase, from: i32) {
        *self = Self {
            phase,
            from,
            standing: 0,
            ..*self
        };
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::{design::PERIOD_S, plant::Plant};

    /// Homes a plant; the seconds it took, or the fault.
    fn home(plant: &mut Plant) -> Result<f64, Fault> {
        let config = Config::of(&plant.settings);
        let mut homing = Homing::start(&plant.inputs());
        for period in 0..10_000 {
            let inputs = plant.inputs();
            match homing.step(&config, &inputs) {
                Progress::Moving(outputs) => {
                    assert_eq!(outputs.valve, Valve::Open);
                    plant.step(&outputs);
                }
                Progress::Done => return Ok(f64::from(period) / 100.0),
                Progress::Failed(fault) => return Err(fault),
            }
        }
        panic!("homing never ends")
    }

    #[test]
    fn ends_at_the_start_position_from_anywhere() {
        for plunger in [-800.0, -1.0, 3.0, 400.0, 12_345.0, 57_900.0] {
            let mut plant = Plant::new(60e3, plunger);
            let seconds = home(&mut plant).unwrap();
            assert!(seconds < 35.0, "{plunger}: {seconds}");
            assert!((plant.plunger - 500.0).abs() < 10.0, "{}", plant.plunger);
            let counted = f64::from(plant.inputs().steps) * 0.35;
            assert!((counted - plant.plunger).abs() < 10.0, "{counted}");
            assert!(plant.pressure.abs() < 1_000.0);
        }
    }

    #[test]
    fn a_fast_pump_searches_no_faster_than_the_tube_lets_air_in() {
        let rate = |max_flow: f32| {
            let mut settings = Settings::DEFAULT;
            settings.set(Key::MaxFlow, max_flow.to_bits()).unwrap();
            let config = Config::of(&settings);
            config.rate(SEARCH_SHARE) * config.volume_per_step
        };
        assert!((rate(5_000.0) - 2_500.0).abs() < 1.0);
        assert!((rate(20_000.0) - FASTEST_SEARCH).abs() < 1.0);
    }

    #[test]
    fn a_switch_that_never_answers_is_a_fault() {
        let mut plant = Plant::new(60e3, 20e3);
        plant.retracted_end = Some(false);
        assert_eq!(home(&mut plant), Err(Fault::Stall));
    }

    #[test]
    fn a_switch_that_never_lets_go_is_a_fault() {
        let mut plant = Plant::new(60e3, 20e3);
        plant.retracted_end = Some(true);
        assert_eq!(home(&mut plant), Err(Fault::RetractedSwitch));
        assert!(plant.plunger < 26e3);
        let mut plant = Plant::new(60e3, 20e3);
        plant.retracted_end = Some(true);
        plant.pushed_end = true;
        assert_eq!(home(&mut plant), Err(Fault::EndSwitch));
    }

    /// A swapped coil lets the plunger run to the other end. One that starts there may
    /// leave it.
    #[test]
    #[allow(clippy::cast_possible_truncation)] // Some thousand steps.
    fn the_wrong_end_is_a_fault_and_leaving_it_is_none() {
        let config = Config::of(&Settings::DEFAULT);
        let at = |steps: i32, pushed_end: bool| Inputs {
            pushed_end,
            steps,
            ..Inputs::default()
        };
        let mut reversed = Homing::start(&at(0, false));
        assert!(matches!(
            reversed.step(&config, &at(-10, false)),
            Progress::Moving(_)
        ));
        assert_eq!(
            reversed.step(&config, &at(-20, true)),
            Progress::Failed(Fault::MotorReversed)
        );
        let mut leaving = Homing::start(&at(0, true));
        assert!(matches!(
            leaving.step(&config, &at(-10, true)),
            Progress::Moving(_)
        ));
        assert!(matches!(
            leaving.step(&config, &at(-20, false)),
            Progress::Moving(_)
        ));
        let mut stays = Homing::start(&at(0, true));
        let far = -(config.max_volume * LONGEST_BACK_OFF / config.volume_per_step) as i32 - 2;
        assert_eq!(
            stays.step(&config, &at(far, true)),
            Progress::Failed(Fault::MotorReversed)
        );
    }

    /// A wire beside a motor's catches spikes. One that lasts for two looks of the board counts
    /// for a period, also the first.
    #[test]
    fn a_spike_is_no_home() {
        for at in [0, 1, 100, 101, 300] {
            let mut plant = Plant::new(60e3, 45e3);
            let config = Config::of(&plant.settings);
            plant.retracted_end = (at == 0).then_some(true);
            let mut homing = Homing::start(&plant.inputs());
            for period in 1.. {
                plant.retracted_end = (period == at).then_some(true);
                let inputs = plant.inputs();
                match homing.step(&config, &inputs) {
                    Progress::Moving(outputs) => plant.step(&outputs),
                    Progress::Done => break,
                    Progress::Failed(fault) => panic!("{fault:?}"),
                }
                assert!(period < 10_000);
            }
            assert!(
                (plant.plunger - 500.0).abs() < 10.0,
                "{at}: {}",
                plant.plunger
            );
        }
    }

    /// A search that a switch interrupts again and again ends where any other does: the pump
    /// steps, whether or not the plunger stands at its stop.
    #[test]
    #[allow(clippy::cast_possible_truncation)] // Some hundred steps a period.
    fn a_switch_that_flickers_is_a_fault() {
        let config = Config::of(&Settings::DEFAULT);
        let mut inputs = Inputs::default();
        let mut homing = Homing::start(&inputs);
        for period in 0..10_000 {
            inputs.retracted_end = period % 7 == 0;
            match homing.step(&config, &inputs) {
                Progress::Moving(Outputs {
                    pump: Pump::Rate(rate),
                    ..
                }) => inputs.steps += (rate * PERIOD_S) as i32,
                Progress::Moving(_) => {}
                Progress::Done => panic!("homed on a switch that flickers"),
                Progress::Failed(fault) => {
                    assert_eq!(fault, Fault::Stall);
                    let travel = -inputs.steps as f32 * config.volume_per_step;
                    assert!(
                        travel < config.max_volume * (LONGEST_SEARCH + 0.1),
                        "{travel}"
                    );
                    return;
                }
            }
        }
        panic!("homing never ends");
    }

    #[test]
    fn a_pump_without_steps_is_a_fault() {
        let mut plant = Plant::new(60e3, 20e3);
        plant.blocked_motor = true;
        assert_eq!(home(&mut plant), Err(Fault::Stall));
    }
}
