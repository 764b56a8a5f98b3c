//! The content of a diagnosis: sentences and rounded numbers.
//!
//! Terminal and page must agree. So every sentence and every row that both show is made
//! here, and neither computes its own.

mod errors;
mod explained;
mod keys;
mod methods;
mod open;
mod parameters;
mod rivals;
mod sentences;
mod tried;
mod words;

use serde::Serialize;

pub use errors::{ErrorRow, Notice};
pub use keys::Key;
pub use parameters::{Effect, ParameterRow};
pub use rivals::{CLOSEST, NextRun, Rival};
pub use sentences::sentence;
pub use tried::{Standing, TriedGroup, TriedRow, Untried};

use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::work::budget::BudgetEnd;
use softrig::diagnose::{Diagnosis, Request, Upload};
use softrig::prediction::StandIn;

/// The content of a diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Content {
    /// The answer.
    pub answer: Answer,
    /// The verdict in one sentence.
    pub sentence: String,
    /// Two or three sentences: the evidence, and what to do.
    pub lede: String,
    /// Sentences about a search that ended early: the cause, and what was not tried.
    pub ended: Option<String>,
    /// The numbers that matter most.
    pub keys: Vec<Key>,
    /// Notices about the recordings.
    pub notices: Vec<Notice>,
    /// What was left out of the files, or changed in them, as sentences.
    pub left_out: Vec<String>,
    /// Name of the output, such as `angle`.
    pub output: String,
    /// Symbol of its unit, such as `°`.
    pub unit: &'static str,
    /// Errors on fitted runs and on validation runs.
    pub errors: Vec<ErrorRow>,
    /// How the test runs were started, as a sentence.
    pub tested: Option<String>,
    /// Whether effects were added to the model.
    pub repaired: bool,
    /// Whether the written model is worth an upload, as the verdict says.
    pub upload: bool,
    /// Why a model that is better on the computer is not for a board, as sentences.
    pub refused: Option<String>,
    /// How much of the gap the added effects close, as a sentence.
    pub closed: Option<String>,
    /// The added effects.
    pub effects: Vec<Effect>,
    /// The parameters that the model had before.
    pub base: Vec<ParameterRow>,
    /// The sensors' zeros, as a sentence.
    pub zeros: String,
    /// Sentences about parameters that the recordings do not determine.
    pub undetermined: Vec<String>,
    /// Sentences about the missing force.
    pub gap: Vec<String>,
    /// Clauses about features of step responses in which the refitted model is off.
    pub steps: Vec<String>,
    /// Rival explanations, best first.
    pub rivals: Vec<Rival>,
    /// The letters of the curves, where several explanations remain.
    pub lettered: Option<String>,
    /// Structures that were fitted, by their number of effects.
    pub tried: Vec<TriedGroup>,
    /// Effects that were not tried, by the reason.
    pub untried: Vec<Untried>,
    /// Runs that would separate the rivals, best first.
    pub next: Vec<NextRun>,
    /// Whether the first of them is expected to.
    pub next_suffices: bool,
    /// What a changed rig would tell that no plan can offer yet.
    pub changes: Vec<String>,
    /// Sentences about what these recordings leave open.
    pub open: Vec<String>,
    /// What was done, as a paragraph for a paper.
    pub methods: String,
}

impl Content {
    /// Says that the written model has no effect, since none is named (`--named-only`).
    pub fn leave_out_unnamed(&mut self) {
        self.upload = false;
        self.refused = Some(
            "No effect is named, so the written model is only refitted. Without --named-only it \
             also contains what lowers the error."
                .into(),
        );
    }

    /// Says the same of somebody else's simulation, for which the model stands in.
    pub fn speak_of_simulation(&mut self, stand_in: &StandIn) {
        let of_model = self.sentence.clone();
        for model in ["The model", "the model"] {
            let simulation = format!("{} simulation in {}", &model[..3], stand_in.column);
            self.sentence = self.sentence.replace(model, &simulation);
        }
        self.methods = self.methods.replace(&of_model, &self.sentence);
        self.methods += &format!(" Of the simulation: {}.", stand_in.caveat);
        let about = Notice {
            about: Some(stand_in.column.clone()),
            text: stand_in.caveat.clone(),
            advice: "what is called measured here is that model's motion plus this residual"
                .to_owned(),
        };
        self.notices.insert(0, about);
    }

    /// Puts a diagnosis into words.
    pub fn of(request: &Request<'_>, diagnosis: &Diagnosis) -> Self {
        let repaired = !diagnosis.repaired.added.is_empty();
        let upload = diagnosis.upload(request.file);
        let said = sentence(diagnosis);
        let measurand = diagnosis.data.measurand();
        let errors = errors::errors(diagnosis);
        let tried = tried::tried(diagnosis);
        Self {
            answer: diagnosis.finding.answer(),
            methods: methods::methods(request, diagnosis, &said, (&errors, &tried)),
            sentence: said,
            lede: sentences::lede(diagnosis),
            ended: diagnosis.ended.as_ref().map(BudgetEnd::sentence),
            keys: keys::keys(diagnosis),
            notices: errors::notices(diagnosis),
            left_out: diagnosis.not_used.iter().map(ToString::to_string).collect(),
            output: measurand.name().to_owned(),
            unit: measurand.symbol(),
            errors,
            tested: errors::tested(diagnosis),
            repaired,
            upload: upload == Upload::Worth,
            refused: match upload {
                Upload::Refused(why) => Some(why),
                Upload::Worth | Upload::Unchanged => None,
            },
            closed: diagnosis
                .closure
                .map(|closure| explained::explained(diagnosis, &closure)),
            effects: parameters::effects(diagnosis),
            base: parameters::base(request, diagnosis),
            zeros: diagnosis.zeros().sentence(&measurand),
            undetermined: diagnosis.identifiability[0].text.clone(),
            gap: diagnosis.gap.sentences.clone(),
            steps: diagnosis
                .steps
                .iter()
                .map(|gap| gap.clause(&measurand))
                .collect(),
            tried,
            untried: tried::untried(diagnosis),
            next: rivals::next(request, diagnosis),
            next_suffices: rivals::next_suffices(diagnosis),
            changes: rivals::changes(diagnosis),
            open: open::open(diagnosis),
            rivals: rivals::rivals(diagnosis),
            lettered: rivals::lettered(diagnosis),
        }
    }

    /// Whether the written model is the supplied one.
    pub fn is_unchanged(&self) -> bool {
        !self.upload && self.refused.is_none()
    }

    /// Whether something is missing, named or not.
    pub fn something_is_missing(&self) -> bool {
        !matches!(self.answer, Answer::NoDiscrepancy | Answer::ParametersOnly)
    }

    /// The title of the section of rivals.
    pub fn rivals_title(&self) -> &'static str {
        if self.answer == Answer::Unexplained {
            CLOSEST
        } else {
            "Rivals"
        }
    }
}
