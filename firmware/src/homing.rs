//! Homing: finds the position of the plunger.
//!
//! The step counter is lost at every reset. With the valve open, the plunger moves back
//! until the end switch closes, then slowly forward until it releases; that edge is
//! volume zero. Then it moves to a start position somewhat inside, so that the return
//! after a release does not hit the switch.
//!
//! At the start position sensor and vent are tested ([`crate::sight`]), before any run pushes.

use wire::{
    fault::Fault,
    settings::{Key, Settings},
};

use crate::{
    design::homing::{
        EDGE_SHARE, FASTEST_SEARCH, LONGEST_BACK_OFF, LONGEST_SEARCH, LONGEST_STANDSTILL,
        LONGEST_STROKE_UL, MEASURING_SHARE, SEARCH_SHARE, START_SHARE, START_UL,
    },
    io::{Inputs, Outputs, Pump, Valve},
    sight::{self, Found, Sight},
};

/// Periods for which a released switch has to stay so.
const CLEAR: u8 = 10;

/// Periods that the pump is given to stop, and the board to set its counter.
const SETTLING: u8 = 5;

/// Distances and speeds, from the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    pub(crate) max_volume: f32,
    pub(crate) max_flow: f32,
    pub(crate) volume_per_step: f32,
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

    /// A share of the fastest flow (microsteps/s), as far as a tube lets it in.
    pub(crate) fn rate(&self, share: f32) -> f32 {
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
    /// There: testing sensor and vent.
    Look,
    /// Measuring: going to the pushed-in switch.
    Out,
    /// It answers: standing still, as in [`Self::Stop`].
    Far,
    /// Leaving it.
    Leave,
    /// It let go: going back, to somewhat before the retracted switch.
    Back,
    /// Going on to that one, slowly: a sudden stop there loses no step.
    Close,
}

/// What is to be found besides the home.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    /// Nothing.
    Home,
    /// The stroke; the pushed-in switch comes next.
    Stroke,
    /// The stroke; the pushed-in switch let go here (microsteps).
    From(i32),
}

/// The progress of homing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Homing {
    phase: Phase,
    task: Task,
    /// Position (microsteps) at which the phase began.
    from: i32,
    before: i32,
    /// Periods spent standing.
    standing: u8,
    /// Periods for which the pushed-in switch has been open.
    clear: u8,
    /// Where the counter stood (microsteps) when the retracted switch let go first.
    let_go_at: i32,
    stroke: Option<u32>,
    /// The test of sensor and vent, while there is one.
    sight: Option<Sight>,
    /// What the last one found.
    found: Option<Found>,
    /// Measuring: where (µl) the next one is due.
    look_at: f32,
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
            task: Task::Home,
            let_go_at: 0,
            stroke: None,
            sight: None,
            found: None,
            look_at: 0.0,
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

    /// Starts likewise, and measures the stroke.
    ///
    /// The stroke is measured on the way back, so that steps lost in the sudden stop at the pushed-in
    /// switch do not count: from the place where that one lets go to the one where the retracted
    /// switch does, both left slowly. On the way out sensor and vent are tested every quarter of the
    /// air that is left: with an open vent a sensor that sees nothing looks like one that sees no
    /// pressure.
    pub fn measuring(inputs: &Inputs) -> Self {
        Self {
            task: Task::Stroke,
            ..Self::start(inputs)
        }
    }

    /// Whether the plunger looks for the pushed-in switch, so that this one ends no run.
    pub fn seeks_pushed_end(&self) -> bool {
        matches!(self.phase, Phase::Out | Phase::Far)
    }

    /// Whether the stroke is still to be measured.
    #[cfg(test)]
    pub(crate) fn measures(&self) -> bool {
        self.task != Task::Home
    }

    /// Where the counter stood (microsteps) at home: what was lost since the home before, if there
    /// was one.
    pub fn let_go_at(&self) -> i32 {
        self.let_go_at
    }

    /// What the last test of sensor and vent found.
    pub fn found(&self) -> Option<Found> {
        self.found
    }

    /// How late the pressure sensor is (ms), as far as that is known, also where the test failed.
    pub fn delay_ms(&self) -> Option<u16> {
        match &self.sight {
            Some(sight) => sight.delay_ms(),
            None => self.found.map(|found| found.delay_ms),
        }
    }

    /// The stroke (microsteps), once it is measured.
    pub fn stroke(&self) -> Option<u32> {
        self.stroke
    }

    /// Tests sensor and vent, while that is under way. A plunger that comes to the pushed-in switch ends it.
    #[inline(never)]
    fn look(&mut self, config: &Config, inputs: &Inputs, pressure: f32) -> Option<Progress> {
        let sight = self.sight.as_mut()?;
        if inputs.pushed_end {
            self.sight = None;
            return None;
        }
        self.before = inputs.steps;
        let volume = inputs.steps as f32 * config.volume_per_step;
        match sight.step(config, volume, pressure) {
            sight::Progress::Moving(outputs) => Some(Progress::Moving(outputs)),
            sight::Progress::Failed(fault) => Some(Progress::Failed(fault)),
            sight::Progress::Done(found) => {
                self.sight = None;
                self.found = Some(found);
                self.look_at = volume + found.unseen();
                (self.phase == Phase::Look).then_some(Progress::Done)
            }
        }
    }

    /// Lets one control period pass; `pressure` is the smoothed reading (Pa).
    #[allow(clippy::too_many_lines)] // A row for each phase.
    pub fn step(&mut self, config: &Config, inputs: &Inputs, pressure: f32) -> Progress {
        if let Some(progress) = self.look(config, inputs, pressure) {
            return progress;
        }
        let volume = inputs.steps as f32 * config.volume_per_step;
        let moved = inputs.steps.wrapping_sub(self.from) as f32 * config.volume_per_step;
        let moves = inputs.steps != self.before;
        self.before = inputs.steps;
        match self.phase {
            Phase::Stop | Phase::Zero | Phase::Far => {
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
            Phase::Search | Phase::Close if inputs.retracted_end => {
                self.enter(Phase::Stop, self.from);
            }
            Phase::Search if -moved > self.longest_search(config) => {
                return Progress::Failed(Fault::Stall);
            }
            Phase::Stop if !inputs.retracted_end => self.enter(Phase::Search, self.from),
            Phase::Stop if settled => self.enter(Phase::BackOff, inputs.steps),
            Phase::BackOff if inputs.pushed_end => return Progress::Failed(Fault::EndSwitch),
            Phase::BackOff if !inputs.retracted_end => {
                match self.task {
                    Task::From(far) => {
                        self.stroke = u32::try_from(far.wrapping_sub(inputs.steps)).ok();
                        self.task = Task::Home;
                    }
                    Task::Home | Task::Stroke => self.let_go_at = inputs.steps,
                }
                self.enter(Phase::Zero, 0);
                self.before = 0;
                set_steps = Some(0);
            }
            Phase::BackOff if moved > let_go => {
                return Progress::Failed(Fault::RetractedSwitch);
            }
            Phase::Zero if settled => {
                let next = match self.task {
                    Task::Stroke => Phase::Out,
                    Task::Home | Task::From(_) => Phase::Approach,
                };
                self.look_at = 0.0;
                self.enter(next, inputs.steps);
            }
            Phase::Out if inputs.pushed_end => self.enter(Phase::Far, self.from),
            Phase::Out if moved > LONGEST_STROKE_UL => return Progress::Failed(Fault::Stall),
            Phase::Out if volume >= self.look_at => {
                let air = self.found.map(|found| found.air - found.unseen());
                self.sight = Some(Sight::start(config, volume, air));
            }
            Phase::Far if !inputs.pushed_end => self.enter(Phase::Out, self.from),
            Phase::Far if settled => self.enter(Phase::Leave, inputs.steps),
            Phase::Leave if !inputs.pushed_end => {
                self.task = Task::From(inputs.steps);
                self.enter(Phase::Back, inputs.steps);
            }
            Phase::Leave if -moved > let_go => return Progress::Failed(Fault::EndSwitch),
            // It is where it was not to be yet: the motor skipped, or a wire broke.
            Phase::Back if inputs.retracted_end => return Progress::Failed(Fault::EndSwitch),
            Phase::Back if volume <= config.start_volume() => {
                self.enter(Phase::Close, inputs.steps);
            }
            Phase::Close if -moved > let_go => return Progress::Failed(Fault::Stall),
            Phase::Approach if volume >= config.start_volume() => {
                self.sight = Some(Sight::start(config, volume, None));
                self.enter(Phase::Look, inputs.steps);
            }
            _ => {}
        }
        let pump = match self.phase {
            Phase::Search | Phase::Back => Pump::Rate(-config.rate(SEARCH_SHARE)),
            Phase::Out => Pump::Rate(config.rate(SEARCH_SHARE)),
            Phase::Approach => Pump::Rate(config.rate(EDGE_SHARE)),
            Phase::Close => Pump::Rate(-config.rate(EDGE_SHARE)),
            Phase::BackOff => Pump::Rate(config.rate(match self.task {
                Task::Home | Task::Stroke => EDGE_SHARE,
                Task::From(_) => MEASURING_SHARE,
            })),
            Phase::Leave => Pump::Rate(-config.rate(MEASURING_SHARE)),
            Phase::Stop | Phase::Zero | Phase::Far | Phase::Look => Pump::Brake,
        };
        Progress::Moving(Outputs {
            pump,
            valve: Valve::Open,
            set_steps,
            light: false,
        })
    }

    /// Travel (µl) after which the search for the retracted switch ends. A plunger whose stroke is
    /// not known may be farther away than the largest volume.
    fn longest_search(&self, config: &Config) -> f32 {
        match self.task {
            Task::Stroke => LONGEST_STROKE_UL,
            Task::Home | Task::From(_) => config.max_volume * LONGEST_SEARCH,
        }
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
#[allow(clippy::cast_possible_truncation)]
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
            match homing.step(&config, &inputs, plant.pressure as f32) {
                Progress::Moving(outputs) => {
                    if matches!(outputs.pump, Pump::Rate(rate) if rate < 0.0) {
                        assert_eq!(outputs.valve, Valve::Open);
                    }
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
            reversed.step(&config, &at(-10, false), 0.0),
            Progress::Moving(_)
        ));
        assert_eq!(
            reversed.step(&config, &at(-20, true), 0.0),
            Progress::Failed(Fault::MotorReversed)
        );
        let mut leaving = Homing::start(&at(0, true));
        assert!(matches!(
            leaving.step(&config, &at(-10, true), 0.0),
            Progress::Moving(_)
        ));
        assert!(matches!(
            leaving.step(&config, &at(-20, false), 0.0),
            Progress::Moving(_)
        ));
        let mut stays = Homing::start(&at(0, true));
        let far = -(config.max_volume * LONGEST_BACK_OFF / config.volume_per_step) as i32 - 2;
        assert_eq!(
            stays.step(&config, &at(far, true), 0.0),
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
                match homing.step(&config, &inputs, plant.pressure as f32) {
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
            match homing.step(&config, &inputs, 0.0) {
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

    /// Measures the stroke of a plant (microsteps), or says the fault.
    fn measure(plant: &mut Plant) -> Result<u32, Fault> {
        let config = Config::of(&plant.settings);
        let mut homing = Homing::measuring(&plant.inputs());
        for _ in 0..30_000 {
            match homing.step(&config, &plant.inputs(), plant.pressure as f32) {
                Progress::Moving(outputs) => plant.step(&outputs),
                Progress::Done => return Ok(homing.stroke().expect("it was measured")),
                Progress::Failed(fault) => return Err(fault),
            }
        }
        panic!("measuring never ends")
    }

    /// The plant's switches are at 0 and at 57 ml.
    #[test]
    fn the_stroke_is_the_way_between_the_switches_from_anywhere() {
        for plunger in [-800.0, 400.0, 20_000.0, 57_900.0] {
            let mut plant = Plant::new(60e3, plunger);
            let steps = measure(&mut plant).unwrap();
            let stroke = f64::from(steps) * 0.35;
            assert!((stroke - 57_000.0).abs() < 3.5, "{plunger}: {stroke}");
            assert!((plant.plunger - 500.0).abs() < 10.0, "{}", plant.plunger);
        }
    }

    #[test]
    fn a_pushed_in_switch_that_is_stuck_ends_the_measurement() {
        let mut plant = Plant::new(60e3, 20e3);
        plant.pushed_end = true;
        assert_eq!(measure(&mut plant), Err(Fault::MotorReversed));
        // It answers on the way out and does not let go any more.
        let mut plant = Plant::new(60e3, 0.0);
        let config = Config::of(&plant.settings);
        let mut homing = Homing::measuring(&plant.inputs());
        let fault = (0..20_000).find_map(|_| {
            plant.pushed_end |= plant.plunger > 30e3;
            match homing.step(&config, &plant.inputs(), plant.pressure as f32) {
                Progress::Moving(outputs) => plant.step(&outputs),
                Progress::Done => panic!("measured"),
                Progress::Failed(fault) => return Some(fault),
            }
            None
        });
        assert_eq!(fault, Some(Fault::EndSwitch));
    }

    /// What the counter shows when the switch lets go is what was lost.
    #[test]
    fn steps_that_were_lost_are_counted_at_the_next_home() {
        let mut plant = Plant::new(60e3, 20e3);
        home(&mut plant).unwrap();
        // The counter believes in 1 000 steps more than were made.
        plant.zero -= 350.0;
        let config = Config::of(&plant.settings);
        let mut homing = Homing::start(&plant.inputs());
        while let Progress::Moving(outputs) =
            homing.step(&config, &plant.inputs(), plant.pressure as f32)
        {
            plant.step(&outputs);
        }
        assert!((homing.let_go_at() - 1_000).abs() < 10, "{homing:?}");
        assert_eq!(homing.stroke(), None);
    }

    #[test]
    fn a_pump_without_steps_is_a_fault() {
        let mut plant = Plant::new(60e3, 20e3);
        plant.blocked_motor = true;
        assert_eq!(home(&mut plant), Err(Fault::Stall));
    }
}
