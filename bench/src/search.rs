//! Does the search of a diagnosis find the fit that there is?
//!
//! An answer is wrong because the decision is, or because the fit of the right structure ended beside its optimum. This
//! looks at the fit alone: one of the true structure that starts at the true parameters says what can be left, and what
//! the search left of the same structure is held against it. Hidden are effects by the catalogue's own formulas; of
//! another formula no structure would be the true one.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::Args;
use model_core::actuator::Model;
use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use serde::Serialize;
use serde_json::{Value, json};
use softrig::diagnose::fit::candidates::{applicable, free_parameters};
use softrig::diagnose::score::Guesses;
use softrig::diagnose::score::scales::Scales;
use softrig::diagnose::search::selection::FittedStructure;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::estimate::fit::Effort;
use softrig::estimate::fitter::Fitter;
use softrig::sim::work::Work;
use softrig::statistics::median;
use softrig::synth::example::{self, Hidden, NOISE_DEG};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::read_all;

use crate::blind::answer::{Answer, Collection, Plans};
use crate::blind::counts::Rate;
use crate::blind::draw::draw;
use crate::blind::world::World;
use crate::invariance::cases::Case;
use crate::processor::{Of, seconds};
use crate::rig_loop::bench::Seeds;

/// The squared error that counts as the same fit, over that of the fit from the truth.
const SAME: f64 = 1.02;
/// An effect is large where the refit without it leaves so many times what the truth leaves.
const LARGE: f64 = 2.5;
/// How many effects by the score are counted.
const FIRST: [usize; 3] = [1, 4, 8];
/// How many of the worst cases are listed.
const WORST: usize = 10;

/// Does the search of a diagnosis find the fit that there is?
///
/// For each effect a truth is drawn that has it, its recordings are diagnosed from the supplied model, and what the
/// search left of the true structure is compared with a fit that starts at the true parameters.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench search --seeds 1..2 --minutes 12
  cargo xtask bench search --seeds 7 --sets bench --only gravity,end_stop")]
pub struct Options {
    /// Seeds of each effect: a range with both ends, 1..4, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse, default_value = "1")]
    seeds: Seeds,
    /// How recordings are made: example, rich, paper, bench, with commas
    #[arg(long, value_name = "SET,…", value_delimiter = ',', value_parser = Set::parse)]
    #[arg(default_value = "example,rich")]
    sets: Vec<Set>,
    /// Only these effects, with commas
    #[arg(long, value_name = "KIND,…", value_delimiter = ',', value_parser = effect)]
    only: Vec<Kind>,
    /// Begin no further case after so many minutes
    #[arg(long, value_name = "M")]
    minutes: Option<u64>,
    /// Where the files of the cases go [default: search in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// How the recordings of a case are made: as a set of the blind benchmark, or as `softrig example` does.
#[derive(Clone, Copy, Debug)]
struct Set(Option<Collection>);

impl Set {
    fn all() -> impl Iterator<Item = Self> {
        let drawn = Collection::WORLDS.into_iter().map(Some);
        [None].into_iter().chain(drawn).map(Self)
    }

    fn parse(name: &str) -> Result<Self, String> {
        let mut all = Self::all();
        let set = all.find(|set| set.name() == name);
        set.ok_or_else(|| "give example, rich, paper or bench".into())
    }

    fn name(self) -> &'static str {
        self.0.map_or("example", Collection::name)
    }

    /// Draws a case that hides an effect, writes it below a folder, and says where, and the truth.
    fn draw(
        self,
        kind: Kind,
        seed: u64,
        folder: &Path,
    ) -> Result<(PathBuf, Model<f64>), InputError> {
        let Some(collection) = self.0 else {
            example::make(Hidden::Effect(kind), NOISE_DEG, seed)?.write(folder)?;
            let truth = ModelFile::read(&folder.join("truth.toml"))?;
            return Ok((folder.to_owned(), truth.model));
        };
        // The first of a kind has the catalogue's own formula.
        let plans = Plans::of(collection, 1, &[kind.name().to_owned()], seed);
        let drawn = OnceLock::new();
        let keep = |answer: &Answer| {
            drawn.get_or_init(|| model_of(kind, &answer.secret().truth));
            Ok(())
        };
        draw(&plans, seed, folder, |_| false, keep)?;
        let truth = drawn.into_inner().flatten().ok_or_else(|| {
            let found = "what was drawn is no model of the catalogue";
            InputError::new(found, "choose another seed")
        })?;
        Ok((folder.join(&plans.names()[0]), truth))
    }
}

fn effect(name: &str) -> Result<Kind, String> {
    match Hidden::named(Some(name)) {
        Ok(Hidden::Effect(kind)) => Ok(kind),
        Ok(_) => Err("there is nothing to search for: give an effect".into()),
        Err(error) => Err(error.to_string()),
    }
}

/// A drawn world by the catalogue's formula of its effect.
fn model_of(kind: Kind, world: &World) -> Option<Model<f64>> {
    let hidden = world.effects.first()?;
    let keys = hidden.law.row().quantities;
    let rows = kind.parameters().iter();
    let values: Option<Vec<f64>> = rows
        .map(|row| match keys.iter().position(|it| it.key == row.key) {
            Some(place) => Some(hidden.values[place]),
            None => row.left_out().map(f64::from),
        })
        .collect();
    let base = world.base;
    let dynamics = Dynamics {
        inertia: base.inertia,
        damping: base.damping,
        stiffness: base.stiffness,
        exponent: base.exponent,
        input_gain: base.input_gain,
    };
    Model::new(dynamics, &[kind.build(&values?)?]).ok()
}

impl Options {
    /// Diagnoses every effect with each seed. A case that does not go through is a line of the page.
    pub fn measure(&self, folder: &Path) -> Value {
        let folder = self.folder.as_deref().unwrap_or(folder);
        let all = self.only.is_empty();
        let kinds = if all {
            Kind::NAMES
        } else {
            self.only.as_slice()
        };
        let mut each = Vec::new();
        for &seed in &self.seeds.each {
            for &set in &self.sets {
                each.extend(kinds.iter().map(|&kind| (set, kind, seed)));
            }
        }
        let clock = Instant::now();
        let most = self.minutes.map(|it| Duration::from_secs(60 * it));
        let planned = each.len();
        let (mut cases, mut failed) = (Vec::new(), Vec::new());
        // One after the other: evaluations and processor time are those of the whole process.
        for (set, kind, seed) in each {
            if most.is_some_and(|most| clock.elapsed() > most) {
                break;
            }
            match Searched::of(set, kind, seed, folder) {
                Ok(case) => {
                    eprintln!("{}", json!(case));
                    cases.push(case);
                }
                Err(why) => failed.push(format!("{} {} {seed}: {why}", set.name(), kind.name())),
            }
        }
        let mut figures = figures(&cases);
        figures["command"] = self.command().into();
        figures["left_out"] = (planned - cases.len() - failed.len()).into();
        figures["failed"] = failed.into();
        figures
    }

    /// The options as they would be typed, without those that change no figure.
    fn command(&self) -> String {
        let sets: Vec<&str> = self.sets.iter().map(|set| set.name()).collect();
        let only: Vec<&str> = self.only.iter().map(|kind| kind.name()).collect();
        let (seeds, sets) = (&self.seeds.asked, sets.join(","));
        let mut text = format!("cargo xtask bench search --seeds {seeds} --sets {sets}");
        if !only.is_empty() {
            text += &format!(" --only {}", only.join(","));
        }
        if let Some(minutes) = self.minutes {
            text += &format!(" --minutes {minutes}");
        }
        text
    }
}

/// A case: what can be left, and what was.
#[derive(Clone, Debug, Serialize)]
struct Searched {
    set: &'static str,
    effect: &'static str,
    seed: u64,
    /// What the supplied structure leaves, refitted (° RMS, like the others).
    refit_rmse_deg: f64,
    /// What a fit of the true structure leaves that starts at the truth.
    truth_rmse_deg: f64,
    /// What the search left of the true structure; none where it was not among those with a final fit.
    search_rmse_deg: Option<f64>,
    /// What it left of an effect that has the true one as a special case.
    wider_rmse_deg: Option<f64>,
    /// Whether anything was searched: not where the refit passes for noise.
    tried: bool,
    found: bool,
    /// Place of the effect by the score, from 1.
    rank: Option<usize>,
    cpu_seconds: Option<f64>,
    /// Evaluations of the model on numbers, and with derivatives.
    evaluations: u64,
    evaluations_with_derivatives: u64,
}

impl Searched {
    fn of(set: Set, kind: Kind, seed: u64, folder: &Path) -> Result<Self, InputError> {
        let folder = folder.join(format!("{}_{}_{seed}", set.name(), kind.name()));
        let (folder, truth) = set.draw(kind, seed, &folder)?;
        let case = Case::read(&folder, None).map_err(|what| InputError::new(what, "draw again"))?;
        let file = ModelFile::read(&case.model)?;
        let recordings = read_all(&case.recordings, &Layout::default(), |_| {})?;
        let request = Request::of(&file, &recordings);
        let (work, processor) = (Work::so_far(), seconds(Of::Itself));
        let diagnosis = diagnose(&request, &Job::default())?;
        let work = Work::so_far() - work;
        let spent = seconds(Of::Itself).zip(processor);
        let truth = from_truth(kind, &truth, &file, &diagnosis);
        let left = left(kind, &diagnosis.tried);
        Ok(Self {
            set: set.name(),
            effect: kind.name(),
            seed,
            refit_rmse_deg: diagnosis.refit.rmse().to_degrees(),
            truth_rmse_deg: truth.to_degrees(),
            search_rmse_deg: left[0].map(f64::to_degrees),
            wider_rmse_deg: left[1].map(f64::to_degrees),
            tried: !diagnosis.tried.is_empty(),
            found: is_found(truth, left),
            rank: rank(kind, &file, &diagnosis),
            cpu_seconds: spent.map(|(after, before)| after - before),
            evaluations: work.plain,
            evaluations_with_derivatives: work.with_derivatives,
        })
    }

    /// What is left, over what can be: without a fit of the effect that is what the refit leaves.
    fn behind(&self) -> f64 {
        let left = [self.search_rmse_deg, self.wider_rmse_deg]
            .into_iter()
            .flatten();
        left.reduce(f64::min).unwrap_or(self.refit_rmse_deg) / self.truth_rmse_deg
    }

    fn is_large(&self) -> bool {
        self.refit_rmse_deg >= LARGE * self.truth_rmse_deg
    }
}

/// Whether one of these errors is that of the fit from the truth.
fn is_found(truth: f64, left: [Option<f64>; 2]) -> bool {
    left.into_iter()
        .flatten()
        .any(|left| left * left <= SAME * truth * truth)
}

/// The least RMS error of the effect alone, and of one that has it as a special case.
fn left(kind: Kind, tried: &[FittedStructure]) -> [Option<f64>; 2] {
    let least = |is: &dyn Fn(Kind) -> bool| {
        let alone = tried
            .iter()
            .filter(|it| matches!(it.kinds[..], [only] if is(only)));
        alone.map(|it| it.rmse).reduce(f64::min)
    };
    [
        least(&|it| it == kind),
        least(&|it| it.info().special_case == Some(kind)),
    ]
}

/// RMS error of the true structure, fitted from the truth with what the search frees for it.
fn from_truth(kind: Kind, truth: &Model<f64>, file: &ModelFile, diagnosis: &Diagnosis) -> f64 {
    let mut freed = file.clone();
    freed.free.clone_from(&diagnosis.refit.free);
    // Zeros of the refit are bent by what it lacks.
    let data = diagnosis.data.guessing(&diagnosis.data.expected());
    let fitter = Fitter::new(&diagnosis.refit.model, &data);
    fitter
        .fit(truth, &free_parameters(&freed, &[kind]), Effort::Full)
        .rmse()
}

/// The place of an effect by the score, as the search sees it first.
fn rank(kind: Kind, file: &ModelFile, diagnosis: &Diagnosis) -> Option<usize> {
    let fitter = Fitter::new(&diagnosis.refit.model, &diagnosis.data);
    let (kinds, _) = applicable(&file.model, &[], &[], &fitter);
    let scales = Scales::of(&fitter, &diagnosis.refit);
    let fits = [&diagnosis.refit, &diagnosis.nominal];
    let guesses = Guesses::of(&fitter, fits, diagnosis.floor.white, &kinds, &scales);
    let place = guesses.ranked().iter().position(|it| *it == kind)?;
    Some(place + 1)
}

fn figures(cases: &[Searched]) -> Value {
    let group = |name: &str, is: &dyn Fn(&Searched) -> bool| {
        let these: Vec<&Searched> = cases.iter().filter(|case| is(case)).collect();
        let count = |is: &dyn Fn(&Searched) -> bool| these.iter().filter(|case| is(case)).count();
        let mut spent: Vec<f64> = these.iter().filter_map(|case| case.cpu_seconds).collect();
        json!({
            "name": name, "cases": these.len(),
            "found": Rate::count(these.iter().map(|case| case.found)).shown(),
            "quiet": count(&|case| !case.tried),
            "not_tried": count(&|case| case.tried && case.search_rmse_deg.is_none()),
            "first": FIRST.map(|most| count(&|case| case.rank.is_some_and(|rank| rank <= most))),
            "median_cpu_seconds": (!spent.is_empty()).then(|| median(&mut spent)),
        })
    };
    let sets = Set::all().map(|set| group(set.name(), &|case| case.set == set.name()));
    let effects = Kind::NAMES
        .iter()
        .map(|kind| group(kind.name(), &|case| case.effect == kind.name()));
    let sizes = [
        group("small", &|case| !case.is_large()),
        group("large", &Searched::is_large),
    ];
    let some = |groups: Vec<Value>| -> Vec<Value> {
        groups
            .into_iter()
            .filter(|group| group["cases"] != 0)
            .collect()
    };
    let mut worst: Vec<&Searched> = cases.iter().filter(|case| !case.found).collect();
    worst.sort_by(|a, b| b.behind().total_cmp(&a.behind()));
    worst.truncate(WORST);
    json!({
        "benchmark": "search", "cases": cases, "same": SAME, "large": LARGE, "all": group("all", &|_| true),
        "groups": some(sets.chain(sizes).collect()), "effects": some(effects.collect()), "worst": worst,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blind::law::Law;
    use crate::blind::sizes::typical_effect;
    use crate::blind::world::Base;
    use crate::pages::render;

    fn tried(kinds: &[Kind], rmse: f64) -> FittedStructure {
        FittedStructure {
            kinds: kinds.to_vec(),
            rmse,
            held_out: None,
            delta_bic: 0.0,
            probability: 0.0,
            rejected: false,
            at_bound: Vec::new(),
        }
    }

    #[test]
    fn a_special_case_is_found_by_what_has_it() {
        use Kind::{CoulombFriction, Gravity, StribeckFriction};
        let structures = [
            tried(&[CoulombFriction], 1.02),
            tried(&[CoulombFriction, Gravity], 0.9),
            tried(&[StribeckFriction], 1.0),
        ];
        let narrow = left(CoulombFriction, &structures);
        assert_eq!(narrow, [Some(1.02), Some(1.0)]);
        assert!(is_found(1.0, narrow));
        // 2 % of the squared error, not of the error.
        assert!(!is_found(1.0, [Some(1.02), None]) && is_found(1.0, [Some(1.009), None]));
        assert_eq!(left(StribeckFriction, &structures[..2]), [None, None]);
        assert!(!is_found(1.0, [None, None]));
    }

    #[test]
    fn what_is_found_is_counted_and_the_worst_come_first() {
        let case = |seed, search: Option<f64>, rank| Searched {
            set: "rich",
            effect: "gravity",
            seed,
            refit_rmse_deg: 3.0,
            truth_rmse_deg: 1.0,
            search_rmse_deg: search,
            wider_rmse_deg: None,
            tried: true,
            found: is_found(1.0, [search, None]),
            rank,
            cpu_seconds: Some(4.0),
            evaluations: 1,
            evaluations_with_derivatives: 2,
        };
        let mut quiet = case(14, None, None);
        (quiet.refit_rmse_deg, quiet.tried) = (1.1, false);
        let cases = [
            case(11, Some(1.0), Some(1)),
            case(12, Some(2.0), Some(5)),
            case(13, None, Some(9)),
            quiet,
        ];
        let mut figures = figures(&cases);
        let all = &figures["all"];
        assert_eq!(all["found"]["hits"], 1);
        assert_eq!([&all["quiet"], &all["not_tried"]], [1, 1]);
        assert_eq!(all["first"], json!([1, 1, 2]));
        let worst = figures["worst"].as_array().unwrap().iter();
        assert!(worst.map(|case| &case["seed"]).eq([13, 12, 14]));
        assert_eq!(figures["groups"].as_array().unwrap().len(), 3);
        figures["command"] = "cargo xtask bench search".into();
        figures["failed"] = json!([]);
        let text = render(&figures).unwrap();
        assert!(text.contains("1 of 4"), "{text}");
        assert!(
            text.contains("| rich | `gravity` | 13 | 3.00 | 1.00 | – | 9 |"),
            "{text}"
        );
    }

    #[test]
    fn a_drawn_law_is_the_effect_of_the_catalogue() {
        for &kind in Kind::NAMES {
            let law = Law::in_turn(kind.name(), 0);
            let base = Base {
                inertia: 0.3,
                damping: 1.0,
                stiffness: 5.0,
                exponent: 2.0,
                input_gain: 1e-4,
            };
            let effects = vec![typical_effect(law, &base, 1)];
            let model = model_of(kind, &World { base, effects }).unwrap();
            assert!(model.effects().map(|effect| effect.kind()).eq([kind]));
        }
    }
}
