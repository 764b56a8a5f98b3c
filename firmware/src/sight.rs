//! Tests that pump, vent and pressure sensor belong to the same air, before volume is pushed.
//!
//! With the plunger at rest and the valve closed a little volume is pushed in, the sensor has to
//! show it, and with the valve open it has to show that it is gone ([`Sight`]).
//!
//! The air behind the plunger that is found is what [`crate::gas`] and the pressure loop go by from
//! the first stroke on: the pressure of a volume v that was pushed in is at most p₀ v/(A − v),
//! whatever a sensor shows that is late, drifts or has gone blind since.

use wire::fault::Fault;

use crate::{
    control::{ATMOSPHERE_PA, limit::within},
    design::PERIOD_S,
    design::homing::{LONGEST_STANDSTILL, SEARCH_SHARE},
    homing::Config,
    io::{Outputs, Pump, Valve},
    stall,
};

/// Volume that is pushed in, in largest volumes of the pump: 3 ml of 50, some 5 kPa. Below the window of
/// the stall watch.
const PUSHED: f32 = 0.06;

/// Volume that is pushed in (share) where the air is known.
const PUSHED_OF_AIR: f32 = 0.05;

/// A rise (Pa) that is enough: of little air less is pushed.
const ENOUGH_PA: f32 = 8_000.0;

/// Periods of a block at rest, and of one of a rise: even numbers, in which the mains of 50 Hz cancels. Air
/// that cools with 2 s is told from noise over twice the time.
const BLOCK_AT_REST: u8 = 32;
const BLOCK_OF_RISE: u8 = 64;

/// Periods after a motion in which nothing is read.
const SETTLING: u16 = 10;

/// Change (Pa) from block to block below which a reading stands still: thrice its noise.
const STILL_PA: f32 = 35.0;

/// Share of a rise by which it changes from block to block if it leaks or is very late.
const MOVING: f32 = 0.03;

/// Blocks after which a reading is taken, still or not: 6.4 s for a rise.
const MOST_BLOCKS: u8 = 10;

/// Largest change (Pa) of the zero over the test. A drift of 0.1 kPa/s passes; half of it cancels.
const LARGEST_DRIFT_PA: f32 = 300.0;

/// Share of the rise at which the fall has taken one time constant: 1/e.
const FALLEN: f32 = 0.37;

/// Longest fall (periods): 3 s, as for a vent.
const LONGEST_FALL: u16 = 300;

/// Periods by which converter and filter are late themselves.
const OWN_DELAY: u16 = 3;

/// Volume (µl) that the pump may push until the sensor shows it: how late a sensor may be follows from the
/// fastest flow. The pressure loop slows down over as much.
pub const DELAY_UL: f32 = 3_000.0;

/// Bounds (s) of that delay: the vent alone takes a tenth of a second, and beyond a second a loop does
/// not settle.
const DELAYS_S: (f32, f32) = (0.25, 1.0);

/// Share of the air behind the plunger that may be pushed out through an open vent until the next test.
/// If a kink takes sensor and vent away meanwhile, the air is at p₀ (1/(1 − 0.25)/(1 − 0.05) − 1), which is
/// 41 kPa, when the test finds it.
const UNSEEN: f32 = 0.25;

/// What a test found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Air behind the plunger where it stood (µl).
    pub air: f32,
    /// How late the reading is (ms), the vent's own time included.
    pub delay_ms: u16,
}

impl Found {
    /// Volume (µl) that may be pushed out before the next test.
    pub fn unseen(&self) -> f32 {
        self.air * UNSEEN
    }
}

/// The latest delay (s) that is allowed.
fn longest_delay(config: &Config) -> f32 {
    let (shortest, longest) = DELAYS_S;
    within(DELAY_UL / config.max_flow, shortest, longest)
}

/// Means of the pressure (Pa), a block each.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Blocks {
    /// Periods of one.
    length: u8,
    sum: f32,
    count: u8,
    /// The last three, the newest first.
    means: [f32; 3],
    completed: u8,
}

impl Blocks {
    const fn of(length: u8) -> Self {
        Self {
            length,
            sum: 0.0,
            count: 0,
            means: [0.0; 3],
            completed: 0,
        }
    }

    /// Takes a reading; whether it completed a block.
    fn update(&mut self, pressure: f32) -> bool {
        self.sum += pressure;
        self.count += 1;
        if self.count < self.length {
            return false;
        }
        let [newest, before, _] = self.means;
        self.means = [self.sum / f32::from(self.length), newest, before];
        self.sum = 0.0;
        self.count = 0;
        self.completed = self.completed.saturating_add(1);
        true
    }

    /// What the last block gained (Pa) against the one before.
    fn gained(&self) -> f32 {
        self.means[0] - self.means[1]
    }

    /// Twice in a row: late and warm air has a peak, at which it does once.
    fn stands_still(&self) -> bool {
        let [_, before, first] = self.means;
        self.completed >= 3 && self.gained().abs() < STILL_PA && (before - first).abs() < STILL_PA
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Valve open: the zero.
    Zero,
    /// Valve closed: pushing.
    Push,
    /// The rise.
    Rise,
    /// Valve open: the fall.
    Fall,
    /// The plunger goes back.
    Return,
    /// The zero again.
    Check,
}

/// A test that is under way.
///
/// | learned | from |
/// |---|---|
/// | the sensor sees the pump's air, and the vent closes | the rise |
/// | the vent opens on the same air | the fall |
/// | how late the sensor is | the time in which the reading falls to 1/e |
/// | the air behind the plunger, A = v (p₀ + p)/p | the volume that was pushed and the rise |
/// | the sensor's zero stands still | the reading before and after |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    phase: Phase,
    /// Where the plunger stood (µl).
    from: f32,
    /// What is pushed in (µl).
    push: f32,
    /// Reading (Pa) without pressure.
    zero: f32,
    /// Rise of the reading (Pa), and the volume (µl) for it.
    rise: f32,
    pushed: f32,
    /// Whether the reading still climbed when it was taken.
    climbs: bool,
    blocks: Blocks,
    /// Periods of this phase.
    periods: u16,
    /// Periods without motion where there has to be some.
    standing: u8,
    before: f32,
    /// Periods of the fall.
    delay: u16,
}

/// The result of one period of a test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// Going on.
    Moving(Outputs),
    /// The plunger is back where it stood, and all is well.
    Done(Found),
    /// It is not.
    Failed(Fault),
}

impl Sight {
    /// Starts with the plunger at rest at a volume (µl), with an open valve. Of air (µl) that is known
    /// little is pushed.
    pub fn start(config: &Config, volume: f32, air: Option<f32>) -> Self {
        Self {
            phase: Phase::Zero,
            from: volume,
            push: air.map_or(config.max_volume * PUSHED, |air| air * PUSHED_OF_AIR),
            zero: 0.0,
            rise: 0.0,
            pushed: 0.0,
            climbs: false,
            blocks: Blocks::of(BLOCK_AT_REST),
            periods: 0,
            standing: 0,
            before: volume,
            delay: 0,
        }
    }

    /// How late the reading is (ms), as far as that is known.
    pub fn delay_ms(&self) -> Option<u16> {
        const PERIOD_MS: u16 = crate::design::PERIOD_MS;
        (self.delay > 0).then(|| self.delay.saturating_sub(OWN_DELAY) * PERIOD_MS)
    }

    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        self.periods = 0;
        self.standing = 0;
        self.blocks = Blocks::of(if phase == Phase::Rise {
            BLOCK_OF_RISE
        } else {
            BLOCK_AT_REST
        });
    }

    /// Lets one control period pass: the plunger's volume (µl), and the smoothed reading (Pa).
    pub fn step(&mut self, config: &Config, volume: f32, pressure: f32) -> Progress {
        self.periods = self.periods.saturating_add(1);
        #[allow(clippy::float_cmp)] // A plunger that stands is at the same microstep.
        let moves = volume != core::mem::replace(&mut self.before, volume);
        let has_to_move = matches!(self.phase, Phase::Push | Phase::Return);
        self.standing = if moves || !has_to_move {
            0
        } else {
            self.standing.saturating_add(1)
        };
        if self.standing > LONGEST_STANDSTILL {
            return Progress::Failed(Fault::Stall);
        }
        let is_read = self.periods > SETTLING && self.blocks.update(pressure);
        match self.phase {
            // The plunger may just have come to rest, and its last air is on the way out.
            Phase::Zero if is_read && self.blocks.completed >= 2 && self.is_still() => {
                self.zero = self.blocks.means[0];
                self.enter(Phase::Push);
            }
            Phase::Push if volume - self.from >= self.push || pressure - self.zero >= ENOUGH_PA => {
                self.enter(Phase::Rise);
            }
            Phase::Rise if is_read && self.is_risen() => {
                self.pushed = volume - self.from;
                self.rise = self.blocks.means[0] - self.zero;
                // What still moves by so much after so long is not on its way to an end.
                let moves = STILL_PA.max(self.rise * MOVING);
                self.climbs = self.blocks.gained() > moves;
                if self.blocks.gained() < -moves {
                    return Progress::Failed(Fault::GasLaw);
                }
                if !stall::follows(config.max_volume, self.pushed, self.rise) {
                    return Progress::Failed(Fault::Blind);
                }
                self.enter(Phase::Fall);
            }
            Phase::Fall if pressure - self.zero < self.rise * FALLEN => {
                self.delay = self.periods;
                let late = f32::from(self.delay.saturating_sub(OWN_DELAY)) * PERIOD_S;
                if self.climbs || late > longest_delay(config) {
                    return Progress::Failed(Fault::Late);
                }
                self.enter(Phase::Return);
            }
            Phase::Fall if self.periods > LONGEST_FALL => {
                self.delay = self.periods;
                let fault = if self.climbs {
                    Fault::Late
                } else {
                    Fault::Vent
                };
                return Progress::Failed(fault);
            }
            Phase::Return if volume <= self.from => self.enter(Phase::Check),
            Phase::Check if is_read && self.is_risen() => return self.check(),
            _ => {}
        }
        let (pump, valve) = match self.phase {
            Phase::Zero | Phase::Fall | Phase::Check => (Pump::Brake, Valve::Open),
            Phase::Push => (Pump::Rate(config.rate(1.0)), Valve::Closed),
            Phase::Rise => (Pump::Brake, Valve::Closed),
            Phase::Return => {
                let far = (volume - self.from) * APPROACH / config.volume_per_step;
                let rate = within(far, SLOWEST, config.rate(SEARCH_SHARE).max(SLOWEST));
                (Pump::Rate(-rate), Valve::Open)
            }
        };
        Progress::Moving(Outputs {
            pump,
            valve,
            ..Outputs::default()
        })
    }

    /// Whether the last two blocks agree, or were waited for long enough.
    fn is_still(&self) -> bool {
        self.blocks.gained().abs() < STILL_PA || self.blocks.completed >= MOST_BLOCKS
    }

    /// Whether the reading stands still, or was waited for long enough.
    ///
    /// The rise is read once it stands still: air that was compressed quickly is warm, and a reading
    /// that is late still climbs. What is still warm makes A too small, which is on the safe side.
    fn is_risen(&self) -> bool {
        self.blocks.stands_still() || self.blocks.completed >= MOST_BLOCKS
    }

    /// The zero has to be where it was.
    fn check(&self) -> Progress {
        let drift = self.blocks.means[0] - self.zero;
        if drift.abs() > LARGEST_DRIFT_PA {
            return Progress::Failed(Fault::GasLaw);
        }
        // The zero of the rise lies between the two.
        let rise = self.rise - 0.5 * drift;
        Progress::Done(Found {
            air: self.pushed + self.pushed * (ATMOSPHERE_PA / rise),
            delay_ms: self.delay_ms().unwrap_or(0),
        })
    }
}

/// Share of the way back that is made in a second (1/s).
const APPROACH: f32 = 8.0;

/// Slowest rate (microsteps/s) on the way back.
const SLOWEST: f32 = 50.0;

#[cfg(test)]
#[allow(clippy::cast_possible_truncation)]
mod tests {
    extern crate std;
    use super::*;
    use std::println;
    use wire::settings::Settings;

    const P0: f64 = ATMOSPHERE_PA as f64;

    /// A rig with the plunger at its start.
    #[derive(Clone, Copy, Debug)]
    #[allow(clippy::struct_excessive_bools)] // Each is a fault, and all combine.
    struct Rig {
        /// Air behind the plunger (µl).
        air: f64,
        /// Time constants (s) with which the air cools, the reading is late, and the air leaks.
        cools_s: f64,
        late_s: f64,
        leak_s: f64,
        /// Noise of a reading (Pa), uniform.
        noise: f64,
        /// What the mains adds (Pa), with a sign that changes.
        mains: f64,
        /// What the reading gains in a second (Pa/s).
        drift: f64,
        /// Sensor and vent are behind a kink.
        kinked: bool,
        vent_shut: bool,
        vent_open: bool,
        motor_stands: bool,
    }

    const RIG: Rig = Rig {
        air: 60_000.0,
        cools_s: 0.0,
        late_s: 0.02,
        leak_s: 2_500.0,
        noise: 100.0,
        mains: 0.0,
        drift: 0.0,
        kinked: false,
        vent_shut: false,
        vent_open: false,
        motor_stands: false,
    };

    impl Rig {
        /// Plays a test; the result, how long it took (s), and the highest true pressure (kPa).
        fn play(self, known: Option<f32>) -> (Progress, f64, f64) {
            let config = Config::of(&Settings::DEFAULT);
            let mut sight = Sight::start(&config, 500.0, known);
            let (mut plunger, mut amount, mut warmer, mut highest) = (0.0, self.air, 0.0, 0.0_f64);
            let (mut seen, mut filter) = (0.0, crate::sensing::filter::LowPass::default());
            let mut noise = 1_u32;
            for period in 0..6_000_u32 {
                let time = f64::from(period) * 0.01;
                let p = P0 * (amount * (1.0 + warmer) / (self.air - plunger) - 1.0);
                highest = highest.max(p / 1e3);
                let target = if self.kinked { 0.0 } else { p };
                seen += (target - seen) * -(-0.01 / self.late_s).exp_m1();
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let sign = if period % 2 == 0 { 1.0 } else { -1.0 };
                let shown = seen
                    + self.drift * time
                    + self.mains * sign
                    + (f64::from(noise >> 16) / 32_768.0 - 1.0) * self.noise;
                let reading = filter.update(shown as f32);
                let steps = (plunger / 0.35).round() * 0.35;
                let progress = sight.step(&config, 500.0 + steps as f32, reading);
                let Progress::Moving(outputs) = progress else {
                    return (progress, time, highest);
                };
                let before = plunger;
                if let Pump::Rate(rate) = outputs.pump
                    && !self.motor_stands
                {
                    assert!(rate >= 0.0 || outputs.valve == Valve::Open);
                    plunger += f64::from(rate) * 0.35 * 0.01;
                }
                if self.cools_s > 0.0 {
                    warmer += 0.4 * (plunger - before) / (self.air - plunger)
                        - warmer * 0.01 / self.cools_s;
                }
                let is_open = (outputs.valve == Valve::Open || self.vent_open)
                    && !self.vent_shut
                    && !self.kinked;
                let flows = (if is_open { 1.0 / 0.08 } else { 0.0 }) + 1.0 / self.leak_s;
                amount -= (self.air - plunger) * p / P0 * -(-0.01 * flows).exp_m1();
                if is_open {
                    warmer *= 0.9;
                }
            }
            panic!("it never ends")
        }

        #[track_caller]
        fn finds(self) -> (Found, f64) {
            match self.play(None) {
                (Progress::Done(found), time, _) => (found, time),
                (other, ..) => panic!("{self:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn the_air_is_found_whether_it_is_warm_late_or_beside_the_mains() {
        let mut slowest = 0.0_f64;
        for air in [20_000.0, 40_000.0, 60_000.0, 90_000.0] {
            for cools_s in [0.0, 0.5, 1.0, 1.5, 2.0] {
                for late_s in [0.02, 0.2, 0.4] {
                    for mains in [0.0, 5_300.0] {
                        let rig = Rig {
                            air,
                            cools_s,
                            late_s,
                            mains,
                            ..RIG
                        };
                        let (found, time) = rig.finds();
                        let off = f64::from(found.air) / air - 1.0;
                        println!(
                            "{air} {cools_s} {late_s} {mains}: {off:+.3}, {} ms, {time:.1} s",
                            found.delay_ms
                        );
                        // What is still warm makes it too small, which is on the safe side.
                        assert!((-0.03..0.005).contains(&off), "{rig:?}: {off}");
                        slowest = slowest.max(time);
                    }
                }
            }
        }
        assert!(slowest < 12.0, "{slowest} s");
    }

    #[test]
    fn a_delay_is_found_and_one_beyond_the_pumps_speed_refused() {
        for late_s in [0.02, 0.1, 0.2, 0.3, 0.4, 0.45] {
            let (found, _) = Rig { late_s, ..RIG }.finds();
            let expected = late_s * 1e3 + 80.0;
            let off = f64::from(found.delay_ms) - expected;
            assert!(off.abs() < 60.0, "{late_s}: {found:?}");
        }
        for late_s in [0.7, 1.0, 2.0, 5.0] {
            let (outcome, ..) = Rig { late_s, ..RIG }.play(None);
            assert_eq!(outcome, Progress::Failed(Fault::Late), "{late_s}");
        }
    }

    /// Whatever is wrong is a fault, and what was pushed until then is little.
    #[test]
    fn what_sensor_and_vent_do_not_share_is_a_fault() {
        let cases: [(&str, Rig, Fault); 8] = [
            (
                "kinked",
                Rig {
                    kinked: true,
                    ..RIG
                },
                Fault::Blind,
            ),
            (
                "vent open",
                Rig {
                    vent_open: true,
                    ..RIG
                },
                Fault::Blind,
            ),
            (
                "vent shut",
                Rig {
                    vent_shut: true,
                    ..RIG
                },
                Fault::Vent,
            ),
            (
                "no motion",
                Rig {
                    motor_stands: true,
                    ..RIG
                },
                Fault::Stall,
            ),
            ("leak", Rig { leak_s: 3.0, ..RIG }, Fault::GasLaw),
            (
                "drift",
                Rig {
                    drift: -690.0,
                    ..RIG
                },
                Fault::GasLaw,
            ),
            (
                "a reference that drifts by 0.3 %/s",
                Rig {
                    drift: -207.0,
                    ..RIG
                },
                Fault::GasLaw,
            ),
            (
                "very late",
                Rig {
                    late_s: 60.0,
                    ..RIG
                },
                Fault::Blind,
            ),
        ];
        for (name, rig, fault) in cases {
            for known in [None, Some(30_000.0)] {
                let (outcome, _, highest) = rig.play(known);
                assert_eq!(outcome, Progress::Failed(fault), "{name}");
                assert!(highest < 9.0, "{name}: {highest} kPa");
            }
        }
    }

    /// Between two tests a kink hides a quarter of the air, and the test pushes a little more.
    #[test]
    fn what_can_be_pushed_unseen_has_a_bound() {
        let found = RIG.finds().0;
        let left = found.air - found.unseen();
        let p = ATMOSPHERE_PA * (found.air / (left * (1.0 - PUSHED_OF_AIR)) - 1.0);
        assert!((40e3..42e3).contains(&p), "{p}");
    }
}
