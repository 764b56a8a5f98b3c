//! Exported models against the library: every effect, in every language that can be run here.
//!
//! `cargo xtask test` sees to it that a C compiler and Python are there and sets
//! `SOFTRIG_EXPORT_TOOLS`; without it a missing program is said and skipped. GNU Octave
//! stands in for MATLAB where it is installed.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use model_core::{catalogue::Kind, integrate::Scheme};
use softrig::sim::simulate::{Grain, InitialState, Origin, Signal, Stepping, run_from};
use softrig::synth::example::{Hidden, make};
use softrig_export::{Defaults, Language, export};
use softrig_formats::model_file::ModelFile;
use tempfile::TempDir;

/// Set where a missing program is a failure.
const REQUIRED: &str = "SOFTRIG_EXPORT_TOOLS";

/// Python without what the user's surroundings add to it.
const ISOLATED: &str = "-I";

/// How far an exported run may be from the library's, absolute in degrees and relative.
const NEAR: f64 = 1e-9;

/// A pressure (kPa) at some times (s), and how a run over it starts.
struct Recorded {
    time: Vec<f64>,
    pressure_kpa: Vec<f64>,
    defaults: Defaults,
}

impl Recorded {
    /// Edges, a fast sine and slow ramps, sampled at 100 Hz with a gap; from rest.
    fn fast_and_slow() -> Self {
        let time: Vec<f64> = (0..900)
            .filter(|k| !(300..330).contains(k))
            .map(|k| f64::from(k) * 0.01)
            .collect();
        let pressure = |t: f64| match t {
            ..1.0 => 0.0,
            1.0..3.0 => 55.0,
            3.0..5.0 => 40.0 + 25.0 * (t * 21.0).sin(),
            5.0..7.0 => 30.0 - 10.0 * (t - 5.0),
            7.0..8.0 => 70.0,
            _ => 4.0,
        };
        Self {
            pressure_kpa: time.iter().map(|&t| pressure(t)).collect(),
            time,
            defaults: Defaults::default(),
        }
    }

    /// Sampled at 20 Hz and not quite evenly, so that intervals are divided; in motion, with
    /// sensors that have zeros.
    fn coarse_in_motion() -> Self {
        let time: Vec<f64> = (0..300)
            .map(|k| 0.05 * f64::from(k) + 0.004 * f64::from(k * k % 7))
            .collect();
        let pressure = |t: &f64| 30.0 + 28.0 * (1.3 * t).sin() + 12.0 * (5.1 * t).cos();
        Self {
            pressure_kpa: time.iter().map(pressure).collect(),
            time,
            defaults: Defaults {
                start_deg: Some(11.0),
                start_deg_per_s: 7.0,
                pressure_zero_kpa: 0.4,
                angle_zero_deg: -1.3,
                largest_angle_deg: 100.0,
            },
        }
    }

    fn csv(&self) -> String {
        let rows = self.time.iter().zip(&self.pressure_kpa);
        let rows = rows.map(|(time, pressure)| format!("{time:?},{pressure:?}\n"));
        "time_s,pressure_kpa\n".to_owned() + &rows.collect::<String>()
    }

    fn stepping(&self, file: &ModelFile) -> Stepping {
        let mut steps: Vec<f64> = self.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        let half = steps.len() / 2;
        let usual = if steps.len() % 2 == 1 {
            steps[half]
        } else {
            f64::midpoint(steps[half - 1], steps[half])
        };
        let reach = self.defaults.largest_angle_deg.to_radians();
        Stepping::of(&file.model, usual, reach, Grain::Fine)
    }

    /// What the library simulates (°).
    fn expected(&self, file: &ModelFile) -> Vec<f64> {
        let model = &file.model;
        let defaults = self.defaults;
        let shown = defaults.start_deg.map_or_else(
            || model.reading(&model.at_rest(0.0, 0.0)),
            |start| (start - defaults.angle_zero_deg).to_radians(),
        );
        let pressure = self.pressure_kpa.iter().map(|kpa| 1000.0 * kpa).collect();
        let origin = Origin {
            start: InitialState {
                angle: shown,
                rate: defaults.start_deg_per_s.to_radians(),
            },
            past: 0.0,
            stretched: 0.0,
            pressure_zero: 1000.0 * defaults.pressure_zero_kpa,
            clock: 0.0,
        };
        let signal = Signal::new(self.time.clone(), pressure);
        run_from(model, &signal, origin, self.stepping(file))
            .reading
            .into_iter()
            .map(|angle| angle.to_degrees() + defaults.angle_zero_deg)
            .collect()
    }
}

/// The base model with other effects: sections of a model file.
fn with_effects(damping: f64, effects: &str) -> String {
    format!(
        "schema = 1\nname = \"trial\"\n[dynamics]\ninertia_kg_m = 0.3\n\
         damping_n_s_per_rad = {damping:?}\nstiffness_n_per_rad_n = 6.0\nexponent = 1.727\n\
         input_gain_n_per_kpa = 0.12\n{effects}"
    )
}

/// Every effect as `softrig example` draws it, tables of each variable, and what effects do to
/// each other.
#[allow(clippy::too_many_lines)] // A table.
fn models() -> Vec<(String, ModelFile)> {
    const EFFECTS: [(&str, f64, &str); 16] = [
        ("base", 0.9, ""),
        ("overdamped", 40.0, ""),
        ("undamped", 0.0, ""),
        (
            "table of the angle",
            0.9,
            "[[effect]]\nkind = \"table\"\nof = \"angle\"\nnodes = [0.1, 0.5, 0.9, 1.6]\n\
             forces_n = [0.0, 0.4, -0.3, 0.2]\n",
        ),
        (
            "table of the rate",
            0.9,
            "[[effect]]\nkind = \"table\"\nof = \"rate\"\n\
             nodes = [-3.0, -1.0, -0.4, -0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0, 3.0]\n\
             forces_n = [-0.5, -0.4, -0.35, -0.3, -0.28, -0.26, -0.25, 0.25, 0.26, 0.28, 0.3, 0.35, 0.4, 0.5]\n",
        ),
        (
            "table of the pressure",
            0.9,
            "[[effect]]\nkind = \"table\"\nof = \"pressure\"\nnodes = [5.0, 20.0, 50.0]\n\
             forces_n = [0.0, 0.4, 0.1]\n",
        ),
        (
            "table of the time, late and lagging",
            0.9,
            "[[effect]]\nkind = \"dead_time\"\ndelay_s = 0.123\n\
             [[effect]]\nkind = \"table\"\nof = \"time\"\nnodes = [1.0, 2.0]\nforces_n = [0.0, 0.4]\n\
             [[effect]]\nkind = \"pneumatic_lag\"\ntime_constant_s = 0.1\n",
        ),
        (
            "two frictions and a play",
            0.9,
            "[[effect]]\nkind = \"coulomb_friction\"\nforce_n = 0.2\n\
             [[effect]]\nkind = \"input_backlash\"\nhalf_width_kpa = 3.0\n\
             [[effect]]\nkind = \"stribeck_friction\"\nforce_n = 0.1\nextra_force_n = 0.2\n\
             stribeck_rad_per_s = 0.1\n",
        ),
        (
            "friction in an overdamped one",
            400.0,
            "[[effect]]\nkind = \"coulomb_friction\"\nforce_n = 0.4\n",
        ),
        (
            "three that are integrated",
            0.9,
            "[[effect]]\nkind = \"maxwell_branch\"\nstiffness_n_per_rad = 0.8\ntime_constant_s = 0.7\n\
             [[effect]]\nkind = \"pneumatic_lag\"\ntime_constant_s = 0.4\n\
             [[effect]]\nkind = \"sensor_lag\"\ntime_constant_s = 0.1\n",
        ),
        (
            "parameters that change together",
            0.9,
            "[[effect]]\nkind = \"mullins_softening\"\nloss = 0.3\nangle_rad = 0.8\n\
             [[effect]]\nkind = \"pressure_stiffening\"\nper_kpa = 0.004\n\
             [[effect]]\nkind = \"asymmetric_damping\"\nratio = 0.7\n",
        ),
        (
            "a formula with smooth functions",
            0.9,
            "[[effect]]\nkind = \"custom\"\nname = \"smooth\"\n\
             force = \"a*tanh(w/b)*(1 + c*p) + a*exp(-t/3)*sqrt(abs(th) + 0.01) + c*log(1 + th^2)*cos(3*th)\"\n\
             parameters = { a = 0.2, b = { value = 0.3, unit = \"rad/s\" }, c = 0.01 }\n",
        ),
        (
            "a formula with powers and choices",
            0.9,
            "[[effect]]\nkind = \"custom\"\nname = \"crooked\"\n\
             force = \"a*sign(th)*abs(th)^n + a*th^3 + a*max(0, th - 0.5)^1.5 + a*min(p, 20)/20 + a/(1 + th^2)^2 + a*sin(2*t)*tan(th/9) + a*pow(p_kpa + abs(w), 0.7)\"\n\
             parameters = { a = 0.1, n = 1.5, p_kpa = 2.0 }\n",
        ),
        (
            "two formulas beside a friction",
            0.9,
            "[[effect]]\nkind = \"custom\"\nname = \"one\"\nforce = \"a*sqrt(t + 1)*th\"\nparameters = { a = 0.3 }\n\
             [[effect]]\nkind = \"coulomb_friction\"\nforce_n = 0.2\n\
             [[effect]]\nkind = \"custom\"\nname = \"two\"\nforce = \"a*th*abs(th) + a*exp(-abs(p)/20)\"\nparameters = { a = 0.4 }\n",
        ),
        (
            "formulas with memories",
            0.9,
            "[[effect]]\nkind = \"custom\"\nname = \"past\"\n\
             force = \"a*(th^3 - z) + b*heat*tanh(w/0.3)\"\n\
             memory = { z = { follows = \"th^3\", time_constant = \"tau\" }, \
             heat = { follows = \"max(p, 0)*abs(w)\", time_constant = \"slow\" } }\n\
             parameters = { a = 0.4, b = 0.004, tau = { value = 0.6, min = 0.01 }, slow = { value = 3.0, min = 0.1 } }\n\
             [[effect]]\nkind = \"custom\"\nname = \"drive\"\nforce = \"a*(p - z)\"\n\
             memory = { z = { follows = \"p\", time_constant = \"tau\" } }\n\
             parameters = { a = 0.002, tau = { value = 1.5, min = 0.01 } }\n",
        ),
        (
            "a bent sensor behind a lag behind an offset",
            0.9,
            "[[effect]]\nkind = \"sensor_offset\"\noffset_rad = 0.05\n\
             [[effect]]\nkind = \"sensor_lag\"\ntime_constant_s = 0.2\n\
             [[effect]]\nkind = \"sensor_nonlinearity\"\ncurvature_per_rad = 0.1\n",
        ),
    ];
    let drawn = Kind::NAMES.iter().map(|&kind| {
        let truth = make(Hidden::Effect(kind), 0.0, 5).unwrap().truth;
        (kind.name().to_owned(), truth)
    });
    let written = EFFECTS
        .iter()
        .map(|(name, damping, effects)| ((*name).to_owned(), with_effects(*damping, effects)));
    drawn
        .chain(written)
        .map(|(name, text)| {
            let file = ModelFile::parse(&text, Path::new("m.toml"));
            let file = file.unwrap_or_else(|error| panic!("{name}: {error}"));
            (name, file)
        })
        .collect()
}

/// A program on the search path, or why its test is skipped.
fn program(name: &str, is_required: bool) -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    let found = env::split_paths(&path)
        .map(|folder| folder.join(name))
        .find(|program| program.is_file());
    if found.is_none() {
        assert!(
            !is_required || env::var_os(REQUIRED).is_none(),
            "{name} is not on the search path, and {REQUIRED} is set: run `cargo xtask setup`"
        );
        eprintln!("SKIPPED: {name} is not on the search path");
    }
    found
}

/// What a command prints, which has to succeed.
fn output(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{command:?}: {}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// The angles in a table of times and angles.
fn angles(csv: &str) -> Vec<f64> {
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("time_s,angle_deg"));
    lines
        .map(|line| line.split_once(',').unwrap().1.parse().unwrap())
        .collect()
}

/// The start of a run as arguments.
fn flags(defaults: &Defaults) -> Vec<String> {
    let start = defaults.start_deg.map(|start| ("--start-deg", start));
    let others = [
        ("--start-deg-per-s", defaults.start_deg_per_s),
        ("--pressure-zero-kpa", defaults.pressure_zero_kpa),
        ("--angle-zero-deg", defaults.angle_zero_deg),
        ("--largest-angle-deg", defaults.largest_angle_deg),
    ];
    start
        .into_iter()
        .chain(others)
        .flat_map(|(name, value)| [name.to_owned(), format!("{value:?}")])
        .collect()
}

/// Runs every model over every recording, and says all that is wrong.
fn compare(language: Language, run: impl Fn(&TempDir, &str, &Recorded) -> Vec<f64>) {
    let recorded = [Recorded::fast_and_slow(), Recorded::coarse_in_motion()];
    let mut wrong = Vec::new();
    for (name, file) in models() {
        for (which, recorded) in recorded.iter().enumerate() {
            let folder = tempfile::tempdir().unwrap();
            let code = export(&file, language, "exported", Defaults::default()).unwrap();
            fs::write(folder.path().join("run.csv"), recorded.csv()).unwrap();
            let found = run(&folder, &code, recorded);
            let expected = recorded.expected(&file);
            assert_eq!(found.len(), expected.len(), "{name}");
            let moved = expected.iter().fold(0.0, |most: f64, a| most.max(a.abs()));
            assert!((1.0..1000.0).contains(&moved), "{name} moves by {moved}°");
            let worst = found
                .iter()
                .zip(&expected)
                .map(|(a, b)| (a - b).abs() / b.abs().max(1.0))
                .fold(0.0, f64::max);
            if worst.is_nan() || worst > NEAR {
                wrong.push(format!("{name}, recording {which}: off by {worst:e}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_trials_reach_every_way_of_stepping() {
    let recorded = Recorded::coarse_in_motion();
    let all: Vec<Stepping> = models()
        .iter()
        .map(|(_, file)| recorded.stepping(file))
        .collect();
    for scheme in [Scheme::Rk4, Scheme::ExponentialHeun] {
        let with_friction = |is: bool| {
            all.iter()
                .filter(|stepping| stepping.scheme == scheme)
                .any(|stepping| stepping.friction.is_some() == is && (!is || stepping.substeps > 4))
        };
        assert!(with_friction(false) && with_friction(true), "{scheme:?}");
    }
}

#[test]
fn c_repeats_the_library() {
    let Some(cc) = program("cc", true) else {
        return;
    };
    compare(Language::C, |folder, code, recorded| {
        fs::write(folder.path().join("exported.c"), code).unwrap();
        let warnings = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"];
        output(Command::new(&cc).current_dir(folder).args(warnings).args([
            "-O1",
            "-DSOFTRIG_MAIN",
            "exported.c",
            "-lm",
            "-o",
            "exported",
        ]));
        let mut command = Command::new(folder.path().join("exported"));
        let csv = output(
            command
                .current_dir(folder)
                .arg("run.csv")
                .args(flags(&recorded.defaults)),
        );
        angles(&csv)
    });
}

#[test]
fn python_repeats_the_library() {
    let Some(python) = program("python3", true) else {
        return;
    };
    compare(Language::Python, |folder, code, recorded| {
        fs::write(folder.path().join("exported.py"), code).unwrap();
        let csv = output(
            Command::new(&python)
                .current_dir(folder)
                .args([ISOLATED, "exported.py", "run.csv"])
                .args(flags(&recorded.defaults)),
        );
        angles(&csv)
    });
}

#[test]
fn matlab_code_repeats_the_library_in_octave() {
    let Some(octave) = program("octave-cli", false) else {
        return;
    };
    compare(Language::Matlab, |folder, code, recorded| {
        fs::write(folder.path().join("exported.m"), code).unwrap();
        let flags = flags(&recorded.defaults);
        let options: Vec<String> = flags
            .chunks(2)
            .map(|pair| format!("'{}', {}", pair[0][2..].replace('-', "_"), pair[1]))
            .collect();
        let text = output(Command::new(&octave).current_dir(folder).args([
            "--quiet",
            "--norc",
            "--eval",
            &format!(
                "run = dlmread('run.csv', ',', 1, 0); \
                 printf('%.17g\\n', exported(run(:, 1), run(:, 2), struct({})));",
                options.join(", ")
            ),
        ]));
        text.lines().map(|line| line.parse().unwrap()).collect()
    });
}

/// A controller calls it interval by interval. Under a held pressure that is a recording of a
/// held pressure.
#[test]
fn c_goes_step_by_step() {
    const CONTROLLER: &str = "
        #include \"exported.c\"
        #include <stdio.h>
        int main(void)
        {
            softrig model;
            int k;
            softrig_init(&model, 0.01, 4.0, 42.0);
            printf(\"time_s,angle_deg\\n0,4.0\\n\");
            for (k = 1; k < 400; k++) {
                printf(\"0,%.17g\\n\", STEP(&model, 42.0));
            }
            return 0;
        }";
    let Some(cc) = program("cc", true) else {
        return;
    };
    let recorded = Recorded {
        time: (0..400).map(|k| f64::from(k) * 0.01).collect(),
        pressure_kpa: vec![42.0; 400],
        defaults: Defaults {
            start_deg: Some(4.0),
            ..Defaults::default()
        },
    };
    for (name, file) in models() {
        let folder = tempfile::tempdir().unwrap();
        let code = export(&file, Language::C, "exported", Defaults::default()).unwrap();
        // Who calls it has to know of a dead time.
        let is_late = code.contains("dead_time");
        assert_eq!(code.contains("softrig_step_delayed("), is_late, "{name}");
        let step = if is_late {
            "softrig_step_delayed"
        } else {
            "softrig_step"
        };
        fs::write(folder.path().join("exported.c"), code).unwrap();
        fs::write(
            folder.path().join("controller.c"),
            CONTROLLER.replace("STEP", step),
        )
        .unwrap();
        output(Command::new(&cc).current_dir(&folder).args([
            "-std=c99",
            "-Wall",
            "-Werror",
            "controller.c",
            "-lm",
            "-o",
            "controller",
        ]));
        let found = angles(&output(&mut Command::new(folder.path().join("controller"))));
        for (found, expected) in found.iter().zip(recorded.expected(&file)).skip(1) {
            // The times of a recording are rounded.
            let error = (found - expected).abs();
            assert!(error < 1e-7 * expected.abs().max(1.0), "{name}: {error:e}");
        }
    }
}

/// A name is whatever is in a file, and a comment has an end.
#[test]
fn names_do_not_leave_their_comments() {
    let name = r#"*/ #error \n\" \u0007 \u202e end; """ ??/ %} {{ name }} \\"#;
    let text = with_effects(0.9, "").replace("\"trial\"", &format!("\"{name}\""));
    let text = text.replace(r#"""""#, r#"\"\"\""#);
    let file = ModelFile::parse(&text, Path::new("m.toml")).unwrap();
    assert!(file.name.contains('\n') && file.name.contains("\"\"\""));
    let recorded = Recorded::coarse_in_motion();
    for language in Language::ALL {
        let code = export(&file, language, "exported", Defaults::default()).unwrap();
        assert!(!code.contains(['\u{7}', '\u{202e}']), "{language:?}");
        let ends_a_comment = language == Language::C && code.contains("*/ #error");
        assert!(!ends_a_comment);
        let folder = tempfile::tempdir().unwrap();
        let path = folder
            .path()
            .join(format!("exported.{}", language.extension()));
        fs::write(&path, &code).unwrap();
        fs::write(folder.path().join("run.csv"), recorded.csv()).unwrap();
        match language {
            Language::C => {
                let Some(cc) = program("cc", true) else {
                    continue;
                };
                let arguments = ["-std=c99", "-Wall", "-Werror", "-c", "exported.c"];
                output(Command::new(cc).current_dir(&folder).args(arguments));
            }
            Language::Python => {
                let Some(python) = program("python3", true) else {
                    continue;
                };
                let arguments = [ISOLATED, "exported.py", "run.csv"];
                output(Command::new(python).current_dir(&folder).args(arguments));
            }
            Language::Matlab => {
                let Some(octave) = program("octave-cli", false) else {
                    continue;
                };
                let arguments = ["--quiet", "--norc", "--eval", "exported(0:2, [1, 2, 3])"];
                output(Command::new(octave).current_dir(&folder).args(arguments));
            }
            Language::Modelica => {}
        }
    }
}

/// Bad recordings end in a sentence and an exit code, not in numbers.
#[test]
fn programs_refuse_what_is_no_recording() {
    let (_, file) = models().swap_remove(0);
    let folder = tempfile::tempdir().unwrap();
    let mut programs: Vec<Command> = Vec::new();
    if let Some(cc) = program("cc", true) {
        let code = export(&file, Language::C, "exported", Defaults::default()).unwrap();
        fs::write(folder.path().join("exported.c"), code).unwrap();
        let arguments = [
            "-std=c99",
            "-DSOFTRIG_MAIN",
            "exported.c",
            "-lm",
            "-o",
            "exported",
        ];
        output(Command::new(cc).current_dir(&folder).args(arguments));
        programs.push(Command::new(folder.path().join("exported")));
    }
    if let Some(python) = program("python3", true) {
        let code = export(&file, Language::Python, "exported", Defaults::default()).unwrap();
        fs::write(folder.path().join("exported.py"), code).unwrap();
        let mut command = Command::new(python);
        command.arg(ISOLATED).arg(folder.path().join("exported.py"));
        programs.push(command);
    }
    let path = folder.path().join("bad.csv");
    for mut program in programs {
        program.arg(&path);
        for bad in [
            "time_s,angle_deg\n0,1\n",
            "time_s,pressure_kpa\n0,1\n0,2\n",
            "time_s,pressure_kpa\n0,1\n1,nan\n",
            "time_s,pressure_kpa\n0,1\n1,\n",
            "time_s,pressure_kpa\n0,1\n1\n",
            "time_s,pressure_kpa\n0,1\n1,two\n",
        ] {
            fs::write(&path, bad).unwrap();
            let done = program.output().unwrap();
            assert!(!done.status.success(), "{bad}");
            assert!(done.stdout.is_empty(), "{bad}");
            let said = String::from_utf8(done.stderr).unwrap();
            assert_eq!(said.lines().count(), 1, "{bad}: {said}");
        }
        fs::write(&path, "time_s,pressure_kpa\n").unwrap();
        assert_eq!(output(&mut program), "time_s,angle_deg\n");
    }
}
