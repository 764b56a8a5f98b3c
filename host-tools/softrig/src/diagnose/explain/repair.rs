//! The model that `-o` writes, and whether a board should get it.

use model_core::actuator::Model;
use softrig_formats::family;
use softrig_formats::model_file::ModelFile;
use softrig_formats::settings_file::from_model;

use super::Diagnosis;
use crate::diagnose::decide::finding::Finding;
use crate::diagnose::decide::verdict::{Answer, Zeros};
use crate::diagnose::score::grammar::is_term;
use crate::estimate::fit::Fit;
use crate::sim::board::{self, BoardLimit};

/// What is to become of the model that `-o` writes on a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Upload {
    /// It is worth an upload.
    Worth,
    /// It is the supplied one, unchanged.
    Unchanged,
    /// It predicts better on the computer, and not on the board: a sentence or two that say
    /// why.
    Refused(String),
}

impl Diagnosis {
    /// The model that `-o` writes: the repaired one, or the nominal one where nothing is
    /// wrong with it or the other predicts no better.
    pub fn model_to_keep<'a>(&'a self, nominal: &'a ModelFile) -> &'a Model<f64> {
        if self.is_better() {
            &self.repaired.fit.model
        } else {
            &nominal.model
        }
    }

    /// The text of that model file, with a comment above added effects.
    pub fn model_text(&self, nominal: &ModelFile) -> String {
        let what = match &self.finding {
            named if named.named().into_iter().any(is_term) => {
                "Added by softrig diagnose: a force that is not in the catalogue.".into()
            }
            Finding::Quiet { .. } | Finding::Named { .. } => "Added by softrig diagnose.".into(),
            Finding::OutOfTime { .. } | Finding::Unexplained { .. } => {
                "Added by softrig diagnose: lowers the error, not named.".into()
            }
            undecided if undecided.families().is_empty() => {
                "Added by softrig diagnose: one of several that these recordings cannot tell apart."
                    .into()
            }
            undecided => format!("representative of {}", family::title(undecided.families())),
        };
        nominal.text_with(self.model_to_keep(nominal), &format!("# {what}\n"))
    }

    /// Whether what `-o` adds has a name: an effect, or nothing where nothing is missing.
    pub fn is_named(&self) -> bool {
        matches!(self.finding, Finding::Quiet { .. } | Finding::Named { .. })
    }

    /// The text of that model file with named effects alone: where none is named, the refitted model,
    /// or the nominal one if that predicts validation runs better.
    pub fn named_model_text(&self, nominal: &ModelFile) -> String {
        if self.is_named() {
            return self.model_text(nominal);
        }
        let is_better = self.held_out.refit < self.held_out.nominal;
        let model = if is_better {
            &self.refit.model
        } else {
            &nominal.model
        };
        nominal.text_with(model, "")
    }

    /// Whether the repaired model predicts held-out runs better than the nominal one.
    pub fn is_better(&self) -> bool {
        self.finding.answer() != Answer::NoDiscrepancy
            && self.held_out.repaired < self.held_out.nominal
    }

    /// What is to become of the written model on a board.
    pub fn upload(&self, file: &ModelFile) -> Upload {
        if !self.is_better() {
            return Upload::Unchanged;
        }
        if let Finding::Rivals { .. } = self.finding {
            return Upload::Refused(
                "These recordings do not tell the explanations apart: upload none of them yet. A \
                 wrong one predicts these runs too, but not others."
                    .into(),
            );
        }
        let mut kept = file.clone();
        kept.model = self.fit_to_keep().model;
        let farthest = board::farthest(self.data.largest_angle());
        let refused = from_model(&kept)
            .map_err(|error| error.found)
            .and_then(|_| board::plan(&kept.model, farthest));
        if let Err(why) = refused {
            return Upload::Refused(format!(
                "The board cannot run this model: {why}. Use it on the computer."
            ));
        }
        let zeros = self.fit_to_keep().nuisances.iter();
        let mut sessions = self.data.sessions().iter().zip(zeros);
        let beyond = Err(BoardLimit::Pressure);
        if sessions.any(|(it, zeros)| board::is_seen(it.signal(), zeros.pressure_zero) == beyond) {
            return Upload::Refused(format!(
                "No board can run this rig: {}. Use the model on the computer.",
                BoardLimit::Pressure
            ));
        }
        if self.held_out.repaired_on_board < self.held_out.nominal {
            return Upload::Worth;
        }
        Upload::Refused(
            "In the steps of the board this model predicts no better than the one supplied. Use \
             it on the computer."
                .into(),
        )
    }

    /// The fit of the written model.
    pub(super) fn fit_to_keep(&self) -> &Fit {
        if self.is_better() {
            &self.repaired.fit
        } else {
            &self.nominal
        }
    }

    /// The zeros of the sensors under the written model.
    pub fn zeros(&self) -> Zeros {
        Zeros::of(self.fit_to_keep(), &self.data)
    }
}
