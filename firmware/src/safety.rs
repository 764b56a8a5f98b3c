//! The supervisor: what the rig may do in which state, and what stops it.
//!
//! A pump that pushes air into silicone has few ways to do harm, and all of them are a motor that
//! runs on or a valve that stays shut. So the decision is one table of states and conditions,
//! apart from the code that controls anything, and whatever that code asks for passes through
//! [`Supervisor::restrain`]. The table for people is `docs/safety.md`; a test compares the two.

use wire::{fault::Fault, reply::Refusal, state::State};

use crate::io::{Inputs, Outputs, Pump, Valve};

/// A fault that latches in every state.
const ALWAYS: bool = true;

/// One that latches only while the pump may move.
const WHILE_ARMED: bool = false;

/// Declares what may be wrong, once: the flag, its fault and when that latches. The order is that
/// of their weight.
macro_rules! conditions {
    ($( $(#[$doc:meta])* $flag:ident: $fault:ident $when:ident, )+) => {
        /// What may be wrong in this control period, a flag for each [`Fault`] and
        /// two that keep the rig from being armed.
        ///
        /// The flags say what *is*, not what to do about it: that depends on the state
        /// and is the supervisor's part.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[allow(clippy::struct_excessive_bools)] // They are independent of each other.
        pub struct Conditions {
            $( $(#[$doc])* pub $flag: bool, )+
            /// The pressure is farther from zero than
            /// [`LARGEST_AT_REST_PA`](crate::design::LARGEST_AT_REST_PA). No fault: between
            /// the closed valve and the pump it belongs there. Before arming, with the valve
            /// open, it means a wrong zero or a blocked vent.
            pub pressurised: bool,
            /// The supply is below [`LEAST_MV`](crate::supply::LEAST_MV), or was not measured yet.
            /// No fault either: armed, the motor's start may dip it, and it is not measured then.
            pub supply_low: bool,
        }

        impl Conditions {
            /// Whether the condition behind a fault holds.
            pub const fn holds(&self, fault: Fault) -> bool {
                match fault {
                    $( Fault::$fault => self.$flag, )+
                }
            }

            const fn faults(&self) -> Faults {
                Faults::NONE $( .with(Fault::$fault, self.$flag) )+
            }
        }

        impl Faults {
            /// What latches in every state. Motion has nothing to do with these: the
            /// operator must have seen them before the rig is armed. Pressure above the
            /// limit, and any that stays, belong here because in idle the valve is open: then
            /// it is a blocked vent.
            const ALWAYS: Self = Self::NONE $( .with(Fault::$fault, $when) )+;

            /// What latches only while the pump may move. At rest these are only shown:
            /// sensors are plugged in and out, actuators are bent by hand, nobody
            /// listens, and a self-test takes longer than a period.
            const WHILE_ARMED: Self = Self::NONE $( .with(Fault::$fault, !$when) )+;

            /// The one that explains the others: the first in the table.
            fn first(self) -> Option<Fault> {
                // Compared one by one: an array of these would lie in RAM.
                $( if self.has(Fault::$fault) { return Some(Fault::$fault); } )+
                None
            }
        }
    };
}

// People before machine, the processor and its supply before what it measures, a sensor before
// what it shows, and silence last, since a computer that is told of anything else may fall silent
// for it.
conditions! {
    /// The emergency-stop circuit is open.
    emergency_stop: EmergencyStop ALWAYS,
    /// The flash does not hold the image that was built; it stays so until another is uploaded.
    image_damaged: Image ALWAYS,
    /// The firmware reached a state that it excludes.
    internal: Internal ALWAYS,
    /// The watchdog caused the last reset. True for the first period only:
    /// it is an event, and an event is gone once it has been latched.
    watchdog: Watchdog ALWAYS,
    /// The last reset came from a dip of the supply. True for the first period
    /// only, like [`Self::watchdog`].
    brown_out: BrownOut ALWAYS,
    /// The rig was armed when the board restarted. True for the first period only, like
    /// [`Self::watchdog`].
    restarted: Restart ALWAYS,
    /// The settings in use are not those that were stored, because these are
    /// damaged; true until valid ones are saved.
    settings_damaged: Settings ALWAYS,
    /// The converter's reference moved since the rig was armed; see [`crate::supply`].
    supply_moved: Supply WHILE_ARMED,
    /// Both sensors moved alike while nothing was pushed; see [`crate::ground`].
    ground_moved: Ground WHILE_ARMED,
    /// The pressure sensor has no reading.
    pressure_sensor: PressureSensor WHILE_ARMED,
    /// The flex sensor has no reading.
    flex_sensor: FlexSensor WHILE_ARMED,
    /// The gauge pressure is above the limit of the settings.
    over_pressure: OverPressure ALWAYS,
    /// The valve has been open for longer than
    /// [`LONGEST_VENTING_PERIODS`](crate::design::LONGEST_VENTING_PERIODS), and the pressure
    /// has not been near zero for
    /// [`STILL_PRESSURISED_PERIODS`](crate::design::STILL_PRESSURISED_PERIODS) since: it
    /// stays, or a plunger that goes back sucks the actuator flat. In idle too: who is done
    /// with the rig touches the actuator.
    vent_blocked: Vent ALWAYS,
    /// The bending angle is above the limit of the settings.
    over_angle: OverAngle WHILE_ARMED,
    /// The plunger runs into an end; see [`runs_into_end`].
    end_switch: EndSwitch WHILE_ARMED,
    /// Homing looks for the retracted switch and comes to the other one.
    motor_reversed: MotorReversed WHILE_ARMED,
    /// Homing leaves the retracted switch, and it stays pressed.
    retracted_switch: RetractedSwitch WHILE_ARMED,
    /// The pump moves and nothing follows, or homing finds no switch.
    stall: Stall WHILE_ARMED,
    /// Pressure and pushed-in volume contradict each other; see [`crate::gas`].
    gas_law: GasLaw WHILE_ARMED,
    /// The pump is at the end of its stroke and far from the pressure set-point.
    out_of_reach: Reach WHILE_ARMED,
    /// In closed loop, sensor and prediction show different angles.
    disagreement: Disagreement WHILE_ARMED,
    /// Volume was pushed in, and the pressure sensor did not show it; see [`crate::sight`].
    blind: Blind WHILE_ARMED,
    /// The pressure sensor is later than the pump's speed allows; see [`crate::sight`].
    late: Late WHILE_ARMED,
    /// A control period took longer than it may.
    overrun: Overrun WHILE_ARMED,
    /// Nothing was heard from the computer for longer than the settings allow.
    host_silent: HostLost WHILE_ARMED,
}

/// Whether the plunger runs into an end switch: the flag
/// [`Conditions::end_switch`].
///
/// `rate` is what the pump is told to do (microsteps/s, positive compresses).
/// Once homed, the plunger stands clear of both switches and its way ends before
/// them, so either of them counts in motion, whatever the direction: a swapped
/// motor wire or a lost home would otherwise be excused. While homing, the
/// retracted switch is what the plunger looks for, and the other one is left,
/// not run into, when it retracts; only who measures the stroke `seeks_pushed_end`.
/// A plunger cannot be at both ends, so two open switches are a broken wire and count
/// in every state, moving or not.
pub fn runs_into_end(state: State, inputs: &Inputs, rate: f32, seeks_pushed_end: bool) -> bool {
    let (retracted, pushed) = (inputs.retracted_end, inputs.pushed_end);
    let in_motion = match state {
        State::Ready | State::Running => rate.abs() > 0.0 && (retracted || pushed),
        State::Idle | State::Homing | State::Fault => rate > 0.0 && pushed && !seeks_pushed_end,
    };
    in_motion || (retracted && pushed)
}

/// A set of faults, a bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Faults(u32);

impl Faults {
    const NONE: Self = Self(0);

    const fn with(self, fault: Fault, holds: bool) -> Self {
        if holds {
            Self(self.0 | 1 << (fault.code() - 1))
        } else {
            self
        }
    }

    const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    const fn common(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    const fn is_empty(self) -> bool {
        self.0 == 0
    }

    const fn has(self, fault: Fault) -> bool {
        !self.common(Self::NONE.with(fault, true)).is_empty()
    }
}

/// Whether a condition latches a fault in a state.
///
/// In [`State::Fault`] it means that the condition is latched beside the first
/// one and has to be gone too before the fault can be cleared.
pub const fn trips(state: State, fault: Fault) -> bool {
    tripping(state).has(fault)
}

const fn tripping(state: State) -> Faults {
    match state {
        State::Idle | State::Fault => Faults::ALWAYS,
        State::Homing | State::Ready | State::Running => Faults::ALWAYS.union(Faults::WHILE_ARMED),
    }
}

/// What may ask for another state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Event {
    /// The computer arms the rig: home, close the valve, be ready.
    Arm,
    /// Homing has set the position.
    Homed,
    /// The computer starts a protocol.
    Run,
    /// The protocol is at its end.
    ProtocolDone,
    /// Pump off, valve open, now. Never refused.
    Stop,
    /// The computer is done with the rig.
    Disarm,
    /// The operator has removed the cause of a fault.
    Clear,
}

/// When the valve may be closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Closing {
    /// Never.
    Never,
    /// While the plunger does not go back: with the valve shut it would suck the actuator flat.
    UnlessRetracting,
    /// At any time.
    Always,
}

/// What the actuators may do in a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Permit {
    /// The pump's driver may be on.
    pub pump: bool,
    /// When the valve may be closed.
    pub valve: Closing,
}

impl Permit {
    /// The permit of a state.
    ///
    /// Homing closes the valve to test whether the sensor sees what is pushed.
    pub const fn of(state: State) -> Self {
        match state {
            State::Idle | State::Fault => Self {
                pump: false,
                valve: Closing::Never,
            },
            State::Homing => Self {
                pump: true,
                valve: Closing::UnlessRetracting,
            },
            State::Ready | State::Running => Self {
                pump: true,
                valve: Closing::Always,
            },
        }
    }
}

/// The state of the rig and the faults that are latched.
///
/// The order of a control period: [`Supervisor::update`] with the conditions, then
/// [`Supervisor::handle`] for what was asked, then the control logic, then
/// [`Supervisor::restrain`] on its outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervisor {
    state: State,
    /// What tripped first, [`State::Fault`] exactly while there is one.
    cause: Option<Fault>,
    /// Everything that tripped since.
    latched: Faults,
}

impl Default for Supervisor {
    fn default() -> Self {
        Self::new()
    }
}

impl Supervisor {
    /// The state after a reset: idle, nothing latched.
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            cause: None,
            latched: Faults::NONE,
        }
    }

    /// What the rig is doing.
    pub const fn state(&self) -> State {
        self.state
    }

    /// The fault that stopped the rig; none unless the state is
    /// [`State::Fault`]. Later faults do not replace it, since an operator who
    /// hits the emergency stop because of an over-pressure wants to read of the
    /// over-pressure.
    pub const fn fault(&self) -> Option<Fault> {
        self.cause
    }

    /// Whether a fault is latched, as the first or beside it.
    pub const fn is_latched(&self, fault: Fault) -> bool {
        self.latched.has(fault)
    }

    /// What the actuators may do now.
    pub const fn permit(&self) -> Permit {
        Permit::of(self.state)
    }

    /// Looks at the conditions; call it first in every control period.
    ///
    /// Returns the fault that it latched if this stopped the rig just now.
    pub fn update(&mut self, conditions: &Conditions) -> Option<Fault> {
        let tripped = conditions.faults().common(tripping(self.state));
        self.latched = self.latched.union(tripped);
        if self.state == State::Fault {
            return None;
        }
        let cause = tripped.first()?;
        self.state = State::Fault;
        self.cause = Some(cause);
        Some(cause)
    }

    /// Changes the state if the event may do that now.
    ///
    /// | event | idle | homing | ready | running | fault |
    /// |---|---|---|---|---|---|
    /// | arm | homing | – | – | – | – |
    /// | homed | – | ready | – | – | – |
    /// | run | – | – | running | – | – |
    /// | protocol done | – | – | – | ready | – |
    /// | stop | idle | idle | idle | idle | fault |
    /// | disarm | idle | idle | idle | idle | – |
    /// | clear | idle | homing | ready | running | idle |
    ///
    /// # Errors
    ///
    /// Nothing is changed then.
    ///
    /// - [`Refusal::Faulted`]: a fault is latched, and only `Clear` leads out.
    /// - [`Refusal::StillThere`]: `Clear`, and a latched condition still holds,
    ///   or another one that trips in idle.
    /// - [`Refusal::NoReading`]: `Arm` while a sensor has no reading.
    /// - [`Refusal::Pressurised`]: `Arm` while the pressure is not near zero.
    /// - [`Refusal::NotNow`]: any other dash of the table.
    pub fn handle(&mut self, event: Event, conditions: &Conditions) -> Result<(), Refusal> {
        let next = match (self.state, event) {
            (State::Fault, Event::Clear) => {
                let relevant = self.latched.union(tripping(State::Idle));
                if !conditions.faults().common(relevant).is_empty() {
                    return Err(Refusal::StillThere);
                }
                self.cause = None;
                self.latched = Faults::NONE;
                State::Idle
            }
            // Stopping what is stopped is no mistake, and neither is clearing
            // what is clear.
            (state @ State::Fault, Event::Stop) | (state, Event::Clear) => state,
            (State::Fault, _) => return Err(Refusal::Faulted),
            (_, Event::Stop | Event::Disarm) => State::Idle,
            (State::Idle, Event::Arm) => {
                if conditions.pressure_sensor || conditions.flex_sensor {
                    return Err(Refusal::NoReading);
                }
                if conditions.pressurised {
                    return Err(Refusal::Pressurised);
                }
                if conditions.supply_low {
                    return Err(Refusal::LowSupply);
                }
                State::Homing
            }
            (State::Homing, Event::Homed) | (State::Running, Event::ProtocolDone) => State::Ready,
            (State::Ready, Event::Run) => State::Running,
            _ => return Err(Refusal::NotNow),
        };
        self.state = next;
        Ok(())
    }

    /// Takes from the outputs what the state does not permit; call it last in
    /// every control period, on whatever the control logic has computed.
    ///
    /// A rate that is not a number stops the pump.
    pub fn restrain(&self, outputs: Outputs) -> Outputs {
        let permit = self.permit();
        let retracts = matches!(outputs.pump, Pump::Rate(rate) if rate < 0.0);
        let may_close = match permit.valve {
            Closing::Never => false,
            Closing::UnlessRetracting => !retracts,
            Closing::Always => true,
        };
        Outputs {
            pump: match outputs.pump {
                _ if !permit.pump => Pump::Off,
                Pump::Rate(rate) if !rate.is_finite() => Pump::Brake,
                pump => pump,
            },
            valve: if may_close {
                outputs.valve
            } else {
                Valve::Open
            },
            ..outputs
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::{format, string::String, vec::Vec};

    const EVENTS: [Event; 7] = [
        Event::Arm,
        Event::Homed,
        Event::Run,
        Event::ProtocolDone,
        Event::Stop,
        Event::Disarm,
        Event::Clear,
    ];

    fn conditions(bits: u32) -> Conditions {
        let bit = |fault: Fault| bits >> (fault.code() - 1) & 1 == 1;
        Conditions {
            emergency_stop: bit(Fault::EmergencyStop),
            over_pressure: bit(Fault::OverPressure),
            over_angle: bit(Fault::OverAngle),
            pressure_sensor: bit(Fault::PressureSensor),
            flex_sensor: bit(Fault::FlexSensor),
            stall: bit(Fault::Stall),
            end_switch: bit(Fault::EndSwitch),
            host_silent: bit(Fault::HostLost),
            watchdog: bit(Fault::Watchdog),
            brown_out: bit(Fault::BrownOut),
            restarted: bit(Fault::Restart),
            settings_damaged: bit(Fault::Settings),
            overrun: bit(Fault::Overrun),
            internal: bit(Fault::Internal),
            retracted_switch: bit(Fault::RetractedSwitch),
            motor_reversed: bit(Fault::MotorReversed),
            vent_blocked: bit(Fault::Vent),
            out_of_reach: bit(Fault::Reach),
            disagreement: bit(Fault::Disagreement),
            gas_law: bit(Fault::GasLaw),
            image_damaged: bit(Fault::Image),
            blind: bit(Fault::Blind),
            late: bit(Fault::Late),
            supply_moved: bit(Fault::Supply),
            ground_moved: bit(Fault::Ground),
            pressurised: bits >> Fault::ALL.len() & 1 == 1,
            supply_low: bits >> (Fault::ALL.len() + 1) & 1 == 1,
        }
    }

    fn only(fault: Fault) -> Conditions {
        conditions(1 << (fault.code() - 1))
    }

    /// All sets of at most three conditions, and what is left of everything without them:
    /// no rule of the supervisor looks at more than two at once.
    fn all_conditions() -> impl Iterator<Item = Conditions> {
        const EVERYTHING: u32 = (1 << (Fault::ALL.len() + 2)) - 1;
        (0..=EVERYTHING)
            .filter(|bits| bits.count_ones().min((EVERYTHING & !bits).count_ones()) <= 3)
            .map(conditions)
    }

    /// A supervisor that got to a state in the only ways there are; a fault is
    /// there once for each cause and state in which it strikes.
    fn ways_to(state: State) -> Vec<Supervisor> {
        let none = Conditions::default();
        let walk = |events: &[Event]| {
            let mut supervisor = Supervisor::new();
            for &event in events {
                supervisor.handle(event, &none).unwrap();
            }
            supervisor
        };
        let calm = |state| match state {
            State::Idle => walk(&[]),
            State::Homing => walk(&[Event::Arm]),
            State::Ready => walk(&[Event::Arm, Event::Homed]),
            State::Running => walk(&[Event::Arm, Event::Homed, Event::Run]),
            State::Fault => unreachable!(),
        };
        if state != State::Fault {
            return std::vec![calm(state)];
        }
        let mut ways = Vec::new();
        for from in &State::ALL[..4] {
            for &fault in Fault::ALL {
                let mut supervisor = calm(*from);
                if supervisor.update(&only(fault)).is_some() {
                    ways.push(supervisor);
                }
            }
        }
        ways
    }

    fn armed(state: State) -> bool {
        matches!(state, State::Homing | State::Ready | State::Running)
    }

    const GREEDY: Outputs = Outputs {
        pump: Pump::Rate(1000.0),
        valve: Valve::Closed,
        set_steps: None,
        light: true,
    };

    /// Every state, sets of conditions, every event.
    #[test]
    fn nothing_gets_past_the_supervisor() {
        for state in State::ALL {
            for start in ways_to(state) {
                assert_eq!(start.state(), state);
                for now in all_conditions() {
                    let mut updated = start;
                    let news = updated.update(&now);
                    check_update(start, &now, updated, news);
                    for event in EVENTS {
                        let mut after = updated;
                        let outcome = after.handle(event, &now);
                        check_event(updated, &now, event, outcome, after);
                    }
                }
            }
        }
    }

    fn check_always(it: Supervisor) {
        assert_eq!(it.state() == State::Fault, it.fault().is_some());
        let outputs = it.restrain(GREEDY);
        if !armed(it.state()) {
            assert_eq!((outputs.pump, outputs.valve), (Pump::Off, Valve::Open));
        }
        if it.state() == State::Homing {
            let retracting = Outputs {
                pump: Pump::Rate(-1.0),
                ..GREEDY
            };
            assert_eq!(it.restrain(retracting).valve, Valve::Open);
        }
    }

    fn check_update(before: Supervisor, now: &Conditions, after: Supervisor, news: Option<Fault>) {
        check_always(after);
        // No fault is lost: what trips is latched, and what was latched stays.
        for &fault in Fault::ALL {
            let trips = now.holds(fault) && trips(before.state(), fault);
            assert_eq!(
                after.is_latched(fault),
                trips || before.is_latched(fault),
                "{before:?} {fault:?}"
            );
        }
        // Looking at the conditions stops the rig or does nothing.
        if after.state() == before.state() {
            assert_eq!((news, after.fault()), (None, before.fault()));
        } else {
            assert_eq!(after.state(), State::Fault);
            assert!(news.is_some_and(|fault| now.holds(fault)));
            assert_eq!(news, after.fault());
        }
        // Nothing that must stop an armed rig is ever ignored.
        if armed(before.state()) {
            assert_eq!(after.state() == State::Fault, !now.faults().is_empty());
        }
    }

    fn check_event(
        before: Supervisor,
        now: &Conditions,
        event: Event,
        outcome: Result<(), Refusal>,
        after: Supervisor,
    ) {
        check_always(after);
        if outcome.is_err() {
            assert_eq!(before, after, "a refusal changes nothing");
        }
        if event == Event::Stop {
            assert_eq!(outcome, Ok(()));
            assert!(!armed(after.state()));
        }
        let moved = after.state() != before.state();
        match after.state() {
            State::Running if moved => {
                assert_eq!((before.state(), event), (State::Ready, Event::Run));
            }
            State::Ready if moved => assert!(matches!(
                (before.state(), event),
                (State::Homing, Event::Homed) | (State::Running, Event::ProtocolDone)
            )),
            State::Homing if moved => {
                assert_eq!((before.state(), event), (State::Idle, Event::Arm));
                assert!(!now.pressure_sensor && !now.flex_sensor);
                assert!(!now.pressurised && !now.supply_low);
            }
            State::Fault => assert!(!moved, "only conditions are faults"),
            _ => {}
        }
        if before.state() == State::Fault {
            let gone = Fault::ALL.iter().all(|&fault| {
                !now.holds(fault) || !(before.is_latched(fault) || trips(State::Idle, fault))
            });
            assert_eq!(moved, event == Event::Clear && gone);
            match event {
                Event::Stop => {}
                Event::Clear if gone => {
                    assert_eq!(after, Supervisor::new());
                }
                Event::Clear => assert_eq!(outcome, Err(Refusal::StillThere)),
                _ => assert_eq!(outcome, Err(Refusal::Faulted)),
            }
        }
    }

    /// The table that people read, as the code has it.
    fn table() -> String {
        let mut text = String::new();
        for &fault in Fault::ALL {
            text.push_str(&format!("| {} |", fault.name()));
            for state in &State::ALL[..4] {
                let mut supervisor = ways_to(*state)[0];
                let stopped = supervisor.update(&only(fault)) == Some(fault);
                text.push_str(if stopped { " stops |" } else { " shown |" });
            }
            text.push('\n');
        }
        text
    }

    #[test]
    fn what_trips_where() {
        assert_eq!(
            table(),
            "\
| emergency stop | stops | stops | stops | stops |
| over-pressure | stops | stops | stops | stops |
| over-angle | shown | stops | stops | stops |
| pressure sensor | shown | stops | stops | stops |
| flex sensor | shown | stops | stops | stops |
| stall | shown | stops | stops | stops |
| end switch | shown | stops | stops | stops |
| computer lost | shown | stops | stops | stops |
| watchdog | stops | stops | stops | stops |
| brown-out | stops | stops | stops | stops |
| settings | stops | stops | stops | stops |
| overrun | shown | stops | stops | stops |
| internal | stops | stops | stops | stops |
| retracted switch | shown | stops | stops | stops |
| motor direction | shown | stops | stops | stops |
| vent | stops | stops | stops | stops |
| out of reach | shown | stops | stops | stops |
| disagreement | shown | stops | stops | stops |
| gas law | shown | stops | stops | stops |
| restart | stops | stops | stops | stops |
| image | stops | stops | stops | stops |
| blind | shown | stops | stops | stops |
| late sensor | shown | stops | stops | stops |
| supply | shown | stops | stops | stops |
| ground | shown | stops | stops | stops |
"
        );
    }

    /// The page that people read.
    #[test]
    fn the_documents_tables_are_those_of_the_code() {
        let page = include_str!("../../docs/safety.md");
        assert!(page.contains(&table()));
        for &fault in Fault::ALL {
            let row = format!(
                "| {} | {} | {} |",
                fault.code(),
                fault.name(),
                fault.sentence()
            );
            assert!(page.contains(&row), "{row}");
        }
        for state in State::ALL {
            let permit = Permit::of(state);
            let row = format!(
                "| {} | {} | {} |",
                state.name(),
                if permit.pump { "may move" } else { "off" },
                match permit.valve {
                    Closing::Never => "open",
                    Closing::UnlessRetracting => "may close, not while the plunger goes back",
                    Closing::Always => "may close",
                }
            );
            assert!(page.contains(&row), "{row}");
        }
    }

    #[test]
    fn of_several_causes_the_one_that_explains_the_others_is_shown() {
        for (both, shown) in [
            // A shorted sensor reads full scale.
            (
                [Fault::OverPressure, Fault::PressureSensor],
                Fault::PressureSensor,
            ),
            ([Fault::Stall, Fault::EmergencyStop], Fault::EmergencyStop),
            ([Fault::HostLost, Fault::Stall], Fault::Stall),
            ([Fault::FlexSensor, Fault::BrownOut], Fault::BrownOut),
        ] {
            let bits = both
                .iter()
                .fold(0, |bits, fault| bits | 1 << (fault.code() - 1));
            let mut supervisor = ways_to(State::Running)[0];
            assert_eq!(supervisor.update(&conditions(bits)), Some(shown));
            assert!(both.iter().all(|&fault| supervisor.is_latched(fault)));
        }
        // Each has its rank, else it would not stop anything.
        for &fault in Fault::ALL {
            assert_eq!(only(fault).faults().first(), Some(fault));
        }
    }

    #[test]
    fn a_later_fault_is_kept_beside_the_first() {
        let mut supervisor = ways_to(State::Running)[0];
        supervisor.update(&only(Fault::OverAngle));
        assert_eq!(supervisor.update(&only(Fault::EmergencyStop)), None);
        assert_eq!(supervisor.fault(), Some(Fault::OverAngle));
        assert_eq!(
            supervisor.handle(Event::Clear, &only(Fault::EmergencyStop)),
            Err(Refusal::StillThere)
        );
        assert_eq!(
            supervisor.handle(Event::Clear, &only(Fault::OverAngle)),
            Err(Refusal::StillThere)
        );
        assert_eq!(
            supervisor.handle(Event::Clear, &Conditions::default()),
            Ok(())
        );
        assert_eq!(supervisor.state(), State::Idle);
    }

    #[test]
    fn an_end_counts_in_motion_and_homing_may_look_for_its_own() {
        let at = |retracted_end, pushed_end| Inputs {
            retracted_end,
            pushed_end,
            ..Inputs::default()
        };
        for state in [State::Ready, State::Running] {
            for (retracted, pushed) in [(true, false), (false, true)] {
                assert!(runs_into_end(state, &at(retracted, pushed), -1.0, false));
                assert!(runs_into_end(state, &at(retracted, pushed), 1.0, false));
                assert!(!runs_into_end(state, &at(retracted, pushed), 0.0, false));
            }
            assert!(!runs_into_end(state, &at(false, false), 1.0, false));
        }
        assert!(!runs_into_end(State::Homing, &at(true, false), -1.0, false));
        assert!(runs_into_end(State::Homing, &at(false, true), 1.0, false));
        assert!(!runs_into_end(State::Homing, &at(false, true), -1.0, false));
        assert!(!runs_into_end(State::Homing, &at(false, true), 1.0, true));
        // Nothing is at both ends.
        for state in State::ALL {
            for seeks in [false, true] {
                assert!(runs_into_end(state, &at(true, true), 0.0, seeks));
            }
        }
    }

    #[test]
    fn a_rate_that_is_not_a_number_stops_the_pump() {
        let running = ways_to(State::Running)[0];
        for rate in [f32::NAN, f32::INFINITY] {
            let outputs = running.restrain(Outputs {
                pump: Pump::Rate(rate),
                ..GREEDY
            });
            assert_eq!(outputs.pump, Pump::Brake);
        }
        assert_eq!(running.restrain(GREEDY), GREEDY);
    }
}
