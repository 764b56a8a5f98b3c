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

/// The picture shows every pin, and what stops the rig without any firmware.
#[test]
fn the_picture_shows_the_pins_and_the_limits_that_need_no_firmware() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hardware/wiring.svg");
    let text = fs::read_to_string(path).expect("the wiring is drawn");
    let picture = roxmltree::Document::parse(&text).expect("the picture is SVG");
    let words: Vec<&str> = picture
        .descendants()
        .filter(|node| node.has_tag_name("text"))
        .filter_map(|node| node.text())
        .collect();
    // The light is on the board.
    for (name, pin) in PINS.iter().filter(|(name, _)| *name != "light") {
        let number = pin.arduino.to_string();
        let shows = |label: &&str| label.split_whitespace().next() == Some(&number);
        assert!(words.iter().any(shows), "{name}: pin {number}");
    }
    for channel in [PRESSURE_CHANNEL, FLEX_CHANNEL] {
        assert!(words.contains(&format!("A{channel}").as_str()));
    }
    let count = |word: &str| words.iter().filter(|it| **it == word).count();
    assert_eq!(count("relief valve"), 1);
    assert_eq!(count("over-pressure switch"), 1);
    // In the 12 V.
    assert_eq!((count("stop"), count("p max")), (1, 1));
    // ENABLE's pull-up, and a filter at each switch.
    assert_eq!((count("10 kΩ"), count("1 kΩ"), count("10 nF")), (1, 3, 3));
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
