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

use crate::sim::simulate::FromF64;

/// How the rig stood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// By how much the base was turned since the angle was zeroed (rad).
    pub turned_rad: f64,
    /// What hung at the tip (kg).
    pub load_kg: f64,
    /// Length of the tube to the actuator, in lengths of the one that the model is written for.
    pub tube: f64,
}

impl Placement {
    /// As the model is written.
    pub const USUAL: Self = Self {
        turned_rad: 0.0,
        load_kg: 0.0,
        tube: 1.0,
    };

    /// What `setup` says, where the model is written for a tube of `tube_mm`; what it does not
    /// say is as the model is written.
    pub fn of(setup: &Setup, tube_mm: Option<f64>) -> Self {
        let tube = setup.tube_mm.zip(tube_mm.filter(|&it| it > 0.0));
        Self {
            turned_rad: setup.turned_rad(),
            load_kg: setup.tip_load_g.map_or(0.0, |grams| grams / 1000.0),
            tube: tube.map_or(1.0, |(here, usual)| here / usual),
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
