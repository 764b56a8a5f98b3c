//! The wiring that people solder is the wiring that the firmware drives.

use std::{fs, path::Path};

use firmware::wiring::{FLEX_CHANNEL, PINS, PRESSURE_CHANNEL};

/// The rows of the first table after the heading `## Wiring`: name, Arduino pin,
/// port.
fn table() -> Vec<[String; 3]> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hardware/wiring.md");
    let text = fs::read_to_string(&path).expect("the wiring is documented");
    let section = text
        .split_once("## Wiring")
        .expect("the wiring has a section")
        .1;
    section
        .lines()
        .skip_while(|line| !line.starts_with('|'))
        .take_while(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| {
            let mut cells = line.split('|').skip(1).map(|cell| cell.trim().to_owned());
            [(); 3].map(|()| cells.next().unwrap_or_default())
        })
        .collect()
}

#[test]
fn the_documented_wiring_is_that_of_the_firmware() {
    let analog = |name: &str, channel| {
        [
            name.to_owned(),
            format!("A{channel}"),
            format!("PF{channel}"),
        ]
    };
    let mut wired = vec![
        analog("pressure sensor", PRESSURE_CHANNEL),
        analog("flex sensor", FLEX_CHANNEL),
    ];
    wired.extend(PINS.iter().map(|(name, pin)| {
        [
            (*name).to_owned(),
            pin.arduino.to_string(),
            format!("P{}{}", char::from(pin.port), pin.bit),
        ]
    }));
    assert_eq!(table(), wired);
}
