//! Checks a protocol against the limits of a board.
//!
//! The board checks too. Here the error names the segment, its line and the setting,
//! before the plunger is homed.

use wire::decimal::Hundredths;
use wire::protocol::{ControlMode, Segment};
use wire::settings::{Key, Settings};

use softrig_formats::error::InputError;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::settings_file::key_text;

/// Something to know that does not forbid the run.
pub type Advice = String;

/// Checks every segment against the limits in `settings`.
///
/// # Errors
///
/// Names the first segment that asks for too much.
pub fn check_limits(
    protocol: &ProtocolFile,
    settings: &Settings,
) -> Result<Vec<Advice>, InputError> {
    let mut advice = Vec::new();
    for (index, segment) in protocol.segments.iter().enumerate() {
        let Some(mode) = segment.mode() else {
            continue;
        };
        let (limit_key, unit) = match mode {
            ControlMode::Pressure => (Key::SetpointMaxPressure, "kPa"),
            ControlMode::AngleOpenLoop | ControlMode::AngleClosedLoop => (Key::SetpointMax, "°"),
        };
        let limit = settings.number(limit_key);
        let highest = segment.highest().to_f32();
        if highest > limit {
            return Err(protocol.fault_at(
                index,
                format!(
                    "asks for {highest} {unit}, and the board allows {limit} {unit} ({})",
                    key_text(limit_key)
                ),
                "lower the level, or raise the limit with `softrig upload --settings` if the rig stands it",
            ));
        }
        if lowest(segment).0 < 0 {
            return Err(protocol.fault_at(
                index,
                format!("goes down to {} {unit}", lowest(segment).to_f32()),
                "keep levels at or above zero",
            ));
        }
        if mode == ControlMode::AngleOpenLoop {
            let pressure = holding_pressure_kpa(settings, highest);
            let limit = settings.number(Key::SetpointMaxPressure);
            if pressure > limit {
                advice.push(format!(
                    "segment {}: the board's model needs {pressure:.0} kPa for {highest}° and allows {limit} kPa: the actuator will not reach it",
                    index + 1
                ));
            }
        }
    }
    Ok(advice)
}

fn lowest(segment: &Segment) -> Hundredths {
    match *segment {
        Segment::Step { level, .. } | Segment::Ramp { level, .. } => level,
        Segment::Multisine {
            centre, amplitude, ..
        } => Hundredths(centre.0.saturating_sub(amplitude.0.saturating_abs())),
        _ => Hundredths(0),
    }
}

/// The pressure that holds an angle, by the plain model on the board.
fn holding_pressure_kpa(settings: &Settings, angle_deg: f32) -> f32 {
    let force = settings.number(Key::Stiffness)
        * angle_deg.to_radians().powf(settings.number(Key::Exponent));
    force / settings.number(Key::InputGain) / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn protocol(level: &str) -> ProtocolFile {
        let text = format!(
            "schema = 1\n\n[[segment]]\nkind = \"release\"\nduration_s = 1\n\n[[segment]]\nkind = \"step\"\ntrack = {level}\nduration_s = 1\n"
        );
        ProtocolFile::parse(&text, Path::new("p.toml")).unwrap()
    }

    #[test]
    fn too_much_is_refused_with_its_line_and_its_limit() {
        let mut settings = Settings::DEFAULT;
        for (key, limit) in [
            (Key::SetpointMax, 110.0_f32),
            (Key::SetpointMaxPressure, 160.0),
        ] {
            settings.set(key, limit.to_bits()).unwrap();
        }
        for (level, part) in [
            ("\"angle_open_loop\"\nlevel_deg = 110.5", "110.5 °"),
            ("\"pressure\"\nlevel_kpa = 161", "161 kPa"),
            ("\"pressure\"\nlevel_kpa = -1", "-1 kPa"),
        ] {
            let error = check_limits(&protocol(level), &settings).unwrap_err();
            let message = error.to_string();
            assert!(message.contains("p.toml, line 7: segment 2"), "{message}");
            assert!(message.contains(part), "{message}");
        }
        for level in [
            "\"angle_closed_loop\"\nlevel_deg = 110",
            "\"pressure\"\nlevel_kpa = 160",
        ] {
            assert_eq!(
                check_limits(&protocol(level), &settings).map(drop),
                Ok(()),
                "{level}"
            );
        }
    }

    #[test]
    fn an_angle_beyond_the_pressure_is_said_beforehand() {
        let open = protocol("\"angle_open_loop\"\nlevel_deg = 110");
        let mut settings = Settings::DEFAULT;
        settings
            .set(Key::SetpointMaxPressure, 50.0_f32.to_bits())
            .unwrap();
        let advice = check_limits(&open, &settings).unwrap();
        assert!(advice[0].contains("50 kPa"), "{advice:?}");
    }
}
