//! How the rig stood in a session, and what that does to the model of the actuator.
//!
//! Everything else is shared between sessions. A session of which nothing is said stands as the
//! model is written, and is simulated with it to the bit.

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::{Effect, Kind};
use model_core::power::Power;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;
use softrig_formats::setup::Setup;

use crate::sim::dual::FromF64;

/// How the rig stood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// By how much the base was turned since the angle was zeroed (rad).
    pub turned_rad: f64,
    /// What hung at the tip (kg).
    pub load_kg: f64,
    /// Length of the tube to the actuator, in lengths of the one that the model is written for.
    pub tube: f64,
    /// How far the actuator was bent before (rad), where that is known: a person says that it has
    /// rested since, so that what creeps has settled and what is lost by the first stretch is not
    /// (Mullins). A new actuator was never bent.
    pub stretched_rad: f64,
}

impl Placement {
    /// As the model is written.
    pub const USUAL: Self = Self {
        turned_rad: 0.0,
        load_kg: 0.0,
        tube: 1.0,
        stretched_rad: 0.0,
    };

    /// What `setup` says, where the model is written for a tube of `tube_mm`; what it does not
    /// say is as the model is written.
    pub fn of(setup: &Setup, tube_mm: Option<f64>) -> Self {
        let tube = setup.tube_mm.zip(tube_mm.filter(|&it| it > 0.0));
        Self {
            turned_rad: setup.turned_rad(),
            load_kg: setup.tip_load_g.map_or(0.0, |grams| grams / 1000.0),
            tube: tube.map_or(1.0, |(here, usual)| here / usual),
            ..Self::USUAL
        }
    }

    /// That of a recording, like [`Self::of`].
    pub fn of_recording(recording: &Recording, tube_mm: Option<f64>) -> Self {
        let setup = recording.meta.setup.as_ref();
        setup.map_or(Self::USUAL, |setup| Self::of(setup, tube_mm))
    }

    /// Whether an actuator without pressure may hang elsewhere than where its angle was zeroed.
    pub fn moves_the_rest(&self) -> bool {
        self.turned_rad != 0.0 || self.load_kg != 0.0
    }

    /// The model as the rig stood.
    #[must_use]
    pub fn place<R: FromF64, P: Power<R>>(&self, model: &Model<R, P>) -> Model<R, P> {
        let mut placed = *model;
        if self.load_kg != 0.0 {
            placed = placed.loaded(R::from_f64(self.load_kg));
        }
        if self.tube.to_bits() != Self::USUAL.tube.to_bits() {
            placed = placed.with_tube(R::from_f64(self.tube));
        }
        if self.turned_rad != 0.0 {
            placed = placed.turned(R::from_f64(self.turned_rad));
        }
        placed
    }

    /// An effect as the rig stood.
    #[must_use]
    pub fn place_effect(&self, effect: Effect<f64>) -> Effect<f64> {
        effect.with_tube(self.tube).turned(self.turned_rad)
    }
}

/// The same model file with what a load at the tip does to the model, to be estimated, where one
/// hung there in a recording. The file itself where it has that already, or no room for it.
#[must_use]
pub fn with_tip_load<'a>(
    mut file: ModelFile,
    recordings: impl IntoIterator<Item = &'a Recording>,
) -> ModelFile {
    let loads = |recording| Placement::of_recording(recording, None).load_kg != 0.0;
    let effects: Vec<Effect<f64>> = file.model.effects().collect();
    let has = effects.iter().any(|it| it.kind() == Kind::TipLoad);
    if has || effects.len() >= MAX_EFFECTS || !recordings.into_iter().any(loads) {
        return file;
    }
    let start = Kind::TipLoad.parameters().iter().map(|row| {
        let first = row.left_out().or_else(|| row.starts.first().copied());
        f64::from(first.unwrap_or_default())
    });
    let load = Kind::TipLoad.build(&start.collect::<Vec<f64>>());
    let slot = effects.len();
    let all: Vec<Effect<f64>> = effects.into_iter().chain(load).collect();
    if let Ok(model) = Model::new(*file.model.dynamics(), &all) {
        file.model = model;
        let rows = Kind::TipLoad.parameters().iter().enumerate();
        let to_find = rows.filter(|(_, row)| row.held.is_none());
        file.free
            .extend(to_find.map(|(parameter, _)| ParameterId::Effect { slot, parameter }));
    }
    file
}

/// What `setup` says of the rig without a law for it in the model: its key, what the model
/// lacks, and the advice.
pub fn without_law(
    setup: &Setup,
    file: &ModelFile,
) -> Option<(&'static str, &'static str, &'static str)> {
    if setup.tube_mm.is_some() && file.recording.setup.tube_mm.is_none() {
        return Some((
            "tube_mm",
            "the model does not say for which tube it is written",
            "add tube_mm below [recording.setup] in it, with the tube that it was fitted with",
        ));
    }
    let mut effects = file.model.effects();
    let knows_loads = effects.any(|effect| effect.kind() == Kind::TipLoad);
    let hangs = setup.tip_load_g.is_some_and(|grams| grams > 0.0);
    (hangs && !knows_loads).then_some((
        "tip_load_g",
        "the model does not say what a load does",
        "fit it to recordings with a load first: softrig fit adds [[effect]] kind = \"tip_load\"",
    ))
}

#[cfg(test)]
mod tests {
    use model_core::dynamics::Dynamics;
    use softrig_formats::recording::Meta;

    use super::*;
    use crate::estimate::{Dataset, Nuisance};

    fn model(effects: &[Effect<f64>]) -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.25,
            damping: 1.5,
            stiffness: 5.0,
            exponent: 1.7,
            input_gain: 1e-4,
        };
        Model::new(dynamics, effects).unwrap()
    }

    /// Up to a pressure and back, of a rig of which this is said.
    fn run(setup: &str, pressure_pa: f64) -> Recording {
        let time: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let pressure = time.iter().map(|t| pressure_pa * (1.5 * t).sin().powi(2));
        Recording {
            pressure: pressure.collect(),
            angle: vec![0.0; time.len()],
            time,
            meta: Meta {
                setup: Some(setup.parse().unwrap()),
                ..Meta::default()
            },
            ..Recording::default()
        }
    }

    /// The angles of a model in each of the recordings, which are given one after the other.
    fn angles(model: &Model<f64>, mut recordings: Vec<Recording>) -> Vec<Vec<f64>> {
        // How far it was bent is known from what was measured.
        for index in 0..recordings.len() {
            let data = Dataset::of(&recordings);
            let angle = data.sessions()[index].simulate(model, &Nuisance::AT_ZERO);
            recordings[index].angle = angle;
        }
        recordings.into_iter().map(|it| it.angle).collect()
    }

    #[test]
    fn what_the_first_stretch_took_stays_lost_over_a_rest_and_comes_back_with_a_new_actuator() {
        let mullins = Kind::MullinsSoftening.build(&[0.4, 0.5]).unwrap();
        let model = model(&[mullins]);
        let all = ["temperature_c=20", "rested_s=600", "new_part=actuator"];
        let found = angles(&model, all.map(|setup| run(setup, 5e4)).to_vec());
        assert_eq!(found[2], found[0]);
        let largest = |angles: &[f64]| angles.iter().copied().fold(0.0, f64::max);
        // To the same largest angle, and softer on the way there.
        assert!((largest(&found[1]) / largest(&found[0]) - 1.0).abs() < 0.05);
        let softer = found[1].iter().zip(&found[0]).skip(30).take(40);
        assert!(softer.clone().all(|(again, first)| again > first));
        // One that remembers nothing does not notice.
        let plain = angles(&self::model(&[]), all.map(|setup| run(setup, 5e4)).to_vec());
        assert_eq!(plain[1], plain[0]);
    }

    #[test]
    fn a_lag_of_the_air_is_as_long_as_its_tube() {
        let lag = |seconds: f64| model(&[Kind::PneumaticLag.build(&[seconds]).unwrap()]);
        let tubes = ["tube_mm=300", "tube_mm=900", "tilt_deg=0"];
        let found = angles(&lag(0.1), tubes.map(|setup| run(setup, 5e4)).to_vec());
        let three = angles(&lag(0.3), vec![run("tilt_deg=0", 5e4)]);
        assert_eq!(found[0], found[2]);
        for (one, other) in found[1].iter().zip(&three[0]) {
            assert!((one - other).abs() < 1e-6, "{one} {other}");
        }
    }

    #[test]
    fn only_recordings_with_a_load_ask_for_its_lever() {
        let text = "schema = 1\n[dynamics]\ninertia_kg_m = 0.25\ndamping_n_s_per_rad = 1.5\n\
            stiffness_n_per_rad_n = 5.0\nexponent = 1.7\ninput_gain_n_per_kpa = 0.1\n";
        let file = ModelFile::parse(text, std::path::Path::new("model.toml")).unwrap();
        let plain = with_tip_load(file.clone(), &[run("tilt_deg=90", 5e4)]);
        assert_eq!(plain.free, file.free);
        let loaded = with_tip_load(file.clone(), &[run("tip_load_g=20", 5e4)]);
        assert_eq!(loaded.free.len(), file.free.len() + 2);
        // What is written reads back, and does not grow.
        let text = loaded.text_with(&loaded.model, "");
        let again = ModelFile::parse(&text, std::path::Path::new("model.toml")).unwrap();
        let values = |file: &ModelFile| -> Vec<f64> {
            let effects = file.model.effects();
            effects
                .flat_map(|it| it.values().collect::<Vec<_>>())
                .collect()
        };
        let close = |(a, b): (f64, f64)| (a - b).abs() < 1e-6;
        assert!(values(&again).into_iter().zip(values(&loaded)).all(close));
        let twice = with_tip_load(again.clone(), &[run("tip_load_g=20", 5e4)]);
        assert_eq!(twice.model, again.model);
    }
}
