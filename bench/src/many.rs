//! How a diagnosis grows with the number of recordings.
//!
//! A lab that has measured for a year has a thousand runs of one rig. What one diagnosis of
//! all of them takes must grow with their number and not with its square. The recordings
//! are made here, with an integrator of their own: a fractional-power spring and a Maxwell
//! branch that the model file knows nothing of.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::asked::Asked;

const COUNTS: [usize; 6] = [10, 50, 100, 200, 500, 1000];
const SEED: u64 = 4;
const SECONDS: f64 = 10.0;
const RATE_HZ: f64 = 100.0;
/// Steps of the integrator between two samples.
const SUBSTEPS: usize = 20;
const NOISE_DEG: f64 = 0.1;

const INERTIA: f64 = 1e-3;
const DAMPING: f64 = 1e-2;
const STIFFNESS: f64 = 0.12;
const EXPONENT: f64 = 0.74;
const GAIN_N_PER_KPA: f64 = 5e-3;
const BRANCH_STIFFNESS: f64 = 0.04;
const RELAXATION_S: f64 = 1.5;

/// One diagnosis.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct Measured {
    pub recordings: usize,
    pub seconds: f64,
    /// Most memory in use; unknown where the system does not tell.
    pub megabytes: Option<f64>,
}

/// Diagnoses so many and so many recordings.
///
/// # Errors
///
/// If they cannot be written, or a diagnosis fails.
pub fn measure(asked: &Asked, folder: &Path) -> Result<Value, String> {
    let folder = asked.folder(folder);
    let model = folder.join("model.toml");
    let recordings = make(folder, &model)
        .map_err(|error| format!("cannot write to {}: {error}", folder.display()))?;
    let mut diagnoses = Vec::new();
    for count in COUNTS {
        eprintln!("{count} recordings");
        diagnoses.push(diagnose(&asked.rig, &model, &recordings[..count])?);
    }
    Ok(json!({ "benchmark": "many", "diagnoses": diagnoses }))
}

fn make(folder: &Path, model: &Path) -> std::io::Result<Vec<PathBuf>> {
    fs::create_dir_all(folder)?;
    let dynamics = format!(
        "schema = 1\nname = \"many recordings\"\n\n[dynamics]\n\
         inertia_kg_m = {INERTIA}\ndamping_n_s_per_rad = {DAMPING}\n\
         stiffness_n_per_rad_n = {STIFFNESS}\nexponent = {EXPONENT}\n\
         input_gain_n_per_kpa = {GAIN_N_PER_KPA}\n\n\
         [fit]\nfree = [\"damping\", \"stiffness\", \"input_gain\"]\n"
    );
    fs::write(model, dynamics)?;
    let mut random = Pcg32::seed_from_u64(SEED);
    let most = COUNTS.into_iter().max().unwrap_or(0);
    (0..most)
        .map(|index| {
            let path = folder.join(format!("run_{index:04}.csv"));
            fs::write(&path, recording(&mut random))?;
            Ok(path)
        })
        .collect()
}

/// A step of pressure and its release.
fn recording(random: &mut Pcg32) -> String {
    let plateau_kpa = random.random_range(5.0..25.0);
    let [on, off] = [random.random_range(0.5..1.5), random.random_range(5.0..8.0)];
    let noise = Normal::new(0.0, NOISE_DEG).expect("a standard deviation above zero");
    let step = 1.0 / (RATE_HZ * SUBSTEPS as f64);
    let [mut angle, mut rate, mut branch] = [0.0_f64; 3];
    let mut text = String::from("time_s,pressure_kpa,angle_deg\n");
    // In range: a thousand samples.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    for sample in 0..(SECONDS * RATE_HZ) as usize {
        let time = sample as f64 / RATE_HZ;
        let pressure = if (on..off).contains(&time) {
            plateau_kpa
        } else {
            0.0
        };
        let shown = angle.to_degrees() + noise.sample(random);
        // A string takes whatever is written to it.
        let _ = writeln!(text, "{time:.2},{pressure:.3},{shown:.3}");
        for _ in 0..SUBSTEPS {
            let force = GAIN_N_PER_KPA * pressure
                - DAMPING * rate
                - STIFFNESS * angle.signum() * angle.abs().powf(EXPONENT)
                - BRANCH_STIFFNESS * (angle - branch);
            rate += step * force / INERTIA;
            angle += step * rate;
            branch += step * (angle - branch) / RELAXATION_S;
        }
    }
    text
}

fn diagnose(rig: &Path, model: &Path, recordings: &[PathBuf]) -> Result<Measured, String> {
    const LOOK_AGAIN: Duration = Duration::from_millis(20);
    let failed = |error: String| format!("{} diagnose: {error}", rig.display());
    let clock = Instant::now();
    let mut child = Command::new(rig)
        .arg("diagnose")
        .arg("--model")
        .arg(model)
        .args(recordings)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| failed(error.to_string()))?;
    let mut megabytes = None;
    let status = loop {
        megabytes = most_memory(child.id()).or(megabytes);
        if let Some(status) = child
            .try_wait()
            .map_err(|error| failed(error.to_string()))?
        {
            break status;
        }
        thread::sleep(LOOK_AGAIN);
    };
    if status.success() {
        Ok(Measured {
            recordings: recordings.len(),
            seconds: clock.elapsed().as_secs_f64(),
            megabytes,
        })
    } else {
        Err(failed(status.to_string()))
    }
}

/// The most memory that a process has used so far (MB), where the system tells.
fn most_memory(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: f64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes / 1e3)
}
