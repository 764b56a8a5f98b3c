//! Materials in pictures: the predictor beside the table (the paper's Fig. 3), a tensile curve
//! with its laws and their misfits, and several curves (its Figs. 1 and 2).

use model_core::material::{Material, TABLE_I};

use softrig_formats::numbers::short;
use softrig_materials::curve::TensileCurve;
use softrig_materials::fit::{Choice, CurveFit, LawFit, Residual, selected};
use softrig_materials::predictor::{LeaveOneOut, PredictorFit};
use softrig_materials::table_row;

use softrig_report::plot::{Figure, Mark, Panel, Role, Series, Style};

/// Samples of a tensile curve that are drawn: dots that can be told apart.
const DOTS: usize = 60;

/// The exponent against each figure of the data sheet, and the predicted against the
/// tabulated one.
pub fn predictor_figure(fit: &PredictorFit, unseen: &LeaveOneOut) -> Figure {
    /// A figure of a data sheet, with its unit.
    type Property = (&'static str, fn(&Material) -> f64);
    const PROPERTIES: [Property; 3] = [
        ("modulus E (MPa)", |it| it.data_sheet().modulus_mpa()),
        ("mixed viscosity (1000 cps)", |it| {
            it.data_sheet::<f64>().mixed_viscosity_cps() / 1000.0
        }),
        ("tensile strength (MPa)", |it| {
            it.data_sheet().tensile_strength_mpa()
        }),
    ];
    let predicted = |material: &Material| fit.predict(&material.data_sheet()).exponent;
    let [x1, x2, x3] = fit.coefficients.map(short);
    let numbered: Vec<String> = (1..)
        .zip(&TABLE_I)
        .map(|(number, material)| format!("{number}\u{a0}{}", material.name))
        .collect();
    let mut figure = Figure::new("Ludwick's exponent and the data sheet")
        .with_subtitle(format!(
            "n = {x1} E/MPa + {x2} √(MV/50000 cps) + {x3} √(TS/10 MPa), fitted to the eight blue \
             rows of Table I. It misses a material that it has not seen by {} (RMS), the mean of \
             the others by {}. {}. The two held out stand at the exponents of Table II, where \
             Dragon Skin 20 has 2.174; in Table I it has 2.500.",
            short(unseen.predictor_rms),
            short(unseen.mean_rms),
            numbered.join(", ")
        ))
        .with_separate_x()
        .with_columns(2);
    for (label, property) in PROPERTIES {
        let panel = with_materials(Panel::new(label, "exponent n (–)"), property, tabulated);
        let (x, y): (Vec<f64>, Vec<f64>) = TABLE_I
            .iter()
            .map(|material| (property(material), predicted(material)))
            .unzip();
        let rings = Style::new(Role::Before, Mark::Rings);
        figure = figure.with_panel(panel.with_series(Series::new("predicted", &x, &y, rings)));
    }
    let ends = [1.2, 2.8];
    let equality = Series::new("equal", &ends, &ends, Style::REFERENCE);
    let panel = Panel::new("exponent n of the table (–)", "predicted n (–)").with_series(equality);
    figure.with_panel(with_materials(panel, tabulated, predicted))
}

/// The exponent of a material, of the two held out that of Table II.
fn tabulated(material: &Material) -> f64 {
    match material.held_out {
        Some(held_out) => held_out.exponent(),
        None => material.exponent(),
    }
}

/// A panel with the materials, by their numbers in the table.
fn with_materials(
    mut panel: Panel,
    x: impl Fn(&Material) -> f64,
    y: impl Fn(&Material) -> f64,
) -> Panel {
    let blue = Style::new(Role::Nominal, Mark::Discs);
    let green = Style::new(Role::After, Mark::Discs);
    for (label, held_out, style) in [("fitted", false, blue), ("held out", true, green)] {
        let (x, y): (Vec<f64>, Vec<f64>) = TABLE_I
            .iter()
            .filter(|material| material.held_out.is_some() == held_out)
            .map(|material| (x(material), y(material)))
            .unzip();
        panel = panel.with_series(Series::new(label, &x, &y, style));
    }
    for (number, material) in (1..).zip(&TABLE_I) {
        panel = panel.with_note(x(material), y(material), number.to_string());
    }
    panel
}

/// The stress of each curve against its strain, with the law that was fitted; `choice` says
/// how, in a sentence.
pub fn curves_figure(curves: &[(TensileCurve, CurveFit)], choice: &str) -> Figure {
    let mut panel = Panel::new("strain (–)", "stress (MPa)").with_weight(2.0);
    if let Some((_, fit)) = curves.first() {
        panel.x_label = format!("{} strain (–)", fit.choice.strain);
        panel.y_label = format!("{} stress (MPa)", fit.choice.stress);
    }
    for (index, (curve, fit)) in curves.iter().enumerate() {
        let (strains, stresses) = selected(curve, &fit.choice);
        let step = strains.len().div_ceil(DOTS).max(1);
        let every = |all: &[f64]| -> Vec<f64> { all.iter().copied().step_by(step).collect() };
        let dots = Style::new(Role::of_many(index), Mark::Points);
        panel = panel.with_series(Series::new("", &every(&strains), &every(&stresses), dots));
    }
    for (index, (curve, fit)) in curves.iter().enumerate() {
        let (low, high) = (fit.strains.0.min(0.0), fit.strains.1);
        let grid: Vec<f64> = (0..=300)
            .map(|i| low + (high - low) * f64::from(i) / 300.0)
            .collect();
        let law = &fit.ludwick;
        let stress: Vec<f64> = grid.iter().map(|strain| law.stress_mpa(*strain)).collect();
        let label = format!(
            "{}: n = {}, E = {} MPa",
            name(curve),
            short(law.exponent.value),
            short(law.modulus_mpa.value)
        );
        let style = Style::new(Role::of_many(index), Mark::Line);
        let role_is_used = index >= Role::MANY;
        let style = if role_is_used { style.dashed() } else { style };
        panel = panel.with_series(Series::new(label, &grid, &stress, style));
    }
    Figure::new("Tensile curves and Ludwick's law")
        .with_subtitle(format!("Dots: measured; lines: σ = E εⁿ. {choice}."))
        .with_panel(panel)
}

/// What a material is called: as in Table I, if it is there.
pub fn name(curve: &TensileCurve) -> &str {
    table_row(curve).map_or(&curve.material, |row| row.name)
}

const HOOKE: Style = Style::new(Role::Before, Mark::Line);
const LUDWICK: Style = Style::AFTER;

/// Curve and laws above, misfits below; `sentence` says what was fitted.
pub fn curve_figure(curve: &TensileCurve, fit: &CurveFit, sentence: &str) -> Figure {
    Figure::new(format!("{}: Ludwick's law and Hooke's", curve.material))
        .with_subtitle(format!(
            "{sentence}. RMS misfit {:.4} against {:.4} {}.",
            fit.ludwick.rms,
            fit.hooke.rms,
            match fit.choice.residual {
                Residual::Stress => "MPa",
                Residual::Strain => "of strain",
            }
        ))
        .with_panel(curve_panel(curve, fit))
        .with_panel(misfit_panel(curve, fit))
}

fn strain_label(fit: &CurveFit) -> String {
    format!("{} strain (–)", fit.choice.strain)
}

fn curve_panel(curve: &TensileCurve, fit: &CurveFit) -> Panel {
    let choice = &fit.choice;
    let (strains, stresses) = selected(curve, choice);
    let whole = Choice {
        range: None,
        ..*choice
    };
    let (all_strains, all_stresses) = selected(curve, &whole);
    let from = fit.strains.0.min(0.0);
    let grid: Vec<f64> = (0..=300)
        .map(|i| from + (fit.strains.1 - from) * f64::from(i) / 300.0)
        .collect();
    let drawn = |law: &LawFit| -> Vec<f64> { grid.iter().map(|e| law.stress_mpa(*e)).collect() };
    let ludwick = drawn(&fit.ludwick);
    // Points that were not fitted give context, but must not shrink the fitted range.
    let right = match choice.range {
        Some(_) => curve
            .largest_strain(choice.strain)
            .min(1.25 * fit.strains.1),
        None => fit.strains.1,
    };
    // Hooke's line may leave the picture under a held modulus, for the same
    // reason.
    let shown = all_strains
        .iter()
        .zip(&all_stresses)
        .filter(|(strain, _)| **strain <= right)
        .map(|(_, stress)| stress);
    let (bottom, top) = shown
        .chain(&ludwick)
        .fold((0.0_f64, 0.0_f64), |(bottom, top), stress| {
            (bottom.min(*stress), top.max(*stress))
        });
    let margin = 0.04 * (top - bottom);
    let mut panel = Panel::new(strain_label(fit), format!("{} stress (MPa)", choice.stress));
    if all_strains.len() > strains.len() {
        let style = Style::new(Role::Measured, Mark::Thin);
        panel = panel.with_series(Series::new(
            "not fitted",
            &all_strains,
            &all_stresses,
            style,
        ));
    }
    let ludwick_label = format!(
        "Ludwick: n = {:.3}, E = {:.3} MPa",
        fit.ludwick.exponent.value, fit.ludwick.modulus_mpa.value
    );
    let hooke_label = format!("Hooke: E = {:.3} MPa", fit.hooke.modulus_mpa.value);
    panel
        .with_series(Series::new(
            "measured",
            &strains,
            &stresses,
            Style::MEASURED_POINTS,
        ))
        .with_series(Series::new(hooke_label, &grid, &drawn(&fit.hooke), HOOKE))
        .with_series(Series::new(ludwick_label, &grid, &ludwick, LUDWICK))
        .with_x_range(from - 0.02 * (right - from), right)
        .with_y_range(bottom - margin, top + margin)
        .with_weight(1.5)
}

fn misfit_panel(curve: &TensileCurve, fit: &CurveFit) -> Panel {
    let direction = fit.choice.residual;
    let (strains, stresses) = selected(curve, &fit.choice);
    let misfits = |law: &LawFit| -> Vec<f64> {
        strains
            .iter()
            .zip(&stresses)
            .map(|(strain, stress)| law.residual(direction, *strain, *stress))
            .collect()
    };
    let (of_hooke, of_ludwick) = (misfits(&fit.hooke), misfits(&fit.ludwick));
    let largest = |misfits: &[f64]| misfits.iter().fold(0.0_f64, |top, r| top.max(r.abs()));
    let reach = 1.08 * largest(&of_hooke).min(5.0 * largest(&of_ludwick));
    let label = match direction {
        Residual::Stress => "misfit (MPa)",
        Residual::Strain => "misfit (strain)",
    };
    // An exact fit leaves no range to draw, which the panel then chooses itself.
    Panel::new(strain_label(fit), label)
        .with_series(Series::new("", &strains, &of_hooke, HOOKE))
        .with_series(Series::new("", &strains, &of_ludwick, LUDWICK))
        .with_level(0.0)
        .with_y_range(-reach, reach)
        .with_weight(0.7)
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_materials::predictor::{eight_rows, leave_one_out};

    #[test]
    fn every_material_stands_in_every_panel() {
        let fit = PredictorFit::new(&eight_rows()).unwrap();
        let figure = predictor_figure(&fit, &leave_one_out(&TABLE_I).unwrap());
        assert_eq!(figure.panels.len(), 4);
        for panel in &figure.panels {
            assert_eq!(panel.notes.len(), TABLE_I.len());
            let of = |label: &str| {
                let mut all = panel.series.iter();
                all.find(|series| series.label == label)
                    .map_or(0, |series| series.x.len())
            };
            assert_eq!((of("fitted"), of("held out")), (8, 2));
        }
        // On the line of equality a prediction would be right; none of eight is by chance.
        let last = &figure.panels[3];
        let fitted = &last.series[1];
        let misfit: f64 = fitted.x.iter().zip(&fitted.y).map(|(x, y)| y - x).sum();
        assert!(misfit.abs() < 1.0 && fitted.x != fitted.y, "{misfit}");
    }
}
