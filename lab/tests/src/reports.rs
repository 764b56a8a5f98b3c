//! A report of each verdict, from one small example.
//!
//! What hides an effect, what has only wrong parameters and what lacks nothing
//! is diagnosed as a user would. "Cannot tell" and "unexplained" take minutes
//! of search before they are said; here they are the first diagnosis with its
//! answer taken back, which is all that a page can see of them.

use std::path::{Path, PathBuf};

use model_core::catalogue::Kind;
use softrig::diagnose::decide::finding::{Explanation, Finding};
use softrig::diagnose::decide::verdict::{Answer, Strength};
use softrig::diagnose::experiment::plan::Proposal;
use softrig::diagnose::fit::candidates::{Candidate, SkippedEffect};
use softrig::diagnose::{Diagnosis, Request};
use softrig::synth::example::{Example, Hidden, make};
use softrig_formats::protocol_file::ProtocolFile;
use softrig_report::Outputs;
use softrig_report::content::Content;
use softrig_report::html::page;
use softrig_report::provenance::Provenance;
use softrig_report::terminal::summary;
use wire::protocol::Named;

use softrig_tests::Case;

/// The name of a recording that would end a page whose names are not escaped.
pub const EVIL: &str = "step90_2 <script>alert('x')<b> & \"co\"";

/// The name of the model, likewise.
pub const EVIL_MODEL: &str = "</title><script>alert(1)</script>";

/// A report with what it was made from.
#[derive(Debug)]
pub struct Report {
    /// The verdict.
    pub answer: Answer,
    /// The page.
    pub html: String,
    /// The same with another wall time.
    pub later: String,
    /// The summary on the terminal.
    pub summary: String,
    /// What both say.
    pub content: Content,
    /// The files that were read.
    pub files: Vec<PathBuf>,
}

/// Makes a report of each verdict from files in `folder`.
///
/// # Panics
///
/// If an example cannot be made, written, read or diagnosed.
pub fn of_every_kind(folder: &Path) -> Vec<Report> {
    let missing = case(Hidden::Effect(Kind::QuadraticDamping), &folder.join("drag"));
    let found = missing.diagnose();
    let wrong = case(Hidden::Nothing, &folder.join("parameters"));
    let moved = wrong.diagnose();
    let mut right = case(Hidden::Nothing, &folder.join("nothing"));
    right.file.model = moved.refit.model;
    let agreed = right.diagnose();
    vec![
        report(&missing, &cannot_tell(&found)),
        report(&missing, &unexplained(&found)),
        report(&missing, &found),
        report(&wrong, &moved),
        report(&right, &agreed),
    ]
}

/// Three runs to fit and two to judge by; the names of one and of the model
/// are not what a page expects.
fn case(hidden: Hidden, folder: &Path) -> Case {
    let mut example: Example = make(hidden, 0.4, 1).unwrap();
    let wanted = ["step30_1", "step60_1", "step90_1", "step90_2", "triangle"];
    example
        .recordings
        .retain(|(file, ..)| wanted.contains(&file.trim_end_matches(".csv")));
    for (file, ..) in &mut example.recordings {
        if file == "step90_2.csv" {
            *file = format!("{EVIL}.csv");
        }
    }
    example.write(folder).unwrap();
    let mut case = Case::read(
        folder,
        &["step30_1", "step60_1", "step90_1"],
        &["step90_2", "triangle"],
    );
    EVIL_MODEL.clone_into(&mut case.file.name);
    case
}

fn report(case: &Case, diagnosis: &Diagnosis) -> Report {
    let request = Request {
        file: &case.file,
        recordings: &case.recordings,
        holdout: &case.holdout,
        start_from: &[],
        own: None,
        formulas: true,
        without: &[],
        seed: 1,
    };
    let paths = |recordings: &[softrig_formats::recording::Recording]| -> Vec<PathBuf> {
        recordings.iter().map(|run| run.path.clone()).collect()
    };
    let (fitted, held_out) = (paths(&case.recordings), paths(&case.holdout));
    let command = "softrig diagnose --model model.toml".to_owned();
    let provenance = Provenance::of(&case.file.path, None, &fitted, &held_out, command).unwrap();
    let content = Content::of(&request, diagnosis);
    let with = |seconds| page(&request, diagnosis, &content, &provenance, seconds).unwrap();
    let report = Path::new("report.html");
    let outputs = Outputs {
        page: Some(report),
        verdict: Some(report),
        picture: Some(report),
        model: Some(report),
        ..Outputs::default()
    };
    Report {
        answer: diagnosis.finding.answer(),
        html: with(1.0),
        later: with(2.0),
        summary: summary(&content, &outputs, 1, 1.0),
        files: [vec![case.file.path.clone()], fitted, held_out].concat(),
        content,
    }
}

/// The diagnosis with another finding that names nothing.
fn without_a_name(found: &Diagnosis, finding: Finding) -> Diagnosis {
    let mut other = found.clone();
    other.finding = finding;
    other.repaired = Candidate::of(0, found.refit.clone());
    other.closure = None;
    other.gap_left = None;
    other.held_out.repaired = found.held_out.refit;
    other.held_out.repaired_on_board = found.held_out.refit;
    for run in &mut other.held_out.runs {
        run.repaired_on_board = run.refit;
    }
    other.adequacy.adequate = false;
    other.adequacy.exact_form = false;
    other.adequacy.holdout_gap_closed = 0.0;
    other.untried = vec![
        SkippedEffect {
            kind: Kind::Leak,
            reason: "the pressure never changes in these recordings",
        },
        SkippedEffect {
            kind: Kind::DeadTime,
            reason: "the pressure never changes in these recordings",
        },
    ];
    other
}

fn cannot_tell(found: &Diagnosis) -> Diagnosis {
    let rivals = [Kind::QuadraticDamping, Kind::AngleDependentDamping].map(|kind| vec![kind]);
    let finding = Finding::Rivals {
        rivals: rivals
            .iter()
            .zip([0.7, 0.3])
            .map(|(kinds, probability)| Explanation {
                kinds: kinds.clone(),
                probability,
                delta_bic: 2.0,
            })
            .collect(),
        families: Vec::new(),
        strength: Strength::Explains,
    };
    Diagnosis {
        proposals: vec![(
            Proposal {
                protocol: ProtocolFile::named(Named::Steps),
                separates: (0, 1),
                evidence: 120.0,
                decides: true,
            },
            rivals,
        )],
        // Their curves; that both are those of the same fit shows nowhere.
        rivals: vec![found.repaired.clone(), found.repaired.clone()],
        ..without_a_name(found, finding)
    }
}

fn unexplained(found: &Diagnosis) -> Diagnosis {
    let closest = found.finding.explanations().to_vec();
    let mut other = without_a_name(found, Finding::Unexplained { closest });
    for tried in &mut other.tried {
        tried.held_out = tried
            .held_out
            .map(|(error, closed)| (error, closed.min(0.2)));
    }
    other
}
