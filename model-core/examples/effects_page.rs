//! Writes the catalogue of effects as a page for users.
//!
//! `cargo run -p model-core --example effects_page` prints it;
//! `cargo run -p model-core --example effects_page -- docs/effects.md` writes
//! it. A test fails when the page in `docs/` is not what this writes.

use std::fmt::Write as _;

use model_core::catalogue::Kind;
use model_core::effects::{Parameter, Place};

const HEAD: &str = "\
# Catalogue of effects

<!-- Written by `cargo run -p model-core --example effects_page -- docs/effects.md`. -->

The base model is M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ + Q = F with F = g·p: θ is the bending angle (rad),
ω = θ̇ its rate (rad/s), p the gauge pressure in the line and p_c in the chamber, y what the angle
sensor shows; F and Q are generalised forces (N), M an effective inertia (kg·m). An effect is a
piece of physics that a real rig adds to it. In a model file it is an `[[effect]]` with its `kind`
and the keys below; a key with a value in the column *if left out* may be left out, and a first fit
holds it there, or fits it too where the column says *fitted*. A model has at most three effects.
A force that is not here can be written as [a formula](custom-effects.md).

What no recording of angle and pressure can show: a gain of the angle sensor (stiffness, damping and
input gain absorb it) and the scale of the inertia M (only ratios to it move anything).

";

/// The whole page.
fn page() -> String {
    let mut page = HEAD.to_owned();
    for (place, title) in PLACES {
        page += &format!("- {title}: ");
        let names: Vec<String> = of_place(place)
            .map(|kind| format!("[`{0}`](#{0})", kind.name()))
            .collect();
        page += &names.join(", ");
        page += "\n";
    }
    for (place, title) in PLACES {
        page += &format!("\n## {title}\n");
        for kind in of_place(place) {
            section(&mut page, kind);
        }
    }
    page
}

/// The keys of a table, which are lists.
const TABLE_KEYS: &str = "\
| `of` | | – | | | |
| `nodes` | | of the variable | −∞ | ∞ |  |
| `forces_n` | Q | N | −∞ | ∞ |  |

`of` is `\"angle\"` (θ, nodes in rad), `\"rate\"` (ω, rad/s), `\"pressure\"` (p_c, kPa), or `\"time\"`
(t since the start of the run, s). `nodes` are 2 to 16 numbers that increase, usually 6 to 16, and
`forces_n` is as long. A fit moves the forces that `[fit] free` names, all as `table.forces_n` or one
as `table.forces_n[0]`, and no node. Nodes are kept to the seven digits of single precision. A model
has at most one table, and no diagnosis names it as a cause.
";

const PLACES: [(Place, &str); 3] = [
    (Place::Input, "Between the pressure sensor and the chamber"),
    (Place::Force, "On the forces"),
    (Place::Sensor, "Between the angle and what the sensor shows"),
];

fn of_place(place: Place) -> impl Iterator<Item = Kind> {
    let kinds = Kind::ALL.iter().copied();
    kinds.filter(move |kind| kind.info().place == place)
}

fn section(page: &mut String, kind: Kind) {
    let info = kind.info();
    let mut title = info.title.to_owned();
    title[..1].make_ascii_uppercase();
    // Writing to a string does not fail.
    let _ = write!(
        page,
        "\n### `{}`\n\n**{title}**: {}\n\n{}\n\n- The gap lives in: {}.\n",
        info.name, info.equation, info.text, info.signature
    );
    if !info.look_alikes.is_empty() {
        let names: Vec<String> = info
            .look_alikes
            .iter()
            .map(|name| format!("[`{name}`](#{name})"))
            .collect();
        let _ = writeln!(page, "- Looks alike: {}.", names.join(", "));
    }
    *page +=
        "\n| key | symbol | unit | smallest | largest | if left out |\n|---|---|---|---|---|---|\n";
    if kind == Kind::Table {
        *page += TABLE_KEYS;
        return;
    }
    for row in kind.parameters() {
        let left_out = match (row.held, row.default) {
            (Some(held), _) => number(row, held),
            (None, Some(default)) => format!("{}, fitted", number(row, default)),
            (None, None) => String::new(),
        };
        let _ = writeln!(
            page,
            "| `{}` | {} | {} | {} | {} | {left_out} |",
            row.key,
            row.symbol,
            match row.unit.symbol() {
                "" => "–",
                symbol => symbol,
            },
            number(row, row.lower),
            number(row, row.upper),
        );
    }
}

/// A number of the table in the unit of files, to four digits.
fn number(row: &Parameter, value: f32) -> String {
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.to_owned();
    }
    let value = row.unit.from_si(f64::from(value));
    let digits = if value == 0.0 {
        0
    } else {
        // Few enough for any table.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let digits = (3.0 - value.abs().log10().floor()).max(0.0) as usize;
        digits
    };
    let text = format!("{value:.digits$}");
    let text = match text.split_once('.') {
        Some(_) => text.trim_end_matches('0').trim_end_matches('.'),
        None => &text,
    };
    text.replace('-', "−")
}

fn main() -> std::io::Result<()> {
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(path, page())?;
    } else {
        print!("{}", page());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn page_says_what_the_code_says() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/effects.md");
        let written = std::fs::read_to_string(path).unwrap_or_default();
        assert!(
            written == super::page(),
            "docs/effects.md is out of date: \
             cargo run -p model-core --example effects_page -- docs/effects.md"
        );
    }
}
