//! Writes the question of a case in one of the ways: a model, recordings, flags.

use std::fs;
use std::path::{Path, PathBuf};

use model_core::actuator::ParameterId;
use softrig_formats::columns::Columns;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::meta_beside;

use softrig_tests::{text_of, write};

use super::cases::Case;
use super::ways::{Way, model_file};

/// All that a diagnosis is asked.
#[derive(Clone, Debug, PartialEq)]
pub struct Question {
    /// The first model.
    pub model: PathBuf,
    /// Recordings to fit.
    pub recordings: Vec<PathBuf>,
    /// Recordings for validation.
    pub holdout: Vec<PathBuf>,
    /// Units of the recordings, where they are not those of their header.
    pub units: Option<Columns>,
    /// Random seed.
    pub seed: u64,
}

/// A question, or why a case cannot be asked in this way.
#[derive(Clone, Debug, PartialEq)]
pub enum Posed {
    /// Ask it.
    Question(Box<Question>),
    /// It would be the plain question again, or one about another model.
    LeftOut(String),
}

/// Makes a first model of recordings, and writes it.
pub type FirstModel<'a> = &'a dyn Fn(&[PathBuf], &Path) -> Result<(), String>;

/// Poses the question of a case, with changed files in `folder`. `first_model` is asked for
/// [`Way::Init`] alone.
///
/// # Errors
///
/// Which file cannot be read or written.
pub fn pose(
    case: &Case,
    way: Way,
    folder: &Path,
    first_model: FirstModel<'_>,
) -> Result<Posed, String> {
    let mut question = Question {
        model: case.model.clone(),
        recordings: case.recordings.clone(),
        holdout: case.holdout.clone(),
        units: way.units(),
        seed: way.seed(),
    };
    let file = model_file(&text_of(&case.model)?, &case.model)?;
    let changed = match way {
        Way::Plain | Way::Seed => Ok(()),
        Way::Order if question.recordings.len().max(question.holdout.len()) < 2 => {
            Err("one recording has one order".into())
        }
        Way::Order => {
            question.recordings.reverse();
            question.holdout.reverse();
            Ok(())
        }
        Way::Units if file.recording.columns != Columns::default() => {
            Err("its model says in which units its recordings are".into())
        }
        Way::Init => initial(case, &file, folder, first_model).map(|model| question.model = model),
        _ => way.model(&file).and_then(|text| {
            if text != file.text() {
                question.model = folder.join("model.toml");
                write(&question.model, &text)?;
            }
            Ok(())
        }),
    };
    if let Err(why) = changed {
        return Ok(Posed::LeftOut(why));
    }
    if way.changes_recordings() {
        for (name, paths) in [
            ("recordings", &mut question.recordings),
            ("holdout", &mut question.holdout),
        ] {
            let folder = folder.join(name);
            for path in paths {
                match rewrite(way, path, &folder, &case.columns)? {
                    Ok(rewritten) => *path = rewritten,
                    Err(why) => return Ok(Posed::LeftOut(why)),
                }
            }
        }
    }
    Ok(Posed::Question(Box::new(question)))
}

/// The model that a stranger would begin with.
fn initial(
    case: &Case,
    file: &ModelFile,
    folder: &Path,
    first_model: FirstModel<'_>,
) -> Result<PathBuf, String> {
    if !file.free.contains(&ParameterId::InputGain) {
        return Err("a free swing keeps its model".into());
    }
    fs::create_dir_all(folder)
        .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    let path = folder.join("model.toml");
    let _ = fs::remove_file(&path); // `softrig init` writes over nothing.
    first_model(&case.recordings, &path).map_err(|why| format!("softrig init: {why}"))?;
    let initial = model_file(&text_of(&path)?, &path)?;
    is_same_base(file, &initial)?;
    Ok(path)
}

/// Whether two models of a rig have the same structure: what is missing is a question about
/// a structure.
fn is_same_base(file: &ModelFile, initial: &ModelFile) -> Result<(), String> {
    let others = |one: &ModelFile, other: &ModelFile| -> Vec<String> {
        let others = one.free.iter().filter(|id| !other.free.contains(id));
        others.map(|&id| one.parameter_name(id)).collect()
    };
    let (more, less) = (others(initial, file), others(file, initial));
    if !more.is_empty() {
        return Err(format!("softrig init frees {} as well", more.join(" and ")));
    }
    if !less.is_empty() {
        return Err(format!("softrig init does not free {}", less.join(" and ")));
    }
    let exponents = [file, initial].map(|it| it.model.value(ParameterId::Exponent));
    if let [Some(ours), Some(theirs)] = exponents
        && !file.free.contains(&ParameterId::Exponent)
        && (ours - theirs).abs() > 1e-9
    {
        return Err(format!(
            "softrig init fixes the exponent at {theirs}, not {ours}"
        ));
    }
    Ok(())
}

/// Writes a recording and its metadata into a folder; the inner error is why this way does
/// not apply to it.
fn rewrite(
    way: Way,
    path: &Path,
    folder: &Path,
    columns: &[String; 3],
) -> Result<Result<PathBuf, String>, String> {
    let name = path.file_name().unwrap_or_default();
    let columns = columns.each_ref().map(String::as_str);
    let (text, samples) = match way.recording(&text_of(path)?, columns) {
        Ok(changed) => changed,
        Err(why) => return Ok(Err(format!("{}: {why}", name.display()))),
    };
    let changed = folder.join(name);
    write(&changed, &text)?;
    let meta = meta_beside(path);
    if meta.exists() {
        match way.meta(&text_of(&meta)?, samples) {
            Ok(text) => write(&meta_beside(&changed), &text)?,
            Err(why) => return Ok(Err(format!("{}: {why}", meta.display()))),
        }
    }
    Ok(Ok(changed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::recording::Recording;

    fn model(free: &str, exponent: f64) -> String {
        format!(
            "schema = 1\nname = \"a\"\n\n[dynamics]\ninertia_kg_m = 1.0\n\
             damping_n_s_per_rad = 1.0\nstiffness_n_per_rad_n = 2.0\nexponent = {exponent:?}\n\
             input_gain_n_per_kpa = 1.0\n\n[fit]\nfree = [{free}]\n"
        )
    }

    const FREE: &str = "\"damping\", \"stiffness\", \"input_gain\"";

    /// A case with two recordings, the second with metadata, in a folder of its own.
    fn case(test: &str, free: &str) -> (PathBuf, Case) {
        let name = format!("softrig-pose-{test}-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        write(&folder.join("case/model.toml"), &model(free, 1.0)).unwrap();
        let mut text = String::from("time_s,pressure_kpa,angle_deg\n");
        for k in 0..40 {
            text += &format!("{}.0,{},{}\n", k, 2 * k, 3 * k);
        }
        for name in ["a.csv", "b.csv"] {
            write(&folder.join("case/recordings").join(name), &text).unwrap();
        }
        let meta = "samples = 40\nprotocol = \"steps\"\n";
        write(&folder.join("case/recordings/b.meta.toml"), meta).unwrap();
        let case = Case::read(&folder.join("case"), None).unwrap();
        (folder, case)
    }

    fn never(_: &[PathBuf], _: &Path) -> Result<(), String> {
        panic!("no first model is asked for")
    }

    fn asked(case: &Case, way: Way, folder: &Path) -> Question {
        match pose(case, way, &folder.join(way.name()), &never).unwrap() {
            Posed::Question(question) => *question,
            Posed::LeftOut(why) => panic!("{way:?}: {why}"),
        }
    }

    #[test]
    fn what_a_way_does_not_change_is_asked_as_it_stands() {
        let (folder, case) = case("same", FREE);
        let plain = asked(&case, Way::Plain, &folder);
        assert_eq!((plain.seed, &plain.model), (1, &case.model));
        assert_eq!(
            asked(&case, Way::Seed, &folder),
            Question {
                seed: 2,
                ..plain.clone()
            }
        );
        let order = asked(&case, Way::Order, &folder);
        assert_eq!(
            order.recordings,
            [&plain.recordings[1], &plain.recordings[0]].map(Clone::clone)
        );
        let wrong = asked(&case, Way::Times3, &folder);
        assert_eq!(wrong.recordings, plain.recordings);
        assert_ne!(wrong.model, plain.model);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn changed_recordings_take_their_metadata_along() {
        let (folder, case) = case("meta", FREE);
        let half = asked(&case, Way::Half, &folder);
        assert_eq!(half.model, case.model);
        let (recording, warnings) = Recording::read(&half.recordings[1]).unwrap();
        assert_eq!(warnings, [""; 0]);
        assert_eq!((recording.len(), recording.meta.samples), (20, Some(20)));
        assert_eq!(recording.meta.protocol.as_deref(), Some("steps"));
        let units = asked(&case, Way::Units, &folder);
        assert_eq!(units.units, Way::Units.units());
        assert!(meta_beside(&units.recordings[1]).exists());
        assert!(!meta_beside(&units.recordings[0]).exists());
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_first_model_of_another_structure_is_left_out() {
        let (folder, driven) = case("init", FREE);
        let posed = |text: Result<String, String>| {
            let write = |recordings: &[PathBuf], path: &Path| {
                assert_eq!(recordings, driven.recordings);
                write(path, &text.clone()?)
            };
            pose(&driven, Way::Init, &folder.join("init"), &write).unwrap()
        };
        for (text, part) in [
            (
                Ok(model(&format!("{FREE}, \"exponent\""), 1.0)),
                "frees exponent",
            ),
            (
                Ok(model("\"damping\", \"stiffness\"", 1.0)),
                "does not free input_gain",
            ),
            (Ok(model(FREE, 2.0)), "exponent at 2"),
            (Err("refused".into()), "softrig init: refused"),
        ] {
            match posed(text) {
                Posed::LeftOut(why) => assert!(why.contains(part), "{why}"),
                Posed::Question(_) => panic!("{part}: asked"),
            }
        }
        let Posed::Question(question) = posed(Ok(model(FREE, 1.0))) else {
            panic!("left out")
        };
        assert_eq!(question.model, folder.join("init/model.toml"));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn what_would_be_the_plain_question_again_is_left_out() {
        let (folder, mut swing) = case("left", "\"damping\", \"stiffness\"");
        swing.recordings.truncate(1);
        for (way, part) in [(Way::Order, "one order"), (Way::Init, "free swing")] {
            match pose(&swing, way, &folder.join("out"), &never).unwrap() {
                Posed::LeftOut(why) => assert!(why.contains(part), "{why}"),
                Posed::Question(_) => panic!("{way:?} asked"),
            }
        }
        fs::remove_dir_all(folder).unwrap();
    }
}
