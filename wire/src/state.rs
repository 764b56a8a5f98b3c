//! The state of the board, as one letter.

/// The states of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// Pump off, valve open. Sensors are read; commands may change settings.
    Idle,
    /// The plunger is looking for its retracted end switch.
    Homing,
    /// Armed: homed, driver on, valve closed, waiting for a protocol.
    Ready,
    /// A protocol is running.
    Running,
    /// A fault is latched: pump off, valve open, until `clear`.
    Fault,
}

impl State {
    /// Every state.
    pub const ALL: [Self; 5] = [
        Self::Idle,
        Self::Homing,
        Self::Ready,
        Self::Running,
        Self::Fault,
    ];

    /// The letter in telemetry.
    pub const fn letter(self) -> u8 {
        match self {
            Self::Idle => b'i',
            Self::Homing => b'h',
            Self::Ready => b'r',
            Self::Running => b'x',
            Self::Fault => b'f',
        }
    }

    /// The state behind a letter.
    pub const fn from_letter(letter: u8) -> Option<Self> {
        Some(match letter {
            b'i' => Self::Idle,
            b'h' => Self::Homing,
            b'r' => Self::Ready,
            b'x' => Self::Running,
            b'f' => Self::Fault,
            _ => return None,
        })
    }

    /// The word in recordings and on the screen.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Homing => "homing",
            Self::Ready => "ready",
            Self::Running => "running",
            Self::Fault => "fault",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::State;

    #[test]
    fn letters_lead_back() {
        for state in State::ALL {
            assert_eq!(State::from_letter(state.letter()), Some(state));
        }
        assert_eq!(State::from_letter(b'?'), None);
    }
}
