//! The paper's exponents against the public tensile curves, and the pictures as
//! other programs read them.
//!
//! The curves are those of the Soft Robotics Materials Database (Marechal et
//! al., Soft Robotics 8(3), 2021), which is not part of this repository. The
//! tests that need them look in `shared/data/materials` beside the project, or
//! in the folder that `SOFTRIG_SHARED` names; without them they say so and pass.

use std::path::PathBuf;

use model_core::material::{Material, TABLE_I};
use softrig_materials::curve::{Measure, TensileCurve};
use softrig_materials::fit::{Choice, Modulus, Residual, fit};
use softrig_materials::table_row;
use softrig_report::plot::{Figure, Panel, Series, Style, to_svg_string};

/// The files of the ten materials, in the order of Table I.
const FILES: [&str; 10] = [
    "Dragon Skin FX Pro.csv",
    "Dragon Skin 10 MEDIUM.csv",
    "Dragon Skin 20.csv",
    "Dragon Skin 30.csv",
    "Ecoflex 00-10.csv",
    "Ecoflex 00-30.csv",
    "Ecoflex 00-50.csv",
    "Mold Star 16 FAST.csv",
    "Mold Star 20T.csv",
    "SortaClear 40.csv",
];

fn curves_folder() -> Option<PathBuf> {
    let shared = std::env::var_os("SOFTRIG_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")),
        PathBuf::from,
    );
    let folder = shared.join("data/materials/Tensile-Tests-Data");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no tensile curves in {}", folder.display());
    None
}

fn ten_curves() -> Option<Vec<TensileCurve>> {
    let folder = curves_folder()?;
    Some(
        FILES
            .iter()
            .map(|file| TensileCurve::read(&folder.join(file)).unwrap())
            .collect(),
    )
}

fn modulus(material: &Material) -> f64 {
    material.data_sheet::<f64>().modulus_mpa()
}

/// Root mean square distance of fitted exponents from Table I.
fn distance_from_table(curves: &[TensileCurve], choice: impl Fn(&Material) -> Choice) -> f64 {
    let squares: f64 = curves
        .iter()
        .zip(&TABLE_I)
        .map(|(curve, material)| {
            let fitted = fit(curve, &choice(material)).unwrap();
            (fitted.ludwick.exponent.value - material.exponent::<f64>()).powi(2)
        })
        .sum();
    (squares / 10.0).sqrt()
}

#[test]
fn every_file_of_the_database_is_read() {
    let Some(folder) = curves_folder() else {
        return;
    };
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let curve = TensileCurve::read(&entry.unwrap().path()).unwrap();
        files += 1;
        let samples = &curve.samples;
        assert!(samples.len() > 80, "{}", curve.material);
        assert!(
            samples.windows(2).all(|pair| {
                pair[0].strain(Measure::Engineering) <= pair[1].strain(Measure::Engineering)
            }),
            "{}",
            curve.material
        );
    }
    assert_eq!(files, 19);
}

#[test]
fn curves_find_their_row_of_the_table() {
    let Some(curves) = ten_curves() else { return };
    for (curve, material) in curves.iter().zip(&TABLE_I) {
        assert_eq!(table_row(curve), Some(material));
    }
}

#[test]
fn known_faults_of_the_files_are_noted_and_nothing_else() {
    let Some(curves) = ten_curves() else { return };
    for (curve, file) in curves.iter().zip(FILES) {
        let expected: &[&str] = match file {
            "Dragon Skin FX Pro.csv" => &["time runs backwards at line 427"],
            "Ecoflex 00-30.csv" => &["time runs backwards at line 426"],
            "Ecoflex 00-50.csv" => &[
                "time runs backwards at line 427",
                "true and engineering stress disagree on 1 of 721 lines, first on line 19",
            ],
            _ => &[],
        };
        assert_eq!(
            curve.notes.len(),
            expected.len(),
            "{file}: {:?}",
            curve.notes
        );
        for (note, start) in curve.notes.iter().zip(expected) {
            assert!(note.starts_with(start), "{file}: {note}");
        }
    }
}

#[test]
fn the_recipe_behind_table_i() {
    let Some(curves) = ten_curves() else { return };
    let expected = [
        1.451, 2.183, 2.300, 2.086, 1.559, 1.611, 1.819, 1.980, 2.217, 2.280,
    ];
    for ((curve, material), expected) in curves.iter().zip(&TABLE_I).zip(expected) {
        let fitted = fit(curve, &Choice::paper(modulus(material))).unwrap();
        let exponent = fitted.ludwick.exponent.value;
        assert!(
            (exponent - expected).abs() <= 5e-4,
            "{}: {exponent} for {expected}",
            material.name
        );
    }
    let distance = distance_from_table(&curves, |material| Choice::paper(modulus(material)));
    assert!((distance - 0.108).abs() < 5e-4, "{distance}");
}

#[test]
fn no_consistent_pair_gives_table_i() {
    let Some(curves) = ten_curves() else { return };
    let mut smallest = f64::INFINITY;
    for measure in [Measure::Engineering, Measure::True] {
        for residual in [Residual::Stress, Residual::Strain] {
            for largest in [6.0_f64, 25.0] {
                for held in [false, true] {
                    let range = match measure {
                        Measure::Engineering => largest,
                        Measure::True => largest.ln_1p(),
                    };
                    let distance = distance_from_table(&curves, |material| Choice {
                        stress: measure,
                        strain: measure,
                        range: Some((0.0, range)),
                        modulus: if held {
                            Modulus::Fixed(modulus(material))
                        } else {
                            Modulus::Free
                        },
                        residual,
                    });
                    println!("{measure} {residual:?} to {largest}, held {held}: {distance:.3}");
                    smallest = smallest.min(distance);
                }
            }
        }
    }
    // The recipe above, which mixes the measures, reaches 0.108.
    assert!((smallest - 0.833).abs() < 5e-4, "{smallest}");
}

#[test]
fn at_the_strains_of_an_actuator_the_ten_are_nearly_hookean() {
    let Some(curves) = ten_curves() else { return };
    for (curve, material) in curves.iter().zip(&TABLE_I) {
        let choice = Choice {
            range: Some((0.0, 0.5)),
            ..Choice::default()
        };
        let exponent = fit(curve, &choice).unwrap().ludwick.exponent.value;
        println!("{}: {exponent:.3}", material.name);
        assert!(
            (0.85..1.06).contains(&exponent),
            "{}: {exponent}",
            material.name
        );
    }
}

#[test]
fn ludwick_describes_whole_curves_better_than_hooke() {
    let Some(curves) = ten_curves() else { return };
    for curve in &curves {
        let fitted = fit(curve, &Choice::default()).unwrap();
        assert!(fitted.ludwick.r_squared > 0.998, "{}", curve.material);
        assert!(
            fitted.ludwick.rms < 0.5 * fitted.hooke.rms,
            "{}",
            curve.material
        );
    }
}

#[test]
fn pictures_are_well_formed_whatever_the_labels() {
    let x: Vec<f64> = (0..50).map(f64::from).collect();
    let label = "a < b & \"c\" > 'd' \u{7} é °";
    let figure = Figure::new(label).with_subtitle(label).with_panel(
        Panel::new(label, label)
            .with_title(label)
            .with_series(Series::new(label, &x, &x, Style::NOMINAL))
            .with_series(Series::new("dots", &x, &x, Style::MEASURED_POINTS))
            .with_series(Series::new("dashes", &x, &x, Style::REFERENCE)),
    );
    let svg = to_svg_string(&figure);
    let document = roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(document.root_element().tag_name().name(), "svg");
    let texts = document
        .descendants()
        .filter(|node| node.has_tag_name("text"))
        .filter(|node| {
            node.text()
                .is_some_and(|text| text.contains("a < b & \"c\" > 'd'"))
        })
        .count();
    // Title, subtitle, panel title, legend and the two axes.
    assert_eq!(texts, 6);
    let dashes = document
        .descendants()
        .filter(|node| node.attribute("stroke-dasharray").is_some())
        .count();
    // The curve and its sample in the legend.
    assert_eq!(dashes, 2);
}
