//! Counting, the gate and the pages of the blind benchmark, on made-up
//! verdicts.

use serde_json::json;
use softrig_tests::blind::cases::{Answer, Hidden, Plan, make};
use softrig_tests::blind::experiments::Set;
use softrig_tests::blind::gate::Gate;
use softrig_tests::blind::score::{Class, Errors, Figures, Said, Scored};
use softrig_tests::blind::tables;
use softrig_tests::blind::verdicts::Outcome;

fn said(verdict: serde_json::Value) -> Said {
    Said::of(&Outcome {
        verdict: Some(verdict),
        ..Outcome::default()
    })
}

fn named(kind: &str) -> Said {
    said(json!({ "verdict": "effect_found", "effects": [{ "kind": kind }], "alternatives": [] }))
}

fn word(verdict: &str) -> Said {
    said(json!({ "verdict": verdict, "effects": [], "alternatives": [] }))
}

/// A case that hides gravity, or nothing, with what was said.
fn scored(answer: &Answer, hidden: Hidden, class: Class, said: Said, ratio: f64) -> Scored {
    let mut answer = answer.clone();
    answer.hidden = hidden;
    answer.kinds = match hidden {
        Hidden::One => vec!["gravity".to_owned()],
        _ => Vec::new(),
    };
    let errors = |factor: f64| Errors {
        noisy: 0.01 * factor,
        clean: 0.001 * factor,
    };
    Scored {
        answer,
        class,
        said,
        tool: Some(errors(ratio)),
        oracle: Some(errors(1.0)),
        estimates: Vec::new(),
        seconds: 2.0,
    }
}

fn five() -> Vec<Scored> {
    let plan = Plan {
        set: Set::Rich,
        hidden: Hidden::Nothing,
        formulas: Vec::new(),
        replicate: 0,
    };
    let answer = make(&plan, "rich_000", 1).answer;
    let of = |hidden, class, said, ratio| scored(&answer, hidden, class, said, ratio);
    vec![
        of(Hidden::One, Class::One, named("gravity"), 1.0),
        of(Hidden::One, Class::One, named("exponent_shift"), 1.3),
        of(Hidden::One, Class::One, word("unexplained"), 1.1),
        of(
            Hidden::Nothing,
            Class::EffectFree,
            word("no_discrepancy"),
            1.0,
        ),
        of(Hidden::Outside, Class::Outside, named("gravity"), 1.0),
    ]
}

#[test]
fn figures_count_what_they_say() {
    let figures = Figures::of(Set::Rich, &five()).unwrap();
    let pair = |rate: softrig_tests::blind::score::Rate| (rate.hits, rate.of);
    assert_eq!(pair(figures.strict), (1, 3));
    assert_eq!(pair(figures.wrong), (1, 3));
    assert_eq!(pair(figures.in_set), (1, 3));
    assert_eq!(pair(figures.false_names), (0, 1));
    assert_eq!(pair(figures.outside), (1, 1));
    assert_eq!(pair(figures.pair), (0, 0));
    assert!((figures.held_out.unwrap() - 1.1).abs() < 1e-12);
    assert_eq!(Figures::of(Set::Paper, &five()), None);
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
    };
    assert_eq!(gate.check(&five()), Vec::<String>::new());
    let failing = |gate: Gate| gate.check(&five()).join("\n");
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
    ] {
        let found = failing(worse);
        assert!(
            found.contains(message) && found.lines().count() == 1,
            "{found}"
        );
    }
    let mut free = five();
    free[3].said = named("leak");
    assert!(gate.check(&free)[0].contains("names on data without an effect: 1 of 1"));
    assert_eq!(gate.check(&[]), ["no case was diagnosed"]);
    // The committed limits can be read.
    assert!(Gate::committed().unwrap().cases > 0);
}

#[test]
fn pages_and_pictures_show_every_answer() {
    let cases = five();
    let page = tables::markdown(&cases, "cargo xtask bench blind", "0000");
    assert!(
        page.contains("| one effect: named, strict |  | 33 % (6–79), 1 of 3 |"),
        "{page}"
    );
    assert!(page.contains("exponent_shift 1"));
    let lines = tables::csv(&cases);
    assert_eq!(lines.lines().count(), 6);
    let columns = |line: &str| line.split(',').count();
    let head = columns(lines.lines().next().unwrap());
    assert!(lines.lines().all(|line| columns(line) == head), "{lines}");
    let picture = tables::picture(Set::Rich, &cases);
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
