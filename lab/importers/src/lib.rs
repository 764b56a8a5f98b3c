//! Recordings in binary formats, as laboratories have them beside text.
//!
//! A reader a format makes columns of a file; what becomes of them is `softrig_formats`' business.
//! [`install`] makes them known to the readers there, so that nothing else of softrig knows that
//! this crate exists. It is a crate of its own for its libraries: they take longer to build than
//! the rest of softrig.
#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]
// What only the formats need that the page is built without.
#![cfg_attr(
    not(feature = "native"),
    allow(dead_code, unused_imports, unused_variables)
)]

#[cfg(feature = "native")]
mod bag;
#[cfg(feature = "native")]
mod excel;
mod guard;
mod hdf5;
mod mat;
#[cfg(feature = "native")]
pub mod mcap;
mod numpy;
mod parquet;
#[cfg(feature = "native")]
mod ros;
#[cfg(feature = "native")]
mod rosbag;
mod tdms;
#[cfg(feature = "native")]
mod topics;

use std::path::Path;

use bytes::Bytes;
use softrig_formats::bounded::Limits;
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::formats::binary::{self, Binary, Importers, Source};
use softrig_formats::formats::{Samples, Sheet, read_whole};
use softrig_formats::recording::Meta;

/// Makes the formats known to every reader of this program.
pub fn install() {
    binary::install(&All);
}

/// All formats that this crate was built with.
struct All;

impl Importers for All {
    fn read(
        &self,
        format: Binary,
        source: Source<'_>,
        path: &Path,
        layout: &Layout,
        limits: Limits,
    ) -> Result<Samples, InputError> {
        match (format, source) {
            (Binary::Hdf5, source) => hdf5::read(source, path, layout, limits),
            (Binary::Matlab, source) => mat::read(source, path, layout, limits),
            (Binary::NumpyArray, source) => numpy::read_npy(source, path, layout, limits),
            (Binary::Packed, source) => numpy::read_npz(source, path, layout, limits),
            (Binary::Tdms, source) => tdms::read(source, path, layout, limits),
            (Binary::Parquet, Source::File(file)) => parquet::read(file, path, layout, limits),
            (Binary::Parquet, source) => {
                let bytes = Bytes::from(read_whole(source, path, limits)?);
                parquet::read(bytes, path, layout, limits)
            }
            #[cfg(feature = "native")]
            (Binary::Mcap, source) => mcap::read(source, path, layout, limits),
            #[cfg(feature = "native")]
            (Binary::Sqlite, Source::File(_)) => rosbag::read_file(path, layout, limits),
            #[cfg(feature = "native")]
            (Binary::Sqlite, source) => rosbag::read(source, path, layout, limits),
            #[cfg(not(feature = "native"))]
            (format, _) => Err(format.left_out().in_file(path)),
        }
    }

    fn read_folder(&self, folder: &Path, layout: &Layout) -> Result<Samples, InputError> {
        #[cfg(feature = "native")]
        return bag::read_folder(folder, layout);
        #[cfg(not(feature = "native"))]
        Err(Binary::Mcap.left_out().in_file(folder))
    }

    fn write(&self, format: Binary, sheet: &Sheet, about: &Meta) -> anyhow::Result<Vec<u8>> {
        match format {
            Binary::Parquet => parquet::write(sheet),
            #[cfg(feature = "native")]
            Binary::Mcap => mcap::write(sheet, about),
            format => Err(format.left_out().into()),
        }
    }
}

/// Reads bytes as a recording, for tests of the formats.
/// A half float, its lowest byte first.
pub(crate) fn half(bytes: &[u8]) -> f64 {
    let [low, high] = *bytes else {
        return f64::NAN;
    };
    let bits = u16::from_le_bytes([low, high]);
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    sign * match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        exponent => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}

#[cfg(test)]
fn read_bytes(bytes: &[u8], path: &Path, layout: &Layout) -> Result<Samples, InputError> {
    install();
    softrig_formats::formats::read_bytes(bytes, path, layout)
}

#[cfg(all(test, feature = "native"))]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use softrig_formats::formats::write::{Format, bytes};

    /// A recording of `softrig record`, with what is not known left empty.
    const RECORDED: &str = "\
time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq
0.000,-0.05,59.81,60.00,,-12,,idle,0,007
0.010,10.10,59.90,60.00,,0,59.81,running,0,008
0.030,1234.56,-0.00,,40.50,12000,1.00,\"a, b\",0,009
";

    const META: &str = "protocol = \"paper\"\nstarted = \"2024-05-01T12:00:00Z\"\nsamples = 3\n";

    fn read(bytes: &[u8], name: &str) -> Result<Samples, InputError> {
        read_bytes(bytes, Path::new(name), &Layout::default())
    }

    fn written(format: Format) -> Vec<u8> {
        let samples = read(RECORDED.as_bytes(), "run.csv").unwrap();
        bytes(samples, Some(META.into()), format).unwrap()
    }

    #[test]
    fn there_and_back_every_digit_is_where_it_was() {
        for format in [Format::Parquet, Format::Mcap] {
            let samples = read(&written(format), "run").unwrap();
            assert_eq!(samples.meta.as_deref(), Some(META), "{format:?}");
            let again = bytes(samples, None, Format::Csv).unwrap();
            assert_eq!(String::from_utf8(again).unwrap(), RECORDED, "{format:?}");
        }
    }

    proptest! {
        /// A damaged file is an error with its name, or still a recording.
        #[test]
        fn damage_is_an_error(
            format in prop::sample::select(vec![Format::Parquet, Format::Mcap]),
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            end in any::<prop::sample::Index>(),
            cut in any::<bool>(),
        ) {
            let mut bytes = written(format);
            for (place, byte) in edits {
                let place = place.index(bytes.len());
                bytes[place] = byte;
            }
            if cut {
                bytes.truncate(end.index(bytes.len()));
            }
            match read(&bytes, "run") {
                Ok(samples) => prop_assert!(samples.len() >= 2),
                Err(error) => prop_assert_eq!(error.file.as_deref(), Some(Path::new("run"))),
            }
        }

        #[test]
        fn any_numbers_come_back_as_they_were(
            rows in prop::collection::vec((any::<i32>(), any::<i32>()), 2..20),
            decimals in 0..9i32,
            format in prop::sample::select(vec![Format::Parquet, Format::Mcap]),
        ) {
            let mut text = String::from("time_s,pressure_kpa,angle_deg\n");
            let digits = usize::try_from(decimals).unwrap();
            for (row, (pressure, angle)) in rows.iter().enumerate() {
                let [pressure, angle] = [pressure, angle]
                    .map(|whole| f64::from(*whole) / 10f64.powi(decimals));
                text += &format!("{:.3},{pressure:.digits$},{angle:.digits$}\n", row as f64 * 0.001);
            }
            let samples = read(text.as_bytes(), "a.csv").unwrap();
            let there = bytes(samples, None, format).unwrap();
            let back = bytes(read(&there, "a").unwrap(), None, Format::Csv).unwrap();
            prop_assert_eq!(String::from_utf8(back).unwrap(), text);
        }
    }
}

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
