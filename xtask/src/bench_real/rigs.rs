//! The real rigs: recordings, authors, and their statements about the physics.

/// A rig that others recorded.
#[derive(Debug)]
pub struct Rig {
    /// Its folder.
    pub name: &'static str,
    /// Heading of its section.
    pub title: &'static str,
    /// Whether little or nothing is missing, so that a name is an error.
    pub is_control: bool,
    /// Known or published facts about the missing physics, for the table.
    pub known: &'static str,
    /// The quantity in the column `angle_deg`, as the label of an axis.
    pub quantity: &'static str,
    /// The recorded rig, and its authors' description of the physics.
    pub about: &'static str,
    /// Authors and the source with its commit.
    pub source: &'static str,
    /// Link to the source.
    pub link: &'static str,
    /// Its licence.
    pub licence: &'static str,
    /// Which recordings are fitted.
    pub split: Split,
}

/// Which recordings are fitted, and which validate.
#[derive(Debug)]
pub enum Split {
    /// Fitted files in `recordings/`, held-out files in `holdout/`.
    Folders,
    /// Files in `recordings/` by the start of their names.
    Names {
        /// Fitted.
        fit: &'static [&'static str],
        /// For validation.
        holdout: &'static [&'static str],
    },
}

/// All of them, controls last.
pub const RIGS: [Rig; 8] = [
    Rig {
        name: "pendulum",
        title: "Pendulum",
        is_control: false,
        known: "gravity, with dry friction and drag",
        quantity: "angle (°)",
        about: "One decay of a freely swinging arm, cut into six recordings that start with \
                unknown angle and rate. The model has a linear spring where gravity's sine \
                belongs; beside viscous damping there is some dry friction and air drag.",
        source: "dynamicslab/MultiArm-Pendulum @ e99a7e13 (arXiv 2205.06231)",
        link: "https://github.com/dynamicslab/MultiArm-Pendulum",
        licence: "MIT",
        split: Split::Names {
            fit: &["id_"],
            holdout: &["vad_"],
        },
    },
    Rig {
        name: "silverbox",
        title: "Silverbox",
        is_control: false,
        known: "cubic spring",
        quantity: "voltage (10 mV)",
        about: "An electronic circuit that behaves like a mass on a hardening spring, driven by \
                multisines. It is a benchmark of nonlinear system identification; the literature \
                agrees on a cubic spring.",
        source: "data by T. Wigren and J. Schoukens (European Control Conference 2013), from \
                 biaslab/nsi-silverbox @ 728f07e4",
        link: "https://github.com/biaslab/nsi-silverbox",
        licence: "MIT",
        split: Split::Names {
            fit: &["multisine_1", "multisine_2"],
            holdout: &["multisine_3"],
        },
    },
    Rig {
        name: "torque_pendulum",
        title: "Torque-limited pendulum",
        is_control: false,
        known: "gravity and Coulomb friction",
        quantity: "angle (°)",
        about: "A pendulum on a motor, swung by six controllers; only the seconds before it comes \
                near the upright position. The authors identified gravity as a sine, viscous and \
                Coulomb friction, and an offset of the torque. The recorded torque does not \
                agree in scale with their numbers, and the sampling rates differ tenfold.",
        source: "F. Wiebe et al., DFKI, Torque-limited simple pendulum (Journal of Open Source \
                 Software 2022), dfki-ric-underactuated-lab/torque_limited_simple_pendulum \
                 @ ed17ea2d",
        link: "https://github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
        licence: "BSD 3-Clause",
        split: Split::Folders,
    },
    Rig {
        name: "hydraulic_motor",
        title: "Hydraulic motor",
        is_control: false,
        known: "a static curve (plausible)",
        quantity: "speed (× 10)",
        about: "Valve current to speed, on a teaching bench. The author uses it as a nonlinear \
                example for sparse regression with polynomials. Speed over current is a curve, \
                which a cubic spring or another exponent would draw; the way up differs a little \
                from the way down. Nobody has published which effect it is.",
        source: "D. Mårtensson, MataveID @ 4a12ff21",
        link: "https://github.com/DanielMartensson/MataveID",
        licence: "MIT",
        split: Split::Folders,
    },
    Rig {
        name: "hanging_load",
        title: "Hanging load on a hydraulic cylinder",
        is_control: false,
        known: "creep, or up and down differ (plausible)",
        quantity: "position (× 10)",
        about: "A pump lifts the load and its weight lowers it, under proportional control. The \
                author fits one first-order model for the way up and another for the way down. \
                A slow tail after each step downwards looks like creep. Nobody has published a \
                second-order model.",
        source: "D. Mårtensson, MataveID @ 4a12ff21",
        link: "https://github.com/DanielMartensson/MataveID",
        licence: "MIT",
        split: Split::Folders,
    },
    Rig {
        name: "hydraulic_cylinder",
        title: "Hydraulic cylinder in a position loop",
        is_control: true,
        known: "little",
        quantity: "position (× 10)",
        about: "Reference to position, four parts of a minute each. The author identifies it with \
                a linear subspace method and calls it linear.",
        source: "D. Mårtensson, MataveID @ 4a12ff21",
        link: "https://github.com/DanielMartensson/MataveID",
        licence: "MIT",
        split: Split::Folders,
    },
    Rig {
        name: "soft_chamber_pump",
        title: "Pump and soft chamber",
        is_control: true,
        known: "nothing",
        quantity: "pressure (kPa)",
        about: "Duty cycle of a pump to the pressure in a soft pneumatic chamber, under five \
                controllers. The pump fills the chamber and is at full drive most of the time, \
                so that little could be seen of a nonlinearity. The author has no model.",
        source: "D. G. Sanchez Moreno, SoftBot Lab Platform, \
                 DiegoSanMo6011/softbot_pneumatic_driver @ a7194441",
        link: "https://github.com/DiegoSanMo6011/softbot_pneumatic_driver",
        licence: "MIT",
        split: Split::Folders,
    },
    Rig {
        name: "falling_bowling_ball",
        title: "Falling bowling ball",
        is_control: true,
        known: "nothing",
        quantity: "fallen height (0.1 m)",
        about: "Two drops of the heaviest ball of the study, by video at 15 Hz. Over 35 m its \
                drag is too small to be seen. Two seconds of one drop are all that is fitted.",
        source: "B. M. de Silva et al. (Frontiers in Artificial Intelligence 3, 2020), \
                 briandesilva/discovery-of-physics-from-data @ b79c3431",
        link: "https://github.com/briandesilva/discovery-of-physics-from-data",
        licence: "MIT",
        split: Split::Folders,
    },
];
