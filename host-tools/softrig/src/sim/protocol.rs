//! Test protocols: set-points over time, and the pressure for them.
//!
//! The paper drives the actuator open loop: the model's inverse turns a
//! set-point into the pressure that holds it, and the syringe pump takes a
//! moment to build it up. `softrig simulate --protocol` and `softrig example` use the
//! same protocols.
//!
//! The shapes here have their own angles and times. Protocols of the board, by name or
//! from a file, are played by the board's own playback: [`play`].

use model_core::actuator::Model;
use wire::protocol::{ControlMode, Playback, Reference};

use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::PASCAL_PER_KPA;

/// Samples per second of a generated run.
pub const RATE_HZ: f64 = 100.0;

/// Time constant (s) with which the pump builds up a commanded pressure.
const PUMP_LAG_S: f64 = 0.12;

/// Time constant of a chamber that is vented (s).
const VENT_LAG_S: f64 = 0.3;

/// Rest (s) before the first command, so that a recording shows its zero.
const REST_S: f64 = 0.5;

/// A test protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Protocol {
    /// A step to `angle` (rad), held, then released.
    Step {
        /// Set-point (rad).
        angle: f64,
        /// Time at the set-point (s).
        hold: f64,
        /// Time after the release (s).
        release: f64,
    },
    /// Steps up to `angle` (rad) and down again, each held.
    Staircase {
        /// Highest set-point (rad).
        angle: f64,
        /// Steps on the way up.
        steps: u32,
        /// Time on each step (s).
        hold: f64,
    },
    /// Ramps up to `angle` (rad) and down again.
    Triangle {
        /// Peak (rad).
        angle: f64,
        /// Duration of one ramp (s).
        ramp: f64,
        /// Number of peaks.
        cycles: u32,
    },
}

impl Protocol {
    /// Duration (s).
    pub fn duration(&self) -> f64 {
        REST_S
            + match *self {
                Self::Step { hold, release, .. } => hold + release,
                Self::Staircase { steps, hold, .. } => f64::from(2 * steps) * hold,
                Self::Triangle { ramp, cycles, .. } => 2.0 * ramp * f64::from(cycles) + 1.0,
            }
    }

    /// Set-point (rad) at a time (s).
    pub fn setpoint(&self, time: f64) -> f64 {
        let time = time - REST_S;
        if time < 0.0 {
            return 0.0;
        }
        match *self {
            Self::Step { angle, hold, .. } => {
                if time < hold {
                    angle
                } else {
                    0.0
                }
            }
            Self::Staircase { angle, steps, hold } => {
                let level = (time / hold).floor() + 1.0;
                let top = f64::from(steps);
                let level = if level <= top {
                    level
                } else {
                    2.0 * top - level
                };
                angle * (level / top).max(0.0)
            }
            Self::Triangle {
                angle,
                ramp,
                cycles,
            } => {
                let phase = time / ramp;
                if phase >= f64::from(2 * cycles) {
                    return 0.0;
                }
                let within = phase % 2.0;
                angle * if within < 1.0 { within } else { 2.0 - within }
            }
        }
    }

    /// Times (s), set-points (rad) and the pressure (Pa) that `inverse`, the
    /// nominal model, would command for them.
    pub fn pressure(&self, inverse: &Model<f64>) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        // A run is some thousand samples.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let count = (self.duration() * RATE_HZ).round() as usize + 1;
        let time: Vec<f64> = (0..count).map(|k| k as f64 / RATE_HZ).collect();
        let setpoint: Vec<f64> = time.iter().map(|&time| self.setpoint(time)).collect();
        let blend = 1.0 - libm::exp(-1.0 / (RATE_HZ * PUMP_LAG_S));
        let mut built_up = 0.0;
        let pressure = setpoint
            .iter()
            .map(|&setpoint| {
                let command = if setpoint == 0.0 {
                    0.0
                } else {
                    inverse.holding_pressure(setpoint)
                };
                built_up += blend * (command - built_up);
                built_up
            })
            .collect();
        (time, setpoint, pressure)
    }
}

/// A protocol as played by a board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Play {
    /// Time (s), from the start of the rest before the first command.
    pub time: Vec<f64>,
    /// Set-point (rad); zero where a pressure is asked for.
    pub setpoint: Vec<f64>,
    /// Pressure (Pa) that is asked for, or that holds the set-point.
    pub command: Vec<f64>,
    /// Pressure in the chamber (Pa).
    pub pressure: Vec<f64>,
}

/// Plays a protocol that a board could play, `rate_hz` times a second, with the
/// pressures that `inverse` holds its set-points by.
///
/// The pump builds a pressure up with one lag, the vent lets it go with a longer one,
/// and while the pump is stopped it stays.
pub fn play(protocol: &ProtocolFile, inverse: &Model<f64>, rate_hz: u32) -> Play {
    let rate = f64::from(rate_hz);
    // Half a second of rows.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let rest = (REST_S * rate) as u32;
    let program = &protocol.segments[..];
    let mut playback = Playback::new();
    let mut in_chamber = 0.0;
    let mut play = Play::default();
    for row in 0.. {
        let reference = if row < rest {
            Reference::Release
        } else {
            playback.reference(program)
        };
        let (angle, command, lag) = match reference {
            Reference::Track {
                mode: ControlMode::Pressure,
                level,
            } => (0.0, f64::from(level) * PASCAL_PER_KPA, PUMP_LAG_S),
            Reference::Track { level: 0.0, .. } | Reference::Release => (0.0, 0.0, VENT_LAG_S),
            Reference::Track { level, .. } => {
                let angle = f64::from(level).to_radians();
                (angle, inverse.holding_pressure(angle), PUMP_LAG_S)
            }
            Reference::Hold => {
                let angle = play.setpoint.last().copied().unwrap_or(0.0);
                (angle, in_chamber, PUMP_LAG_S)
            }
            Reference::Done => break,
        };
        in_chamber += (command - in_chamber) * (1.0 - libm::exp(-1.0 / (rate * lag)));
        play.time.push(f64::from(row) / rate);
        play.setpoint.push(angle);
        play.command.push(command);
        play.pressure.push(in_chamber);
        if row >= rest {
            playback.advance(program, 1000 / rate_hz);
        }
    }
    play
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::dynamics::Dynamics;

    const STIFFNESS: f64 = 6.0;
    const INPUT_GAIN: f64 = 1.5e-4;

    fn model() -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 2.0,
            stiffness: STIFFNESS,
            exponent: 2.0,
            input_gain: INPUT_GAIN,
        };
        Model::new(dynamics, &[]).unwrap()
    }

    #[test]
    fn what_boards_play_is_played_as_they_do() {
        let model = model();
        for &named in wire::protocol::Named::ALL {
            let protocol = ProtocolFile::named(named);
            let Play {
                time,
                setpoint,
                pressure,
                ..
            } = play(&protocol, &model, 100);
            let promised = f64::from(protocol.total_ms()) / 1000.0 + REST_S;
            assert!(
                (time.len() as f64 / RATE_HZ - promised).abs() < 0.02,
                "{named:?}"
            );
            let rest = time.iter().position(|time| *time >= REST_S).unwrap();
            assert!(pressure[..rest].iter().all(|pressure| *pressure == 0.0));
            let highest = setpoint.iter().copied().fold(0.0, f64::max);
            assert!(highest > 0.5 && highest < 1.6, "{named:?}: {highest}");
        }
        // Stopped, the pump keeps its pressure.
        let still = ProtocolFile::named(wire::protocol::Named::HoldStill);
        let Play { time, pressure, .. } = play(&still, &model, 100);
        let at = |second: f64| pressure[time.iter().position(|time| *time >= second).unwrap()];
        assert!((at(23.0) / at(5.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn setpoints_follow_their_shapes() {
        let step = Protocol::Step {
            angle: 1.0,
            hold: 2.0,
            release: 1.0,
        };
        let at = |protocol: &Protocol, time: f64| protocol.setpoint(REST_S + time);
        assert!(
            step.setpoint(0.2) == 0.0
                && (at(&step, 1.0) - 1.0).abs() < 1e-12
                && at(&step, 2.5) == 0.0
        );
        let stairs = Protocol::Staircase {
            angle: 1.2,
            steps: 3,
            hold: 1.0,
        };
        for (time, expected) in [(0.5, 0.4), (1.5, 0.8), (2.5, 1.2), (3.5, 0.8), (5.5, 0.0)] {
            assert!((at(&stairs, time) - expected).abs() < 1e-12, "{time}");
        }
        let triangle = Protocol::Triangle {
            angle: 1.0,
            ramp: 2.0,
            cycles: 2,
        };
        for (time, expected) in [(1.0, 0.5), (2.0, 1.0), (3.0, 0.5), (5.0, 0.5), (8.5, 0.0)] {
            assert!((at(&triangle, time) - expected).abs() < 1e-12, "{time}");
        }
    }

    #[test]
    fn pressure_settles_where_the_inverse_says() {
        let model = model();
        let step = Protocol::Step {
            angle: 1.0,
            hold: 3.0,
            release: 1.0,
        };
        let (time, _, pressure) = step.pressure(&model);
        let held = time
            .iter()
            .position(|t| (*t - REST_S - 2.9).abs() < 1e-9)
            .unwrap();
        assert!((pressure[held] - STIFFNESS / INPUT_GAIN).abs() < 1.0);
        assert!(pressure[0] == 0.0);
    }
}
