//! The second before a fault, as the board remembers it: `NAME.blackbox.csv`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use softrig_formats::recording::BLACK_BOX_ENDING;
use wire::history::Moment;

use super::LoggedSample;
use super::sheet::{push, push_time};

/// The columns, in their order.
const COLUMNS: &str = "time_s,pressure_kpa,angle_deg,pump_ul,state,segment";

/// Where the second before a fault goes.
pub fn black_box_path(path: &Path) -> PathBuf {
    path.with_extension(&BLACK_BOX_ENDING[1..])
}

/// The table. Its times are those of the recording whose last row is given; without one, those of
/// the board's clock.
pub(super) fn text(
    past: &[Moment],
    last: Option<&LoggedSample>,
    clock_factor: Option<f64>,
) -> String {
    let mut text = format!("{COLUMNS}\n");
    for moment in past {
        let time_ms = last.map_or(i64::from(moment.time_ms), |row| {
            // The clock wraps after 49 days.
            row.time_ms - i64::from(row.sample.time_ms.wrapping_sub(moment.time_ms))
        });
        push_time(&mut text, time_ms, clock_factor);
        for value in [moment.pressure_kpa, moment.angle_deg] {
            text.push(',');
            push(&mut text, value);
        }
        let _ = write!(text, ",{},{},", moment.volume_ul, moment.state.name());
        if let Some(segment) = moment.segment {
            let _ = write!(text, "{segment}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use wire::decimal::Hundredths;
    use wire::state::State;
    use wire::telemetry::{Setpoint, Telemetry};

    use super::*;

    #[test]
    fn times_are_those_of_the_recording() {
        let moment = |time_ms, segment| Moment {
            time_ms,
            pressure_kpa: Some(Hundredths(18_120)),
            angle_deg: None,
            volume_ul: 14_210,
            state: State::Running,
            segment,
        };
        let last = LoggedSample {
            time_ms: 1_500,
            sample: Telemetry {
                sequence: 0,
                time_ms: 700,
                pressure_kpa: None,
                angle_deg: None,
                predicted_deg: None,
                setpoint: Setpoint::None,
                volume_ul: 0,
                state: State::Fault,
                fault: 4,
                mismatch: false,
            },
        };
        // It began when the recording had not.
        let past = [moment(u32::MAX - 999, None), moment(200, Some(4))];
        assert_eq!(
            text(&past, Some(&last), None),
            "time_s,pressure_kpa,angle_deg,pump_ul,state,segment\n\
             -0.200,181.20,,14210,running,\n\
             1.000,181.20,,14210,running,4\n"
        );
        // A slow board: the recording's times are stretched, and so are these.
        let stretched = text(&past[1..], Some(&last), Some(1.004));
        assert!(stretched.contains("\n1.004000,181.20"), "{stretched}");
        assert!(text(&past[1..], None, None).ends_with("\n0.200,181.20,,14210,running,4\n"));
    }
}
