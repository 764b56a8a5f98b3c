//! What every period needs of the settings and the stroke, computed when they change: a division and
//! seven multiplications, 2 600 cycles a period.

use wire::settings::{Key, Settings};

use crate::{
    control::ATMOSPHERE_PA,
    design::{BEYOND_LIMIT_PA, STOPS_PA},
    homing,
    settings::Limits,
    stroke::Stroke,
};

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Derived {
    /// Where the rig is stopped.
    pub(super) limits: Limits,
    /// The most that the pump may displace (µl).
    pub(super) largest: f32,
    /// Fastest change of the pump's rate (microsteps/s²).
    pub(super) acceleration: f32,
    /// The air behind the plunger at its start (µl), as the last arming found it; zero before.
    pub(super) air: f32,
    /// Where the plunger is (µl) when that air, compressed, is [`BEYOND_LIMIT_PA`] above the limit.
    pub(super) farthest: f32,
    /// The same with [`STOPS_PA`]: no reading takes it there.
    pub(super) most: f32,
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
        air: 0.0,
        farthest: f32::INFINITY,
        most: 0.0,
    };

    /// Computes it.
    #[inline(never)] // One copy of three.
    pub(super) fn of(settings: &Settings, stroke: &Stroke) -> Self {
        Self {
            limits: Limits::of(settings),
            largest: stroke.largest(settings),
            acceleration: settings.number(Key::MaxFlowRate) / settings.number(Key::VolumePerStep),
            air: 0.0,
            farthest: f32::INFINITY,
            most: 0.0,
        }
    }

    /// Forgets the air: the rig is armed anew.
    pub(super) fn forget_air(&mut self) {
        self.air = 0.0;
        self.farthest = f32::INFINITY;
        self.most = 0.0;
    }

    /// The air (µl), where it is known.
    pub(super) fn air_ul(&self) -> Option<u32> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Saturates.
        (self.air > 0.0).then_some(self.air as u32)
    }

    /// Takes the air (µl) that was found behind the plunger at its start.
    #[inline(never)]
    pub(super) fn take_air(&mut self, settings: &Settings, air: f32) {
        let start = homing::Config::of(settings).start_volume();
        let place = |beyond: f32| {
            let highest = self.limits.pressure_pa + beyond;
            start + air * (highest / (ATMOSPHERE_PA + highest))
        };
        (self.farthest, self.most) = (place(BEYOND_LIMIT_PA), place(STOPS_PA));
        self.air = air;
    }
}
