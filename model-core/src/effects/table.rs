//! Table: Q is piecewise linear in one variable.
//!
//! It is a repair and no name: it says where the missing force lives and what shape it has, not
//! what makes it. So it is in the catalogue, but a search for causes leaves it out
//! ([`crate::catalogue::Kind::is_name`]).

use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit};
use crate::actuator::Model;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, RateLaw, Step};
use crate::real::Real;
use core::fmt;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "table",
    title: "table",
    place: Place::Force,
    equation: "Q = piecewise linear in one of θ, ω, p_c, t",
    text: "The missing force by numbers, where no formula describes it: its values at 2 to 16 \
           nodes of one variable, straight lines between them, constant beyond the ends. It \
           repairs a model without naming a cause; what a diagnosis names is the variable. A \
           jump is two nodes close to each other, such as ±0.02 rad/s for a friction that \
           changes its sign with the motion.",
    signature: "the variable that it is a table of",
    look_alikes: &[],
    family: Family::Other,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

/// The most nodes of a table.
pub const MAX_NODES: usize = 16;

/// The fewest nodes of a table: a straight line.
pub const MIN_NODES: usize = 2;

/// The parameter that is the force at the first node; those of the other nodes
/// follow.
pub const FIRST_FORCE: usize = 0;

macro_rules! forces {
    ($( $key:literal ),+) => {
        /// The parameter table: the force at each node that there can be. A table
        /// with fewer nodes has the first of them.
        pub const PARAMETERS: &[Parameter] = &[$(
            Parameter {
                key: $key,
                symbol: "Q",
                unit: Unit::Newton,
                lower: f32::NEG_INFINITY,
                upper: f32::INFINITY,
                held: None,
                default: None,
                starts: &[0.0],
            }
        ),+];
    };
}

forces!(
    "forces_n[0]",
    "forces_n[1]",
    "forces_n[2]",
    "forces_n[3]",
    "forces_n[4]",
    "forces_n[5]",
    "forces_n[6]",
    "forces_n[7]",
    "forces_n[8]",
    "forces_n[9]",
    "forces_n[10]",
    "forces_n[11]",
    "forces_n[12]",
    "forces_n[13]",
    "forces_n[14]",
    "forces_n[15]"
);

const _: () = assert!(PARAMETERS.len() == MAX_NODES && FIRST_FORCE == 0);

/// Smallest and largest value of the parameter at `index`; none beyond the table.
pub const fn bounds(index: usize) -> Option<(f32, f32)> {
    if index < MAX_NODES {
        Some((f32::NEG_INFINITY, f32::INFINITY))
    } else {
        None
    }
}

/// What a table is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Variable {
    /// The bending angle θ (rad).
    Angle,
    /// The angular rate ω (rad/s).
    Rate,
    /// The gauge pressure p in the chamber (kPa in files, Pa inside).
    Pressure,
    /// The time t since the start of the run (s).
    Time,
}

impl Variable {
    /// Every variable. The place in the list is what a board stores.
    pub const ALL: [Self; 4] = [Self::Angle, Self::Rate, Self::Pressure, Self::Time];

    /// The name in model files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Angle => "angle",
            Self::Rate => "rate",
            Self::Pressure => "pressure",
            Self::Time => "time",
        }
    }

    /// The symbol in equations.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Angle => "θ",
            Self::Rate => "ω",
            Self::Pressure => "p_c",
            Self::Time => "t",
        }
    }

    /// The unit of the nodes in files.
    pub const fn unit(self) -> Unit {
        match self {
            Self::Angle => Unit::Radian,
            Self::Rate => Unit::RadianPerSecond,
            Self::Pressure => Unit::KiloPascal,
            Self::Time => Unit::Second,
        }
    }

    /// Its value at an instant, in SI units.
    pub fn at<R: Copy>(self, instant: &Instant<R>) -> R {
        match self {
            Self::Angle => instant.angle,
            Self::Rate => instant.rate,
            Self::Pressure => instant.pressure,
            Self::Time => instant.time,
        }
    }
}

/// Why nodes and forces are not a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InvalidTable {
    /// Fewer than [`MIN_NODES`] or more than [`MAX_NODES`].
    NodeCount,
    /// Not as many forces as nodes.
    Lengths,
    /// The node at this index, or its force, is infinite or not a number.
    NotFinite(usize),
    /// The node at this index is not above the one before it.
    NotIncreasing(usize),
}

impl fmt::Display for InvalidTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NodeCount => "has fewer than 2 or more than 16 nodes",
            Self::Lengths => "has not as many forces as nodes",
            Self::NotFinite(_) => "has a number that is not finite",
            Self::NotIncreasing(_) => "has nodes that do not increase",
        })
    }
}

impl core::error::Error for InvalidTable {}

/// Table of a force.
///
/// Q (N) is given at 2 to 16 nodes of the angle θ (rad), the rate ω (rad/s), the pressure p in
/// the chamber (Pa), or the time t (s): on a straight line between two nodes and constant beyond
/// the first and the last. A jump, as of dry friction at ω = 0, is two nodes close to each other.
///
/// The forces are the parameters, from [`FIRST_FORCE`] on. The nodes are fixed, in single
/// precision on the board and on a desktop alike, and a fit does not move them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Table<R> {
    of: Variable,
    count: u8,
    /// Zero beyond `count`.
    nodes: [f32; MAX_NODES],
    forces: [R; MAX_NODES],
}

impl<R: Real> Table<R> {
    /// Creates a table from nodes in SI units and the forces (N) at them.
    ///
    /// # Errors
    ///
    /// [`InvalidTable`].
    pub fn new(of: Variable, nodes: &[f32], forces: &[R]) -> Result<Self, InvalidTable> {
        if nodes.len() == forces.len() {
            Self::of_pairs(of, nodes.iter().copied().zip(forces.iter().copied()))
        } else {
            Err(InvalidTable::Lengths)
        }
    }

    /// [`Table::new`] for nodes that do not lie side by side in memory, each with
    /// its force.
    ///
    /// # Errors
    ///
    /// [`InvalidTable`].
    pub fn of_pairs(
        of: Variable,
        pairs: impl IntoIterator<Item = (f32, R)>,
    ) -> Result<Self, InvalidTable> {
        let mut table = Self {
            of,
            count: 0,
            nodes: [0.0; MAX_NODES],
            forces: [R::zero(); MAX_NODES],
        };
        let mut places = table.nodes.iter_mut().zip(&mut table.forces);
        let mut before = f32::NEG_INFINITY;
        for (index, (node, force)) in pairs.into_iter().enumerate() {
            let Some(place) = places.next() else {
                return Err(InvalidTable::NodeCount);
            };
            if !(node.is_finite() && force.is_finite()) {
                return Err(InvalidTable::NotFinite(index));
            }
            if node <= before {
                return Err(InvalidTable::NotIncreasing(index));
            }
            (*place.0, *place.1) = (node, force);
            before = node;
            table.count += 1;
        }
        if usize::from(table.count) < MIN_NODES {
            return Err(InvalidTable::NodeCount);
        }
        Ok(table)
    }

    /// The force (N) where the variable is `x`, in SI units.
    pub fn at(&self, x: R) -> R {
        // The first node above x; the first of all where x is not a number.
        let above = self.nodes().partition_point(|&node| x >= R::from_f32(node));
        let node = |index: usize| Some((self.nodes().get(index)?, *self.forces().get(index)?));
        match (above.checked_sub(1).and_then(node), node(above)) {
            (Some((&start, at_start)), Some((&end, at_end))) => {
                let (start, end) = (R::from_f32(start), R::from_f32(end));
                at_start + (x - start) * ((at_end - at_start) / (end - start))
            }
            (Some((_, last)), None) => last,
            (None, Some((_, first))) => first,
            (None, None) => R::zero(),
        }
    }

    /// The largest |dQ/dx| between two nodes, in SI units.
    #[inline(never)]
    pub fn steepest(&self) -> R {
        let mut steepest = R::zero();
        let mut left: Option<(R, R)> = None;
        for (node, force) in self.pairs() {
            if let Some((start, at_start)) = left {
                steepest = steepest.max(((force - at_start) / (node - start)).abs());
            }
            left = Some((node, force));
        }
        steepest
    }

    /// Where `offset` + Q(x) = `gain` · x: the pressure that holds against a table
    /// of the pressure. The first such place if the table rises faster than
    /// the line.
    #[inline(never)] // Once on the board, which asks in three places.
    pub fn balance(&self, offset: R, gain: R) -> R {
        let mut left: Option<(R, R)> = None;
        let mut last = R::zero();
        for (node, force) in self.pairs() {
            let missing = offset + force - gain * node;
            let missing = if gain < R::zero() { -missing } else { missing };
            if missing <= R::zero() {
                return left.map_or((offset + force) / gain, |(start, at_start)| {
                    start + (node - start) * (at_start / (at_start - missing))
                });
            }
            left = Some((node, missing));
            last = force;
        }
        (offset + last) / gain
    }

    fn pairs(&self) -> impl Iterator<Item = (R, R)> {
        let nodes = self.nodes().iter().map(|&node| R::from_f32(node));
        nodes.zip(self.forces.iter().copied())
    }
}

impl<R> Table<R> {
    /// What it is a table of.
    pub const fn of(&self) -> Variable {
        self.of
    }

    /// The nodes in SI units.
    pub fn nodes(&self) -> &[f32] {
        self.nodes.get(..usize::from(self.count)).unwrap_or(&[])
    }

    /// The forces (N) at the nodes.
    pub fn forces(&self) -> &[R] {
        self.forces.get(..usize::from(self.count)).unwrap_or(&[])
    }

    /// The parameter table: the rows of the nodes that it has.
    pub fn parameters(&self) -> &'static [Parameter] {
        PARAMETERS.get(..usize::from(self.count)).unwrap_or(&[])
    }

    /// Replaces the parameter at `index`, the force at a node; ignores an index
    /// beyond the nodes.
    pub fn set_value(&mut self, index: usize, value: R) {
        let mut used = self.forces.iter_mut().take(usize::from(self.count));
        if let Some(force) = used.nth(index) {
            *force = value;
        }
    }

    /// Converts the forces with `f`.
    pub fn map<S>(&self, f: impl FnMut(R) -> S) -> Table<S>
    where
        R: Copy,
    {
        Table {
            of: self.of,
            count: self.count,
            nodes: self.nodes,
            forces: self.forces.map(f),
        }
    }
}

impl<R: Copy> Table<R> {
    /// The parameter at `index`: the force (N) at a node.
    pub fn value(&self, index: usize) -> Option<R> {
        self.forces().get(index).copied()
    }
}

impl<R: Real> Mechanism<R> for Table<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.at(self.of.at(at))
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        let mut rates = Rates {
            stiffness: R::zero(),
            relaxation: R::zero(),
        };
        let slope = self.steepest() / dynamics.inertia;
        match self.of {
            Variable::Angle => rates.stiffness = slope,
            Variable::Rate => rates.relaxation = slope,
            // They change with the input and not with the motion.
            Variable::Pressure | Variable::Time => {}
        }
        rates
    }
}

/// Marks the slot of a table whose numbers the model keeps beside its slots. By itself it does
/// nothing.
///
/// A model keeps at most one table, which is eight times as large as any other effect: a board has
/// little RAM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InModel;

impl<R: Real> Mechanism<R> for InModel {}

impl Preparation for InModel {
    const CYCLES: u16 = 2_200;
    type Part = OfTable;
    // It has no list of values.
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[], 0.05);

    fn prepare(&self, base: &Base) -> OfTable {
        let Some(table) = base.model.table() else {
            return OfTable::Nothing;
        };
        if table.of() != Variable::Rate {
            return OfTable::Force(table.of());
        }
        let at_rest = table.at(0.0);
        if at_rest == 0.0 {
            OfTable::Nothing
        } else {
            OfTable::AtRest(at_rest * base.leapfrog.per_newton())
        }
    }

    fn rate_law(&self, model: &Model<f32>) -> Option<RateLaw> {
        let table = model.table().filter(|table| table.of() == Variable::Rate)?;
        let nodes = table.nodes().iter();
        Some(RateLaw {
            farthest: nodes.fold(0.0, |largest, node| Real::max(largest, node.abs())),
            sided: true,
        })
    }
}

/// What a table does in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OfTable {
    /// Nothing: the glide has it.
    Nothing,
    /// What the glide leaves of it at rest: a force (rad of way).
    AtRest(f32),
    /// The force at this variable, from the table in the model.
    Force(Variable),
}

impl Part for OfTable {
    fn phases(&self) -> Phases {
        match self {
            Self::Nothing => Phases::NONE,
            Self::AtRest(_) | Self::Force(_) => Phases::AFTER,
        }
    }

    #[inline(always)]
    fn force(&self, base: &Base, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        match (self, base.model.table()) {
            (Self::AtRest(force), _) => *force,
            (Self::Force(of), Some(table)) => {
                table.at(of.at(&step.instant())) * base.leapfrog.per_newton()
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::actuator::{InvalidModel, Model, ParameterId};
    use crate::catalogue::{Effect, Kind};
    use crate::effects::testing::{force, run, spring};
    use crate::input::Held;
    use crate::integrate::{Scheme, step};
    use proptest::prelude::*;
    use std::vec::Vec;

    fn table(of: Variable, nodes: &[f32], forces: &[f64]) -> Effect<f64> {
        Effect::Table(Table::new(of, nodes, forces).unwrap())
    }

    /// Nodes that increase by at least 2⁻⁷, and forces.
    fn any_pairs() -> impl Strategy<Value = (Vec<f32>, Vec<f64>)> {
        prop::collection::vec((0.007_812_5..1.0_f32, -2.0..2.0_f64), MIN_NODES..=MAX_NODES)
            .prop_map(|pairs| {
                let mut node = -3.0;
                pairs
                    .into_iter()
                    .map(|(step, force)| {
                        node += step;
                        (node, force)
                    })
                    .unzip()
            })
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let new = |nodes: &[f32], forces: &[f64]| Table::new(Variable::Angle, nodes, forces);
        let (nodes, forces) = ([0.0_f32; 17], [0.0_f64; 17]);
        assert_eq!(new(&[0.0], &[1.0]), Err(InvalidTable::NodeCount));
        assert_eq!(new(&[], &[]), Err(InvalidTable::NodeCount));
        assert_eq!(new(&[0.0, 1.0], &[1.0]), Err(InvalidTable::Lengths));
        assert_eq!(
            new(&nodes[..2], &forces[..2]),
            Err(InvalidTable::NotIncreasing(1))
        );
        assert_eq!(
            new(&[0.0, 1.0, 0.5], &[0.0; 3]),
            Err(InvalidTable::NotIncreasing(2))
        );
        assert_eq!(
            new(&[0.0, f32::NAN], &[0.0; 2]),
            Err(InvalidTable::NotFinite(1))
        );
        assert_eq!(
            new(&[f32::NEG_INFINITY, 0.0], &[0.0; 2]),
            Err(InvalidTable::NotFinite(0))
        );
        assert_eq!(
            new(&[0.0, 1.0], &[0.0, f64::INFINITY]),
            Err(InvalidTable::NotFinite(1))
        );
        let rising: Vec<f32> = (0..17_u8).map(f32::from).collect();
        assert_eq!(new(&rising, &forces), Err(InvalidTable::NodeCount));
        let most = new(&rising[..16], &forces[..16]).unwrap();
        assert_eq!(most.parameters().len(), MAX_NODES);
    }

    #[test]
    fn a_model_has_one_table_and_finds_its_forces() {
        let rate = table(Variable::Rate, &[-1.0, 1.0], &[-0.5, 0.5]);
        let angle = table(Variable::Angle, &[0.0, 1.0, 2.0], &[0.0, 0.1, 0.4]);
        let offset = Kind::SensorOffset.build(&[0.1]).unwrap();
        let dynamics = *spring(1.0, 0.1, 2.0, &[]).dynamics();
        assert_eq!(
            Model::<f64>::new(dynamics, &[rate, offset, angle]).unwrap_err(),
            InvalidModel::NotOneTable
        );
        assert_eq!(
            Model::<f64>::of_slots(dynamics, [Some(Effect::Table(InModel)), None, None], None)
                .unwrap_err(),
            InvalidModel::NotOneTable
        );

        let model = Model::<f64>::new(dynamics, &[offset, angle]).unwrap();
        let effects: Vec<_> = model.effects().collect();
        assert_eq!(effects, [offset, angle]);
        let id = |parameter| ParameterId::Effect { slot: 1, parameter };
        assert_eq!(model.value(id(FIRST_FORCE + 2)), Some(0.4));
        assert_eq!(model.value(id(3)), None);
        let changed = model.with_value(id(2), 0.7).with_value(id(3), 9.0);
        let forces = changed.table().unwrap().forces();
        assert_eq!(forces, [0.0, 0.1, 0.7]);
        assert_eq!(changed.table().unwrap().nodes(), [0.0, 1.0, 2.0]);
        // A table without an effect that is one would act unseen.
        assert_eq!(
            Model::<f64>::of_slots(dynamics, [None; 3], model.table().copied()).unwrap_err(),
            InvalidModel::NotOneTable
        );
    }

    /// Within its ends a straight table is the effect of the same line.
    #[test]
    fn straight_tables_are_a_stiffness_and_a_damping() {
        let nodes = [-4.0, -1.0, 0.5, 4.0];
        let line = nodes.map(|node: f32| 0.8 * f64::from(node));
        let end = |damping: f64, effects: &[Effect<f64>]| {
            let model = spring(0.4, damping, 3.0, effects);
            run(&model, model.moving(0.3, 1.0, 0.0), &Held(0.5), 3.0, 600)
        };
        let stiffness = Kind::LinearStiffness.build(&[0.8]).unwrap();
        let by_name = end(0.2, &[stiffness]);
        let of_angle = end(0.2, &[table(Variable::Angle, &nodes, &line)]);
        assert!((by_name.angle - of_angle.angle).abs() < 1e-12);
        let damped = end(0.2 + 0.8, &[]);
        let of_rate = end(0.2, &[table(Variable::Rate, &nodes, &line)]);
        assert!((damped.angle - of_rate.angle).abs() < 1e-12);
        assert!((damped.angle - by_name.angle).abs() > 1e-3);
    }

    /// A table of the time pushes on the clock, one of the pressure takes from the
    /// input.
    #[test]
    fn tables_of_time_and_pressure_act_like_the_input() {
        // A free mass under a force that rises with the time: θ = −Q₁t³/6M.
        let ramp = table(Variable::Time, &[0.0, 8.0], &[0.0, 8.0]);
        let model = spring(2.0, 0.0, 0.0, &[ramp]);
        let end = run(&model, model.at_rest(0.0, 0.0), &Held(0.0), 2.0, 100);
        assert!((end.angle + 8.0 / 12.0).abs() < 1e-12);

        let half = table(Variable::Pressure, &[0.0, 10.0], &[0.0, 5.0]);
        let acceleration = |pressure| {
            let model = spring(1.0, 0.0, 0.0, &[half]);
            let state = model.at_rest(0.0, pressure);
            model.derivative(&state, &Held(pressure), 0.0).acceleration
        };
        assert!((acceleration(4.0) - 2.0).abs() < 1e-15);
        // Constant beyond the ends.
        assert!((acceleration(20.0) - 15.0).abs() < 1e-15);
        assert!((acceleration(-3.0) + 3.0).abs() < 1e-15);
    }

    /// A jump at zero is a friction: a slope within the two nodes, constant outside.
    #[test]
    fn two_close_nodes_are_a_jump() {
        let jump = table(Variable::Rate, &[-0.02, 0.02], &[-0.3, 0.3]);
        for (rate, expected) in [(-1.0, -0.3), (-0.01, -0.15), (0.0, 0.0), (0.5, 0.3)] {
            assert!((force(&jump, 0.4, rate) - expected).abs() < 1e-7, "{rate}");
        }
    }

    #[test]
    fn steps_resolve_the_steepest_piece() {
        let model = |of| {
            let steep = table(of, &[-1.0, 0.0, 0.25, 1.0], &[0.0, 1.0, -1.0, 0.0]);
            spring(0.5, 0.1, 2.0, &[steep]).fastest_rate(1.0)
        };
        let plain = spring(0.5, 0.1, 2.0, &[]).fastest_rate(1.0);
        assert!((model(Variable::Angle).stiffness - plain.stiffness - 16.0).abs() < 1e-12);
        assert!((model(Variable::Rate).relaxation - plain.relaxation - 16.0).abs() < 1e-12);
        assert_eq!(model(Variable::Pressure), plain);
        assert_eq!(model(Variable::Time), plain);
    }

    #[test]
    fn not_a_number_is_no_panic() {
        let effect = table(Variable::Angle, &[0.0, 1.0], &[2.0, 3.0]);
        let model = spring(1.0, 0.1, 1.0, &[effect]);
        let mut state = model.at_rest(f64::NAN, 0.0);
        step(Scheme::Rk4, &model, &mut state, &Held(0.0), 0.01);
        assert!(state.rate.is_nan());
    }

    proptest! {
        #[test]
        fn force_is_that_of_the_nodes_and_continuous_and_between_its_neighbours(
            (nodes, forces) in any_pairs(),
            share in 0.0..1.0_f64,
        ) {
            let table = Table::new(Variable::Angle, &nodes, &forces).unwrap();
            for (node, force) in nodes.iter().zip(&forces) {
                let node = f64::from(*node);
                prop_assert!((table.at(node) - force).abs() < 1e-12);
                prop_assert!((table.at(node - 1e-9) - force).abs() < 1e-5);
            }
            for (ends, at_ends) in nodes.windows(2).zip(forces.windows(2)) {
                let [start, end] = [ends[0], ends[1]].map(f64::from);
                let expected = at_ends[0] + share * (at_ends[1] - at_ends[0]);
                let found = table.at(start + share * (end - start));
                prop_assert!((found - expected).abs() < 1e-9);
                prop_assert!((at_ends[1] - at_ends[0]).abs() <= table.steepest() * (end - start) * (1.0 + 1e-12));
            }
            prop_assert_eq!(table.at(-10.0).to_bits(), forces[0].to_bits());
            prop_assert_eq!(table.at(30.0).to_bits(), forces[forces.len() - 1].to_bits());
        }

        /// Odd forces make an odd table, up to rounding.
        #[test]
        fn mirrored_nodes_give_mirrored_forces((nodes, forces) in any_pairs(), x in -4.0..4.0_f64) {
            let there = Table::new(Variable::Rate, &nodes, &forces).unwrap();
            let nodes: Vec<f32> = nodes.iter().rev().map(|node| -node).collect();
            let forces: Vec<f64> = forces.iter().rev().map(|force| -force).collect();
            let back = Table::new(Variable::Rate, &nodes, &forces).unwrap();
            prop_assert!((there.at(x) + back.at(-x)).abs() < 1e-12);
        }

        /// A force along the rate that has its sign only ever takes energy.
        #[test]
        fn tables_against_the_motion_take_energy(
            sizes in prop::collection::vec((0.05..1.0_f32, 0.0..2.0_f64), 1..8),
            rate in -3.0..3.0_f64,
        ) {
            let mut node = 0.0;
            let mut pairs: Vec<(f32, f64)> = sizes.iter().map(|&(step, size)| {
                node += step;
                (node, size)
            }).collect();
            pairs.extend(pairs.clone().iter().map(|&(node, size)| (-node, -size)));
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (nodes, forces): (Vec<f32>, Vec<f64>) = pairs.into_iter().unzip();
            let table = Table::new(Variable::Rate, &nodes, &forces).unwrap();
            prop_assert!(table.at(rate) * rate >= -1e-12);
        }

        #[test]
        fn balance_is_where_the_line_meets_the_table(
            (nodes, forces) in any_pairs(),
            offset in -20.0..20.0_f64,
            more in 0.1..5.0_f64,
            flip: bool,
        ) {
            let table = Table::new(Variable::Pressure, &nodes, &forces).unwrap();
            let gain = if flip { -1.0 } else { 1.0 } * (table.steepest() + more);
            let x = table.balance(offset, gain);
            let left = offset + table.at(x) - gain * x;
            prop_assert!(left.abs() < 1e-9 * (1.0 + gain.abs() * (1.0 + x.abs())), "{left}");
        }
    }
}
