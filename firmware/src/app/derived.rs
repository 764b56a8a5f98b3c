//! What every period needs of the settings and the stroke, computed when they change: a division and
//! seven multiplications, 2 600 cycles a period.

use wire::settings::{Key, Settings};

use crate::{settings::Limits, stroke::Stroke};

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Derived {
    /// Where the rig is stopped.
    pub(super) limits: Limits,
    /// The most that the pump may displace (µl).
    pub(super) largest: f32,
    /// Fastest change of the pump's rate (microsteps/s²).
    pub(super) acceleration: f32,
}

impl Derived {
    /// Before there are settings: nothing may move.
    pub(super) const NONE: Self = Self {
        limits: Limits {
            pressure_pa: 0.0,
            angle_rad: 0.0,
            host_timeout_ms: 0,
        },
        largest: 0.0,
        acceleration: 0.0,
    };

    /// Computes it.
    #[inline(never)] // One copy of three.
    pub(super) fn of(settings: &Settings, stroke: &Stroke) -> Self {
        Self {
            limits: Limits::of(settings),
            largest: stroke.largest(settings),
            acceleration: settings.number(Key::MaxFlowRate) / settings.number(Key::VolumePerStep),
        }
    }
}
