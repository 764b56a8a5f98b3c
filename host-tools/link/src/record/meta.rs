//! The metadata of a recording: `NAME.meta.toml`.

use serde::Serialize;

use super::seconds;
use crate::{Break, Counters};
use softrig_formats::recording::SegmentMeta;
use softrig_formats::setup::Setup;

/// The metadata written beside a recording. Readers use the fields that
/// [`Meta`](softrig_formats::recording::Meta) lists.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct About {
    /// Whether a simulator was recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulated: Option<bool>,
    /// Name of the protocol.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
    /// Set-point of a step (°).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setpoint_deg: Option<f64>,
    /// Set-point of a step (kPa).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setpoint_kpa: Option<f64>,
    /// Number of the repeat, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeat: Option<u32>,
    /// When the recording began (RFC 3339, UTC).
    pub started: String,
    /// The board's own clock at time 0 of the recording, or of the recording that
    /// this run was cut from (s since its reset).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uptime_s: Option<f64>,
    /// Seconds in one of the board's, measured by `softrig commission`. The times of the recording
    /// are corrected by it; without it they are the board's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_factor: Option<f64>,
    /// The port.
    pub port: String,
    /// Version of the firmware.
    pub firmware: String,
    /// Version of the serial protocol.
    pub wire: u8,
    /// Checksum of the board's settings.
    pub settings: String,
    /// Checksum of the board's program, if its build wrote one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// The angles between the ends of the flex sensor's table (°).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_range_deg: Option<[f64; 2]>,
    /// Version of `softrig`.
    pub rig: String,
    /// Whether the protocol was played to its end, or all that was asked for
    /// recorded.
    pub complete: bool,
    /// From when on the board's angle and its prediction disagreed (s): its
    /// mismatch flag, in a run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mismatch_from_s: Option<f64>,
    /// Microsteps that were lost from the home before the run to the one after it; positive if the
    /// plunger went less far in than was counted. Within some ten it is how well a home is found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost_steps: Option<i32>,
    /// Lines received and lost. Unknown while it is recorded, so that nothing wrong is left
    /// beside the rows if the program is killed then.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub counts: Option<Counts>,
    /// The protocol, as it was sent to the board.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<String>,
    /// The file with the second before the fault that ended it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_box: Option<String>,
    /// The files that single runs were written to.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub runs: Vec<String>,
    /// The recording that this run is a part of, and where it begins there (s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part_of: Option<String>,
    /// See `part_of`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub begins_s: Option<f64>,
    /// How the rig stood, as far as somebody said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setup: Option<Setup>,
    /// The runs within the recording, on its time axis.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub segment: Vec<SegmentMeta>,
    /// Places where samples are missing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gap: Vec<Gap>,
}

/// Lines received and lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Rows of the recording.
    pub samples: u64,
    /// Lines that the board sent and that are missing.
    pub dropped_lines: u64,
    /// Lines that arrived damaged.
    pub damaged_lines: u64,
    /// Rows that stand in `NAME.faulty.csv`, as a sensor had no reading.
    pub rows_without_reading: u64,
    /// How often the connection broke.
    pub connection_lost: u64,
}

impl Counts {
    /// Takes over what the link counted.
    pub fn count(&mut self, counters: &Counters) {
        self.dropped_lines = counters.dropped;
        self.damaged_lines = counters.damaged;
        self.connection_lost = counters.lost;
    }
}

/// A place where samples are missing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Time of the sample before (s).
    pub from_s: f64,
    /// Time of the sample after (s).
    pub to_s: f64,
    /// Whether the board restarted in between; then the gap's length is by the
    /// computer's clock.
    pub restarted: bool,
    /// The offset that is added to the board's time from here on (s).
    pub clock_offset_s: f64,
}

impl Gap {
    /// A break on the time axis, in seconds, of which `factor` make one of the board's.
    pub fn new(gap: Break, factor: Option<f64>) -> Self {
        Self {
            from_s: seconds(gap.from_ms, factor),
            to_s: seconds(gap.to_ms, factor),
            restarted: gap.restarted,
            clock_offset_s: seconds(gap.offset_ms, factor),
        }
    }
}

impl About {
    /// The text of the file.
    pub fn to_text(&self) -> String {
        // Plain values and lists: nothing in it can fail to be written.
        toml::to_string(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::recording::Meta;

    #[test]
    fn what_is_written_is_what_recordings_read() {
        let segment = SegmentMeta {
            from_s: 0.51,
            to_s: 10.52,
            setpoint_deg: Some(60.0),
            setpoint_kpa: None,
            repeat: Some(2),
        };
        let about = About {
            simulated: Some(true),
            protocol: Some("paper".into()),
            setpoint_deg: Some(60.0),
            repeat: Some(3),
            started: "2024-05-01T12:00:00Z".into(),
            uptime_s: Some(1.25),
            angle_range_deg: Some([-15.0, 130.0]),
            segments: vec!["step open 60.00 6000".into()],
            part_of: Some("run.csv".into()),
            begins_s: Some(30.5),
            setup: Some("tilt_deg=90,new_part=sensor".parse().unwrap()),
            complete: true,
            counts: Some(Counts {
                samples: 7,
                ..Counts::default()
            }),
            segment: vec![
                segment,
                SegmentMeta {
                    from_s: 10.52,
                    to_s: 20.5,
                    setpoint_kpa: Some(40.0),
                    ..SegmentMeta::default()
                },
            ],
            gap: vec![Gap {
                from_s: 1.0,
                to_s: 2.0,
                restarted: true,
                clock_offset_s: 0.5,
            }],
            ..About::default()
        };
        let meta: Meta = toml::from_str(&about.to_text()).unwrap();
        let expected = Meta {
            protocol: about.protocol,
            segments: about.segments,
            repeat: about.repeat,
            setpoint_deg: about.setpoint_deg,
            simulated: about.simulated,
            started: Some(about.started),
            uptime_s: about.uptime_s,
            part_of: about.part_of,
            begins_s: about.begins_s,
            segment: about.segment,
            angle_range_deg: about.angle_range_deg,
            // The owner of the rig writes it, not the recorder.
            calibration: None,
            complete: Some(true),
            tolerance_deg: None,
            setup: about.setup,
            samples: Some(7),
        };
        assert_eq!(meta, expected);
        assert_eq!(meta.started_unix_s(), Some(1_714_564_800.0));
    }

    #[test]
    fn an_empty_file_is_metadata_without_segments() {
        let text = About::default().to_text();
        assert!(!text.contains("segment"), "{text}");
        let meta: Meta = toml::from_str("").unwrap();
        assert_eq!(meta, Meta::default());
        assert_eq!(meta.started_unix_s(), None);
    }

    #[test]
    fn dates_and_calibrations_by_hand_are_read() {
        let read = |text: &str| toml::from_str::<Meta>(text).unwrap();
        let meta =
            read("started = 2024-05-01T12:00:00Z\n[calibration]\npressure_zero_sd_kpa = 0.1");
        assert_eq!(meta.started_unix_s(), Some(1_714_564_800.0));
        let calibration = meta.calibration.unwrap();
        assert_eq!(calibration.pressure_zero_sd_kpa, Some(0.1));
        assert_eq!(calibration.angle_zero_sd_deg, None);
        for no_date in [
            "started = \"yesterday\"",
            "started = 12:30:00",
            "started = 7",
        ] {
            assert_eq!(read(no_date).started_unix_s(), None, "{no_date}");
        }
    }
}
