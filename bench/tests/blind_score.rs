//! Counting, the gate and the pages of the blind benchmark, on made-up
//! verdicts.

use serde_json::Value;
use serde_json::json;
use softrig_bench::blind::answer::{Answer, Collection};
use softrig_bench::blind::cases::{self, Plan, make};
use softrig_bench::blind::counts::{Group, Rate};
use softrig_bench::blind::experiments::Set;
use softrig_bench::blind::gate::{Gate, Laws};
use softrig_bench::blind::grade::{Grade, Strength};
use softrig_bench::blind::hidden::Hidden;
use softrig_bench::blind::laws::{self, Class};
use softrig_bench::blind::score::{Errors, Scored};
use softrig_bench::blind::tables;
use softrig_bench::blind::verdicts::Outcome;
use softrig_bench::{pages, pictures};

fn named(kind: &str) -> Value {
    json!({ "verdict": "effect_found", "effects": [{ "kind": kind }], "alternatives": [] })
}

fn word(verdict: &str) -> Value {
    json!({ "verdict": verdict, "effects": [], "alternatives": [] })
}

/// A case that hides gravity, or nothing, with what was said.
fn scored(answer: &cases::Answer, hidden: Hidden, verdict: Value, ratio: f64) -> Scored {
    let mut answer = answer.clone();
    answer.secret.hidden = hidden;
    answer.secret.kinds = match hidden {
        Hidden::One => vec!["gravity".to_owned()],
        _ => Vec::new(),
    };
    let errors = |factor: f64| Errors {
        noisy: 0.01 * factor,
        clean: 0.001 * factor,
    };
    let outcome = Outcome {
        verdict: Some(verdict),
        seconds: 2.0,
        ..Outcome::default()
    };
    Scored {
        tool: Some(errors(ratio)),
        oracle: Some(errors(1.0)),
        ..Scored::of(&Answer::Runs(answer), &outcome)
    }
}

fn answer() -> cases::Answer {
    let plan = Plan {
        set: Set::Rich,
        hidden: Hidden::Nothing,
        laws: Vec::new(),
        replicate: 0,
    };
    make(&plan, "rich_000", 1).answer
}

fn five() -> Vec<Scored> {
    let answer = answer();
    let of = |hidden, verdict, ratio| scored(&answer, hidden, verdict, ratio);
    vec![
        of(Hidden::One, named("gravity"), 1.0),
        of(Hidden::One, named("exponent_shift"), 1.3),
        of(Hidden::One, word("unexplained"), 1.1),
        of(Hidden::Nothing, word("no_discrepancy"), 1.0),
        of(Hidden::Outside, named("gravity"), 1.0),
    ]
}

/// Those five, a law that is named, one for which another formula is, and an actuator without one.
fn eight() -> Vec<Scored> {
    let folder = tempfile::tempdir().unwrap();
    let answer = laws::write(8, folder.path()).unwrap();
    let of = |class, hidden, verdict: Value, grade| {
        let mut answer = answer.clone();
        (answer.class, answer.secret.hidden) = (class, hidden);
        let outcome = Outcome {
            verdict: Some(verdict),
            ..Outcome::default()
        };
        Scored {
            grade,
            ..Scored::of(&Answer::Law(answer), &outcome)
        }
    };
    let term = |kind: &str| {
        json!({ "verdict": "effect_found", "effects": [{ "kind": kind, "formula": "p^2" }],
                "rmse_deg": { "refit": 2.92, "repaired": 0.213 } })
    };
    let wrong = Grade::Wrong(Strength::Full);
    let mut cases = five();
    cases.extend([
        of(Class::Within, Hidden::Outside, term("term_a"), Grade::Exact),
        of(Class::Beyond, Hidden::Outside, term("term_b"), wrong),
        of(
            Class::Nothing,
            Hidden::Parameters,
            word("parameters_only"),
            Grade::Denied,
        ),
    ]);
    cases
}

#[test]
fn figures_count_what_they_say() {
    let five = five();
    let cases = Group::of(Collection::Runs(Set::Rich), &five);
    let pair = |rate: Rate| (rate.hits, rate.of);
    let one = cases.hiding(&[Hidden::One]);
    assert_eq!(pair(one.rate(Scored::is_exact)), (1, 3));
    assert_eq!(pair(one.rate(Scored::names_else)), (1, 3));
    assert_eq!(pair(one.rate(Scored::holds)), (1, 3));
    assert!((one.median(Scored::over_oracle).unwrap() - 1.1).abs() < 1e-12);
    let quiet = cases.quiet();
    assert_eq!(pair(quiet.rate(Scored::names)), (0, 1));
    let outside = cases.hiding(&[Hidden::Outside]);
    let is_wrong = |case: &Scored| case.is_wrong(Strength::Full);
    assert_eq!(pair(outside.rate(is_wrong)), (1, 1));
    assert!(cases.hiding(&[Hidden::Two]).is_empty());
    assert!(Group::of(Collection::Runs(Set::Paper), &five).is_empty());
}

#[test]
fn the_gate_names_what_got_worse() {
    let gate = Gate {
        cases: 5,
        seed: 1,
        named_at_least: 1,
        in_answer_set_at_least: 1,
        wrong_at_most: 1,
        false_names_at_most: 0,
        outside_names_at_most: 1,
        held_out_at_most: 1.2,
        laws: Laws {
            cases: 3,
            seed: 1,
            named_at_least: 1,
            wrong_formulas_at_most: 1,
            false_names_at_most: 0,
        },
    };
    let cases = eight();
    assert_eq!(gate.check(&cases), Vec::<String>::new());
    let failing = |gate: Gate| gate.check(&cases).join("\n");
    for (worse, message) in [
        (
            Gate {
                named_at_least: 2,
                ..gate.clone()
            },
            "single effects named: 1 of 3",
        ),
        (
            Gate {
                wrong_at_most: 0,
                ..gate.clone()
            },
            "wrong names for a single effect: 1 of 3",
        ),
        (
            Gate {
                outside_names_at_most: 0,
                ..gate.clone()
            },
            "outside the catalogue: 1 of 1",
        ),
        (
            Gate {
                held_out_at_most: 1.05,
                ..gate.clone()
            },
            "held-out error over the oracle's: 1.100",
        ),
        (
            Gate {
                laws: Laws {
                    named_at_least: 2,
                    ..gate.laws
                },
                ..gate.clone()
            },
            "laws of the grammar named: 1 of 1",
        ),
        (
            Gate {
                laws: Laws {
                    wrong_formulas_at_most: 0,
                    ..gate.laws
                },
                ..gate.clone()
            },
            "formulas that are not the law: 1 of 3",
        ),
    ] {
        let found = failing(worse);
        assert!(
            found.contains(message) && found.lines().count() == 1,
            "{found}"
        );
    }
    let mut free = eight();
    free[3] = scored(&answer(), Hidden::Nothing, named("leak"), 1.0);
    assert!(gate.check(&free)[0].contains("names on data without an effect: 1 of 1"));
    for some in [&cases[..5], &cases[5..]] {
        assert_eq!(gate.check(some), ["no case was diagnosed"]);
    }
    // The committed limits can be read.
    assert!(Gate::committed().unwrap().cases > 0);
}

#[test]
fn pages_and_pictures_show_every_answer() {
    let cases = eight();
    let mut figures = tables::figures(&cases);
    figures["command"] = "cargo xtask bench blind".into();
    figures["tool"] = "0000".into();
    let page = pages::render(&figures).unwrap();
    assert!(
        page.contains("| one effect: named, strict |  | 33 % (6–79), 1 of 3 |"),
        "{page}"
    );
    assert!(page.contains("exponent_shift 1"));
    assert!(
        page.contains("| a law that the grammar has: it is named, or one that pushes alike | ≥ 75 % | 100 % (21–100), 1 of 1 |"),
        "{page}"
    );
    assert!(page.contains("| laws_008 | `p^2` | term_a | 2.92 | 0.213 | 0.2"));
    assert_eq!(figures["cases"].as_array().unwrap().len(), cases.len());
    let (name, picture) = pictures::of(&figures).unwrap().remove(0);
    assert_eq!(name, "blind_rich.svg");
    let svg = roxmltree::Document::parse(&picture).unwrap();
    // Right once, wrong once in green and vermilion; abstentions in blue.
    let filled = |colour: &str| {
        svg.descendants()
            .filter(|node| {
                node.attribute("fill") == Some(colour)
                    && node.attribute("fill-opacity") != Some("0.000")
            })
            .count()
    };
    assert_eq!(filled("#009E73"), 1);
    assert_eq!(filled("#D55E00"), 2);
    assert_eq!(filled("#0072B2"), 2);
}
