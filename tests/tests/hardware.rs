//! The rig that people build by the pages of `docs/hardware` is the one that the firmware drives.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    f64::consts::PI,
    fs,
    path::Path,
};

use firmware::design::{CPU_HZ, homing};
use firmware::stepper::HIGH_CYCLES;
use firmware::wiring::{FLEX_CHANNEL, PINS, PRESSURE_CHANNEL};
use wire::settings::{Key, Settings};

/// Atmospheric pressure (kPa).
const ATMOSPHERE_KPA: f64 = 101.325;

/// A file of `docs/hardware`.
fn page(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/hardware");
    fs::read_to_string(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The cells of the first table after a heading, without its head.
fn rows(page: &str, heading: &str) -> Vec<Vec<String>> {
    let section = page
        .split_once(&format!("{heading}\n"))
        .unwrap_or_else(|| panic!("there is no {heading}"))
        .1;
    section
        .lines()
        .skip_while(|line| !line.starts_with('|'))
        .take_while(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| {
            let cells = line.trim_matches('|').split('|');
            cells.map(|cell| cell.trim().to_owned()).collect()
        })
        .collect()
}

/// The rows of the wiring: name, Arduino pin, port.
fn table() -> Vec<[String; 3]> {
    rows(&page("wiring.md"), "## Wiring")
        .into_iter()
        .map(|cells| {
            let mut cells = cells.into_iter();
            [(); 3].map(|()| cells.next().unwrap_or_default())
        })
        .collect()
}

/// The pins that each net joins, by the net's name.
fn nets() -> BTreeMap<String, Vec<String>> {
    rows(&page("wiring.md"), "## Connections")
        .into_iter()
        .map(|cells| {
            let pins = cells[1].split_whitespace().map(str::to_owned);
            (cells[0].clone(), pins.collect())
        })
        .collect()
}

#[test]
fn every_joint_is_made_once_and_the_board_is_joined_as_the_firmware_drives_it() {
    let nets = nets();
    let mut seen = BTreeSet::new();
    for (net, pins) in &nets {
        assert!(pins.len() > 1, "{net} joins nothing");
        for pin in pins {
            assert!(seen.insert(pin.clone()), "{pin} is joined twice");
        }
    }
    let mut wired = vec![
        ("pressure sensor", format!("A1.A{PRESSURE_CHANNEL}")),
        ("flex sensor", format!("A1.A{FLEX_CHANNEL}")),
        ("+5 V", "A1.5V".to_owned()),
        ("ground", "A1.GND".to_owned()),
    ];
    let digital = PINS.iter().filter(|(name, _)| *name != "light");
    wired.extend(digital.map(|(name, pin)| (*name, format!("A1.{}", pin.arduino))));
    for (net, pin) in &wired {
        let joined = nets.get(*net).unwrap_or_else(|| panic!("no net {net}"));
        assert!(joined.contains(pin), "{net}: {pin}");
    }
    let of_the_board = seen.iter().filter(|pin| pin.starts_with("A1.")).count();
    assert_eq!(of_the_board, wired.len());
    // Without the firmware: the button and the over-pressure switch are in the motor's 12 V, and
    // a part has no pin that leads nowhere.
    for (one, other) in [
        ("12 V after the button", "S3.22"),
        ("12 V, switched", "S4.2"),
    ] {
        assert!(nets[one].contains(&other.to_owned()));
    }
    assert!(!nets["12 V"].iter().any(|pin| pin.starts_with("A2.")));
}

#[test]
fn what_is_joined_is_what_is_bought() {
    let bought: BTreeSet<String> = rows(&page("parts.md"), "## Bill of materials")
        .into_iter()
        .map(|cells| cells[0].clone())
        .filter(|reference| reference != "–")
        .collect();
    let joined: BTreeSet<String> = nets()
        .into_values()
        .flatten()
        .map(|pin| pin.split('.').next().unwrap_or_default().to_owned())
        .collect();
    assert_eq!(bought, joined);
    let price = |cells: &Vec<String>| cells[5].parse::<f64>().expect("a price");
    let sum: f64 = rows(&page("parts.md"), "## Bill of materials")
        .iter()
        .map(price)
        .sum();
    assert!(
        (sum - 400.0).abs() < 25.0,
        "the page says some 400: {sum:.0}"
    );
}

/// The parameters of a drawing: its lines `name = number;`.
fn parameters(drawing: &str) -> HashMap<String, f64> {
    page(drawing)
        .lines()
        .filter_map(|line| {
            let (name, rest) = line.split_once(" = ")?;
            let number = rest.split_once(';')?.0.parse().ok()?;
            Some((name.to_owned(), number))
        })
        .collect()
}

/// The dimensions of a picture: its groups of class `d`, by their id, each with the number that is
/// written and its length in pixels.
fn dimensions(picture: &str) -> Vec<(String, f64, f64)> {
    let text = page(picture);
    let document = roxmltree::Document::parse(&text).expect("the picture is SVG");
    let groups = document
        .descendants()
        .filter(|node| node.attribute("class") == Some("d"));
    groups
        .map(|group| {
            let find = |tag: &str| {
                let mut nodes = group.descendants();
                nodes
                    .find(|node| node.has_tag_name(tag))
                    .expect("a dimension")
            };
            let words = find("text").text().unwrap_or_default();
            let number = words
                .split_whitespace()
                .find_map(|word| word.parse().ok())
                .expect("a number");
            let path = find("path").attribute("d").unwrap_or_default();
            let numbers: Vec<f64> = path
                .split(|letter: char| !(letter.is_ascii_digit() || ".-".contains(letter)))
                .filter_map(|word| word.parse().ok())
                .take(3)
                .collect();
            let from = if path.contains('H') {
                numbers[0]
            } else {
                numbers[1]
            };
            let scale: f64 = group
                .ancestors()
                .find_map(|node| node.attribute("data-scale"))
                .expect("a scale")
                .parse()
                .expect("a number of pixels for a millimetre");
            let id = group.attribute("id").expect("the parameter's name");
            (id.to_owned(), number, (numbers[2] - from) / scale)
        })
        .collect()
}

/// Both drawings show the numbers of their sources, and are to scale.
#[test]
fn the_drawings_are_those_of_their_parameters() {
    for (picture, source, least) in [
        ("slide.svg", "slide.scad", 10),
        ("mould.svg", "mould.scad", 7),
    ] {
        let mut known = parameters(source);
        if source == "slide.scad" {
            let retracted = known["thrust_plate_at"]
                + known["plate"]
                + known["thrust_bearing"]
                + known["collar"]
                + known["hard_stop_behind"];
            known.insert("retracted_at".into(), retracted);
            let syringe =
                retracted + known["carriage_length"] + known["stroke"] + known["plunger_rest"];
            known.insert("syringe_plate_at".into(), syringe);
        } else {
            let chamber = known["chamber_air"] + 2.0 * known["wall"];
            known.insert("chamber".into(), chamber);
            let gap = (known["length"] - known["chambers"] * chamber) / (known["chambers"] - 1.0);
            known.insert("gap".into(), gap);
        }
        let drawn = dimensions(picture);
        assert!(drawn.len() >= least, "{picture}: {}", drawn.len());
        for (name, number, length) in drawn {
            let parameter = known[&name];
            assert!((number - parameter).abs() < 0.01, "{picture}: {name}");
            assert!(
                (length - parameter).abs() < 0.02,
                "{picture}: {name} is drawn {length} mm long"
            );
        }
    }
}

fn shipped(key: Key) -> f64 {
    f64::from(Settings::DEFAULT.number(key))
}

/// Asserts that the page says a number, as this row of one of its tables.
#[track_caller]
fn says(page: &str, row: &str) {
    assert!(page.contains(row), "the page does not say: {row}");
}

#[test]
fn the_slide_moves_as_the_firmware_counts() {
    let slide = parameters("slide.scad");
    let page = page("parts.md");
    let steps_per_mm = slide["steps_per_turn"] * slide["microsteps"] / slide["lead"];
    let area = PI / 4.0 * slide["bore"].powi(2);
    let ul_step = area / steps_per_mm;
    says(&page, &format!("| steps | {steps_per_mm} microsteps/mm |"));
    says(
        &page,
        &format!("| volume of a microstep | {ul_step:.3} µl |"),
    );
    says(&page, &format!("| bore area | {area:.0} mm² |"));
    assert!((ul_step / shipped(Key::VolumePerStep) - 1.0).abs() < 1e-3);

    let travel = slide["pushed_in_switch"];
    let travel_ul = area * travel;
    let search_ul = f64::from(homing::LONGEST_SEARCH) * shipped(Key::MaxVolume);
    says(
        &page,
        &format!(
            "| travel, switch to switch | {travel} mm, {:.1} ml | homing gives up after {:.1} ml |",
            travel_ul / 1e3,
            search_ul / 1e3
        ),
    );
    // From anywhere between the hard stops homing finds its switch.
    assert!(area * (slide["stroke"] + slide["hard_stop_behind"]) < search_ul);

    let most_ul = shipped(Key::MaxVolume);
    let most_mm = most_ul / area;
    says(
        &page,
        &format!("| 50 ml = {most_mm:.1} mm | `max.ul` = 50 000 |"),
    );
    assert!((most_ul - 50_000.0).abs() < f64::EPSILON);
    says(
        &page,
        &format!(
            "| left to the pushed-in switch | {:.1} mm |",
            travel - most_mm
        ),
    );
    let start_ul = f64::from(homing::START_UL.min(homing::START_SHARE * 50_000.0));
    says(
        &page,
        &format!(
            "| start of a run | {} ml = {:.2} mm |",
            start_ul / 1e3,
            start_ul / area
        ),
    );
    let flow = shipped(Key::MaxFlow);
    let speed = flow / area;
    says(
        &page,
        &format!(
            "| fastest flow | {} ml/s = {speed:.2} mm/s, {:.0} turns/min, {:.0} pulses/s | `max.flow` = 5 000 |",
            flow / 1e3,
            speed / slide["lead"] * 60.0,
            flow / shipped(Key::VolumePerStep)
        )
        .replace("14286", "14 286"),
    );
    let way = speed.powi(2) / (2.0 * shipped(Key::MaxFlowRate) / area);
    says(
        &page,
        &format!("| way to stop from that | {way:.2} mm | `max.acc` = 40 000 |"),
    );
    assert!(way < travel - most_mm, "it would run into the switch");
    says(
        &page,
        &format!("| {} mm | |\n| syringe", slide["hard_stop_behind"]),
    );
    says(
        &page,
        &format!("retracted | {:.1} ml | |", area * slide["stroke"] / 1e3),
    );
    let pulse_us = f64::from(HIGH_CYCLES) / f64::from(CPU_HZ) * 1e6;
    says(&page, &format!("pulses are {pulse_us:.0} µs long"));
}

#[test]
fn the_motor_current_follows_from_the_pressure_limit() {
    let slide = parameters("slide.scad");
    let page = page("parts.md");
    let area_m2 = PI / 4.0 * (slide["bore"] * 1e-3).powi(2);
    let limit = shipped(Key::MaxPressure);
    let pressures = [limit, 1.2 * limit];
    let forces = pressures.map(|kpa| kpa * 1e3 * area_m2 + 30.0);
    let torques = forces.map(|force| force * slide["lead"] * 1e-3 / (2.0 * PI * 0.30));
    let [a, b] = pressures;
    says(&page, &format!("| pressure | {a:.0} kPa | {b:.0} kPa |"));
    let [a, b] = forces;
    says(&page, &format!("friction | {a:.0} N | {b:.0} N |"));
    let [a, b] = torques;
    says(&page, &format!("0.30 | {a:.3} N·m | {b:.3} N·m |"));
    let available = 0.59 * 1.2 / 2.0;
    says(&page, &format!("Set **1.2 A**: {available:.3} N·m"));
    says(&page, &format!("{:.1} times what", available / torques[1]));
    let thrust = available * 2.0 * PI * 0.30 / (slide["lead"] * 1e-3) - 30.0;
    says(
        &page,
        &format!("push to {:.0}0 kPa", (thrust / area_m2 / 1e4).round()),
    );
}

/// How far the pump takes an actuator out of the mould, by Boyle's law.
#[test]
fn the_pump_reaches_what_the_page_says_with_the_actuator_of_the_mould() {
    let slide = parameters("slide.scad");
    let mould = parameters("mould.scad");
    let page = page("parts.md");
    let area = PI / 4.0 * slide["bore"].powi(2);
    let wide = mould["width"] - 2.0 * mould["wall"];
    let high = mould["height_above"] - mould["wall"];
    let chamber = mould["chamber_air"] + 2.0 * mould["wall"];
    let walls = mould["chambers"] - 1.0;
    let gap = (mould["length"] - mould["chambers"] * chamber) / walls;
    let channel = mould["channel_width"] * mould["channel_height"];
    let air = (mould["chambers"] * mould["chamber_air"] * wide * high
        + walls * (gap + 2.0 * mould["wall"]) * channel)
        / 1e3;
    let upper = (mould["chambers"] * chamber * mould["width"] * mould["height_above"]
        + walls * gap * mould["width"] * (mould["channel_height"] + mould["wall"]))
        / 1e3
        - air;
    let silicone = upper + mould["length"] * mould["width"] * mould["height_below"] / 1e3;
    says(
        &page,
        &format!("{air:.1} ml of air, {silicone:.1} ml of silicone"),
    );

    let start = f64::from(homing::START_UL) / 1e3;
    let retracted = area * slide["stroke"] / 1e3;
    let all = |inside: f64| retracted - start + inside + 3.5;
    let push = shipped(Key::MaxVolume) / 1e3 - start;
    says(&page, &format!("the air is {:.1} ml", all(air)));
    says(&page, &format!("a run has {push} ml"));
    for kpa in [40.0, 80.0, 120.0, 160.0] {
        let need = all(air) * (1.0 - ATMOSPHERE_KPA / (ATMOSPHERE_KPA + kpa));
        says(
            &page,
            &format!("| {kpa} kPa | {need:.1} ml | {:.1} ml |", push - need),
        );
    }
    // What may be asked for is within reach of a rigid actuator, and more air than the firmware
    // expects would hide a leak from its watch.
    let most = ATMOSPHERE_KPA * (all(air) / (all(air) - push) - 1.0);
    assert!(most > shipped(Key::SetpointMaxPressure), "{most} kPa");
    assert!(all(air) < 2.0 * shipped(Key::MaxVolume) / 1e3);
    let length = (mould["length"] - 12.0 * mould["wall"]) / 11.0;
    let box_air = 11.0 * length * wide * high / 1e3;
    let end = ATMOSPHERE_KPA * (all(box_air) / (all(box_air) - push) - 1.0);
    says(
        &page,
        &format!("hold {box_air:.0} ml and end at {end:.0} kPa"),
    );
}

/// The picture shows every pin, and what stops the rig without any firmware.
#[test]
fn the_picture_shows_the_pins_and_the_limits_that_need_no_firmware() {
    let text = page("wiring.svg");
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
