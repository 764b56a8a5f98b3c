//! Custom: Q = f(θ, ω, p, t, z), ż = (g(θ, ω, p, t) − z)/τ, formulas that a user writes.
//!
//! Nobody can list all the forces that act on an actuator. This effect is text in a file; the
//! desktop compiles it to a [`Program`], which runs in any [`Real`]: in `f64` for simulations
//! and on numbers with derivatives for fits.
//!
//! For the desktop alone, behind the feature `desktop`: the firmware has no room for programs
//! and is refused a model that has one ([`crate::prepared::Unsteppable::Formula`]). A
//! [`crate::effects::table`] of the same force runs there.

use core::cmp::Ordering;
use core::fmt;
use core::hash::{Hash, Hasher};

use super::table::Variable;
use super::{Hidden, Info, Instant, Mechanism, Parameter, Rest};
use crate::catalogue::Kind;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation};
use crate::real::Real;

/// The most parameters of a formula. Every slot of a model has room for them.
pub const MAX_PARAMETERS: usize = 6;

/// The most memories of a formula: an effect has room for as many hidden states.
pub const MAX_MEMORIES: usize = 2;

/// The most results that a program keeps at once.
pub const MAX_RESULTS: usize = 16;

/// Results for which no larger store is needed in nearly all formulas.
const FEW_RESULTS: usize = 4;

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unary {
    /// −x.
    Negative,
    /// |x|.
    Abs,
    /// −1, 0 or 1. Its slope is zero everywhere.
    Sign,
    /// √x.
    Sqrt,
    /// eˣ.
    Exp,
    /// The natural logarithm.
    Log,
    /// The sine of an angle in radians.
    Sin,
    /// The cosine.
    Cos,
    /// The tangent.
    Tan,
    /// The hyperbolic tangent.
    Tanh,
    /// xⁿ for a whole number n, of negative numbers too.
    Whole(i8),
}

/// A function of two numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Binary {
    /// x + y.
    Sum,
    /// x − y.
    Difference,
    /// x y.
    Product,
    /// x/y.
    Quotient,
    /// x to the power of y for x ≥ 0; not a number below.
    Power,
    /// The smaller.
    Min,
    /// The larger.
    Max,
}

impl Unary {
    /// Its value.
    pub fn of<R: Real>(self, x: R) -> R {
        match self {
            Self::Negative => -x,
            Self::Abs => x.abs(),
            Self::Sign => x.sign(),
            Self::Sqrt => x.power_of_positive(R::half()),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.sin() / x.cos(),
            Self::Tanh => x.tanh(),
            Self::Whole(exponent) => whole_power(x, exponent),
        }
    }
}

impl Binary {
    /// Its value.
    pub fn of<R: Real>(self, x: R, y: R) -> R {
        match self {
            Self::Sum => x + y,
            Self::Difference => x - y,
            Self::Product => x * y,
            Self::Quotient => x / y,
            Self::Power => x.power_of_positive(y),
            Self::Min => x.least(y),
            Self::Max => x.max(y),
        }
    }
}

/// By repeated squaring.
fn whole_power<R: Real>(base: R, exponent: i8) -> R {
    let mut power = R::one();
    let mut square = base;
    let mut left = exponent.unsigned_abs();
    while left > 0 {
        if left % 2 == 1 {
            power = power * square;
        }
        left /= 2;
        if left > 0 {
            square = square * square;
        }
    }
    if exponent < 0 {
        R::one() / power
    } else {
        power
    }
}

/// What an instruction reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operand {
    /// A number in the formula.
    Constant(f64),
    /// The parameter at this index.
    Parameter(u8),
    /// θ (rad), ω (rad/s), p (kPa) or t (s).
    Variable(Variable),
    /// The memory at this index.
    Memory(u8),
    /// What an instruction before left there.
    Result(u8),
}

/// One step of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instruction {
    /// A function of one number.
    Unary {
        /// Which.
        function: Unary,
        /// Of what.
        x: Operand,
        /// Where the result goes.
        into: u8,
    },
    /// A function of two numbers.
    Binary {
        /// Which.
        function: Binary,
        /// Of what.
        x: Operand,
        /// And of what.
        y: Operand,
        /// Where the result goes.
        into: u8,
    },
}

/// A formula, compiled. It always ends, and reads only what it has written.
///
/// A flat list of instructions over numbered results.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Program<'p> {
    instructions: &'p [Instruction],
    result: Operand,
    /// Places that hold all its results.
    results: usize,
}

impl<'p> Program<'p> {
    /// Creates a program after checking that it reads each result only after it is written, and no
    /// parameter beyond `parameters` or memory beyond `memories`; none otherwise.
    pub fn new(
        instructions: &'p [Instruction],
        result: Operand,
        parameters: usize,
        memories: usize,
    ) -> Option<Self> {
        let mut written = [false; MAX_RESULTS];
        let is_there = |operand: Operand, written: &[bool]| match operand {
            Operand::Constant(_) | Operand::Variable(_) => true,
            Operand::Parameter(index) => usize::from(index) < parameters.min(MAX_PARAMETERS),
            Operand::Memory(index) => usize::from(index) < memories.min(MAX_MEMORIES),
            Operand::Result(index) => written.get(usize::from(index)) == Some(&true),
        };
        for instruction in instructions {
            let (reads, into) = match *instruction {
                Instruction::Unary { x, into, .. } => ([x, x], into),
                Instruction::Binary { x, y, into, .. } => ([x, y], into),
            };
            if !reads.into_iter().all(|operand| is_there(operand, &written)) {
                return None;
            }
            *written.get_mut(usize::from(into))? = true;
        }
        is_there(result, &written).then_some(Self {
            instructions,
            result,
            results: written
                .iter()
                .rposition(|written| *written)
                .map_or(0, |last| last + 1),
        })
    }

    /// Its value, with parameters as in the formula, at an instant and with these memories.
    pub fn at<R: Real>(&self, parameters: &[R], at: &Instant<R>, memory: &Hidden<R>) -> R {
        if self.results <= FEW_RESULTS {
            self.run::<R, FEW_RESULTS>(parameters, at, memory)
        } else {
            self.run::<R, MAX_RESULTS>(parameters, at, memory)
        }
    }

    fn run<R: Real, const N: usize>(
        &self,
        parameters: &[R],
        at: &Instant<R>,
        memory: &Hidden<R>,
    ) -> R {
        let mut results = [R::zero(); N];
        let read = |operand: Operand, results: &[R; N]| match operand {
            Operand::Constant(value) => R::from_double(value),
            Operand::Parameter(index) => value_at(parameters, index),
            Operand::Variable(Variable::Pressure) => at.pressure / R::from_i16(1000),
            Operand::Variable(variable) => variable.at(at),
            Operand::Memory(index) => value_at(memory, index),
            Operand::Result(index) => value_at(results, index),
        };
        for instruction in self.instructions {
            let (value, into) = match *instruction {
                Instruction::Unary { function, x, into } => (function.of(read(x, &results)), into),
                Instruction::Binary {
                    function,
                    x,
                    y,
                    into,
                } => (function.of(read(x, &results), read(y, &results)), into),
            };
            if let Some(place) = results.get_mut(usize::from(into)) {
                *place = value;
            }
        }
        read(self.result, &results)
    }

    /// What it reads: constants, parameters and variables, in any order.
    pub fn reads(&self) -> impl Iterator<Item = Operand> {
        let of_instructions = self.instructions.iter().flat_map(|it| match *it {
            Instruction::Unary { x, .. } => [x, x],
            Instruction::Binary { x, y, .. } => [x, y],
        });
        of_instructions.chain([self.result])
    }

    /// The only variable that it depends on; none if there are several, or none.
    pub fn own_variable(&self) -> Option<Variable> {
        let mut variables = Variable::ALL
            .into_iter()
            .filter(|&variable| self.depends_on(variable));
        match (variables.next(), variables.next()) {
            (Some(variable), None) => Some(variable),
            _ => None,
        }
    }

    /// Whether it depends on a variable.
    pub fn depends_on(&self, variable: Variable) -> bool {
        self.reads().any(|it| it == Operand::Variable(variable))
    }
}

/// A checked program reads nothing that is not there.
fn value_at<R: Real>(values: &[R], index: u8) -> R {
    values.get(usize::from(index)).copied().unwrap_or(R::zero())
}

/// A memory z: ż = (g − z)/τ.
///
/// After a long rest it is what it follows, and it never runs away from that.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// What it follows, g(θ, ω, p, t).
    pub follows: Program<'static>,
    /// The parameter that is its time constant τ (s), never zero.
    pub time_constant: u8,
}

/// Where a formula comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A user wrote it.
    Written,
    /// A diagnosis made it of a grammar.
    Grammar,
}

/// What a user wrote, compiled.
///
/// A model is copied freely, and so is an [`crate::catalogue::Effect`]. So one definition is made
/// for each formula that is read, and it lives as long as the program that read it; what is
/// copied is a reference and the parameters.
#[derive(Debug)]
pub struct Definition {
    /// Its name, and what is said of it.
    pub info: Info,
    /// Its parameters. Their numbers are in the units of the formula, in files and
    /// inside.
    pub parameters: &'static [Parameter],
    /// The force Q (N).
    pub program: Program<'static>,
    /// Its memories, at most [`MAX_MEMORIES`].
    pub memories: &'static [Memory],
    /// Who made it.
    pub origin: Origin,
    /// Its text without the values: two definitions with the same are one.
    pub text: &'static str,
}

/// A formula by its [`Definition`]: what names it where effects are listed.
#[derive(Clone, Copy)]
pub struct Formula(pub &'static Definition);

impl Formula {
    /// Smallest and largest value of the parameter at `index`; none beyond them.
    pub const fn bounds(self, index: usize) -> Option<(f32, f32)> {
        let rows = self.0.parameters;
        if index < rows.len() {
            Some((rows[index].lower, rows[index].upper))
        } else {
            None
        }
    }

    /// Whether its force depends on a variable, at once or by a memory.
    pub fn depends_on(self, variable: Variable) -> bool {
        let memories = self.0.memories.iter().map(|memory| &memory.follows);
        let mut programs = memories.chain([&self.0.program]);
        programs.any(|program| program.depends_on(variable))
    }
}

impl PartialEq for Formula {
    fn eq(&self, other: &Self) -> bool {
        self.0.text == other.0.text
    }
}

impl Eq for Formula {}

impl PartialOrd for Formula {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Formula {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.text.cmp(other.0.text)
    }
}

impl Hash for Formula {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.text.hash(state);
    }
}

impl fmt::Debug for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.0.text)
    }
}

/// A formula with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Custom<R> {
    formula: Formula,
    /// The first one repeated beyond those that there are.
    values: [R; MAX_PARAMETERS],
}

impl<R: Copy> Custom<R> {
    /// Creates the effect from values in the order of the parameters; none if their
    /// number differs, or is zero.
    pub fn from_values(formula: Formula, values: &[R]) -> Option<Self> {
        if values.len() != formula.0.parameters.len() {
            return None;
        }
        let mut all = [*values.first()?; MAX_PARAMETERS];
        all.get_mut(..values.len())?.copy_from_slice(values);
        Some(Self {
            formula,
            values: all,
        })
    }

    /// Its formula.
    pub const fn formula(&self) -> Formula {
        self.formula
    }

    /// Its kind.
    pub const fn kind(&self) -> Kind {
        Kind::Custom(self.formula)
    }

    /// The parameter at `index`.
    pub fn value(&self, index: usize) -> Option<R> {
        self.values
            .get(..self.formula.0.parameters.len())?
            .get(index)
            .copied()
    }

    /// Replaces the parameter at `index`; ignores an index beyond the parameters.
    pub fn set_value(&mut self, index: usize, value: R) {
        if let Some(place) = self.values.get_mut(index) {
            *place = value;
        }
    }

    /// Converts every parameter with `f`.
    pub fn map<S>(&self, f: impl FnMut(R) -> S) -> Custom<S> {
        Custom {
            formula: self.formula,
            values: self.values.map(f),
        }
    }
}

/// No board computes a formula: [`crate::prepared::plan`] refuses it.
impl Preparation for Custom<f32> {
    const CYCLES: u16 = 0;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[]);

    fn prepare(&self, _base: &Base) -> Nothing {
        Nothing
    }
}

impl<R: Real> Custom<R> {
    /// Each memory with what it follows at an instant and its time constant (s).
    fn memories<'s>(&'s self, at: &'s Instant<R>) -> impl Iterator<Item = (R, R)> + 's {
        self.formula.0.memories.iter().map(|memory| {
            let follows = memory.follows.at(&self.values, at, &[R::zero(); 2]);
            (follows, value_at(&self.values, memory.time_constant))
        })
    }

    /// The memories after a long rest at an instant.
    fn settled(&self, at: &Instant<R>) -> Hidden<R> {
        let mut settled = [R::zero(); 2];
        for (state, (follows, _)) in settled.iter_mut().zip(self.memories(at)) {
            *state = follows;
        }
        settled
    }
}

impl<R: Real> Mechanism<R> for Custom<R> {
    fn integrates(&self) -> bool {
        !self.formula.0.memories.is_empty()
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        self.settled(&Instant {
            time: R::zero(),
            angle: rest.angle,
            rate: R::zero(),
            pressure: rest.pressure,
        })
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let states = hidden.iter().zip(self.memories(at));
        for (rate, (&state, (follows, time_constant))) in rates.iter_mut().zip(states) {
            *rate = (follows - state) / time_constant;
        }
        self.formula.0.program.at(&self.values, at, hidden)
    }

    fn stiffens(&self) -> bool {
        self.formula.depends_on(Variable::Pressure)
    }

    /// The steepest slopes by angle and by rate that a coarse grid of states shows.
    /// A sign without a width has no largest slope; one over the grid's finest
    /// step is as many integration steps as there can be.
    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        const ANGLES: &[f32] = &[-1.0, -0.5, 0.0, 0.5, 1.0];
        /// rad/s.
        const RATES: &[f32] = &[-3.0, -0.3, -0.03, 0.0, 0.03, 0.3, 3.0];
        /// Pa.
        const PRESSURES: &[f32] = &[0.0, 1.5e5];
        /// s.
        const TIMES: &[f32] = &[0.0, 60.0];
        /// rad or rad/s.
        const STEP: f32 = 1e-4;
        let grid = |variable, full: &'static [f32]| {
            if self.formula.depends_on(variable) {
                full
            } else {
                &[0.0]
            }
        };
        let step = R::from_f32(STEP);
        let mut steepest = [R::zero(); 2];
        for &share in grid(Variable::Angle, ANGLES) {
            for &rate in grid(Variable::Rate, RATES) {
                for &pressure in grid(Variable::Pressure, PRESSURES) {
                    for &time in grid(Variable::Time, TIMES) {
                        let at = Instant {
                            time: R::from_f32(time),
                            angle: angle * R::from_f32(share),
                            rate: R::from_f32(rate),
                            pressure: R::from_f32(pressure),
                        };
                        let memory = self.settled(&at);
                        let force =
                            |at: &Instant<R>| self.formula.0.program.at(&self.values, at, &memory);
                        let by_angle = [at.angle - step, at.angle + step]
                            .map(|angle| force(&Instant { angle, ..at }));
                        let by_rate = [at.rate - step, at.rate + step]
                            .map(|rate| force(&Instant { rate, ..at }));
                        for (most, [below, above]) in steepest.iter_mut().zip([by_angle, by_rate]) {
                            *most = most.max(((above - below) / (step + step)).abs());
                        }
                    }
                }
            }
        }
        let [by_angle, by_rate] = steepest;
        let start = Instant {
            time: R::zero(),
            angle,
            rate: R::zero(),
            pressure: R::zero(),
        };
        let forgets = self
            .memories(&start)
            .fold(R::zero(), |fastest, (_, time_constant)| {
                fastest.max(R::one() / time_constant)
            });
        Rates {
            stiffness: by_angle / dynamics.inertia,
            relaxation: by_rate / dynamics.inertia + forgets,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuator::{InvalidModel, Model, ParameterId};
    use crate::catalogue::Effect;
    use crate::effects::testing::{force, run, spring};
    use crate::effects::{Family, Place, Unit};
    use crate::input::Held;

    const fn parameter(key: &'static str, lower: f32, upper: f32) -> Parameter {
        Parameter {
            key,
            symbol: key,
            unit: Unit::Given("N"),
            lower,
            upper,
            held: None,
            default: None,
            starts: &[0.1],
        }
    }

    /// Q = a sin(3 θ) − p.
    static WAVE: Definition = Definition {
        info: Info {
            name: "wave",
            title: "wave",
            place: Place::Force,
            equation: "Q = a*sin(3*th) - p",
            text: "",
            signature: "",
            look_alikes: &[],
            family: Family::Own("wave"),
            needs: &[],
            own_variable: None,
            special_case: None,
            imitates: &[],
            told_by: &[],
            doubtful: &[],
            has_slope: true,
            states: &[],
        },
        parameters: &[parameter("a", 0.0, 1.0)],
        program: Program {
            instructions: &[
                Instruction::Binary {
                    function: Binary::Product,
                    x: Operand::Constant(3.0),
                    y: Operand::Variable(Variable::Angle),
                    into: 0,
                },
                Instruction::Unary {
                    function: Unary::Sin,
                    x: Operand::Result(0),
                    into: 0,
                },
                Instruction::Binary {
                    function: Binary::Product,
                    x: Operand::Parameter(0),
                    y: Operand::Result(0),
                    into: 0,
                },
                Instruction::Binary {
                    function: Binary::Difference,
                    x: Operand::Result(0),
                    y: Operand::Variable(Variable::Pressure),
                    into: 0,
                },
            ],
            result: Operand::Result(0),
            results: 1,
        },
        memories: &[],
        origin: Origin::Written,
        text: "wave",
    };

    fn wave(a: f64) -> Effect<f64> {
        Kind::Custom(Formula(&WAVE)).build(&[a]).unwrap()
    }

    #[test]
    fn a_program_computes_its_formula_with_kilopascals() {
        let at = Instant {
            time: 0.0,
            angle: 0.4,
            rate: 0.0,
            pressure: 2_000.0,
        };
        let found = wave(0.5).force(&at, &[0.0; 2], &mut [0.0; 2]);
        assert!((found - (0.5 * 1.2_f64.sin() - 2.0)).abs() < 1e-15);
        assert!((force(&wave(0.5), 0.4, 9.0) - 0.5 * 1.2_f64.sin()).abs() < 1e-15);
    }

    #[test]
    fn a_model_checks_names_and_changes_its_parameters() {
        let dynamics = *spring(1.0, 0.1, 2.0, &[]).dynamics();
        let id = ParameterId::Effect {
            slot: 0,
            parameter: 0,
        };
        assert_eq!(
            Model::<f64>::new(dynamics, &[wave(1.5)]).unwrap_err(),
            InvalidModel::OutOfBounds(id)
        );
        let model: Model<f64> = Model::new(dynamics, &[wave(0.5)]).unwrap();
        assert_eq!(model.value(id), Some(0.5));
        assert_eq!(model.with_value(id, 0.7).value(id), Some(0.7));
        let beyond = ParameterId::Effect {
            slot: 0,
            parameter: 1,
        };
        assert_eq!(model.value(beyond), None);
        assert_eq!(Kind::Custom(Formula(&WAVE)).build::<f64>(&[0.1, 0.2]), None);
    }

    /// At rest a sin(3θ) + Kθ = F.
    #[test]
    fn the_force_stands_on_the_side_of_the_spring() {
        let plain = spring(1.0, 2.0, 2.0, &[]);
        let model = spring(1.0, 2.0, 2.0, &[wave(0.5)]);
        let end = run(&model, model.at_rest(0.3, 0.0), &Held(0.0), 30.0, 3_000);
        assert!(end.angle.abs() < 1e-6);
        let held = |model: &Model<f64>| {
            // 1 Pa is a force of 1 N here, and 0.001 N more through the formula.
            run(model, model.at_rest(0.0, 0.0), &Held(0.6), 30.0, 3_000).angle
        };
        let angle = held(&model);
        assert!((0.5 * (3.0 * angle).sin() + 2.0 * angle - 0.6 - 0.0006).abs() < 1e-6);
        assert!(angle < held(&plain));
        let pressure = model.holding_pressure(angle);
        assert!((pressure - 0.6).abs() < 1e-6, "{pressure}");
    }

    /// Q = a (θ − z), ż = (θ − z)/τ.
    static CREEP: Definition = Definition {
        info: WAVE.info,
        parameters: &[parameter("a", 0.0, 1.0), parameter("tau", 0.1, 10.0)],
        program: Program {
            instructions: &[
                Instruction::Binary {
                    function: Binary::Difference,
                    x: Operand::Variable(Variable::Angle),
                    y: Operand::Memory(0),
                    into: 0,
                },
                Instruction::Binary {
                    function: Binary::Product,
                    x: Operand::Parameter(0),
                    y: Operand::Result(0),
                    into: 0,
                },
            ],
            result: Operand::Result(0),
            results: 1,
        },
        memories: &[Memory {
            follows: Program {
                instructions: &[],
                result: Operand::Variable(Variable::Angle),
                results: 0,
            },
            time_constant: 1,
        }],
        origin: Origin::Written,
        text: "creep",
    };

    /// With a memory of the angle it is the Maxwell branch of the catalogue.
    #[test]
    fn a_memory_of_the_angle_is_a_maxwell_branch() {
        let values = [0.4, 1.5];
        let own = Kind::Custom(Formula(&CREEP)).build(&values).unwrap();
        let branch = Kind::MaxwellBranch.build(&[0.4, 1.5, 0.0]).unwrap();
        let [own, branch] = [own, branch].map(|effect| {
            let model = spring(0.1, 0.3, 2.0, &[effect]);
            assert!(effect.integrates());
            run(&model, model.at_rest(0.3, 0.0), &Held(0.8), 4.0, 4_000)
        });
        assert!((own.angle - branch.angle).abs() < 1e-12);
        assert!((own.rate - branch.rate).abs() < 1e-12);
    }

    /// After a long rest a memory is what it follows, and it is never slower than its time.
    #[test]
    fn a_memory_starts_settled_and_shortens_the_steps() {
        let own: Effect<f64> = Kind::Custom(Formula(&CREEP)).build(&[0.4, 0.2]).unwrap();
        let rest = Rest {
            angle: 0.7,
            start: 0.7,
            rate: 0.0,
            pressure: 5.0,
            reading: 0.7,
        };
        assert!((own.at_rest(&rest)[0] - 0.7).abs() < 1e-15);
        let rates = own.fastest_rate(spring(1.0, 0.0, 2.0, &[]).dynamics(), 1.0);
        assert!((rates.relaxation - 5.0).abs() < 1e-9);
        assert!((rates.stiffness - 0.4).abs() < 1e-6);
    }

    #[test]
    fn the_board_refuses_it() {
        use crate::prepared::{Unsteppable, plan};
        let dynamics = spring(1.0, 0.1, 2.0, &[]).dynamics().map(|_| 1.0_f32);
        let effect = Kind::Custom(Formula(&WAVE)).build(&[0.1_f32]).unwrap();
        let model = Model::new(dynamics, &[effect]).unwrap();
        assert_eq!(plan(&model, 1.0, 0.01), Err(Unsteppable::Formula));
    }

    #[test]
    fn the_step_length_follows_the_steepest_slopes() {
        let model = spring(0.5, 0.0, 2.0, &[]);
        let rates = wave(0.5).fastest_rate(model.dynamics(), 1.0);
        assert!((rates.stiffness - 0.5 * 3.0 / 0.5).abs() < 1e-3);
        assert!(rates.relaxation < 1e-9);
    }

    #[test]
    fn what_reads_before_it_writes_is_no_program() {
        let sine = |x, into| Instruction::Unary {
            function: Unary::Sin,
            x,
            into,
        };
        let new = |list: &[Instruction], result| Program::new(list, result, 1, 1).is_some();
        let parameter = Operand::Parameter(0);
        assert!(new(&[], parameter));
        assert!(new(&[sine(parameter, 0)], Operand::Result(0)));
        assert!(new(&[], Operand::Memory(0)));
        assert!(!new(&[], Operand::Memory(1)));
        assert!(!new(&[], Operand::Parameter(1)));
        assert!(!new(&[], Operand::Result(0)));
        assert!(!new(&[sine(Operand::Result(1), 1)], Operand::Result(1)));
        assert!(!new(&[sine(parameter, 16)], Operand::Result(0)));
    }

    #[test]
    fn powers_and_signs() {
        assert!((Unary::Whole(3).of(-2.0_f64) + 8.0).abs() < 1e-15);
        assert!((Unary::Whole(-2).of(-2.0_f64) - 0.25).abs() < 1e-15);
        assert!((Unary::Whole(0).of(0.0_f64) - 1.0).abs() < 1e-15);
        assert!((Binary::Power.of(2.0_f64, 0.5) - 2.0_f64.sqrt()).abs() < 1e-15);
        assert!(Binary::Power.of(-2.0_f64, 0.5).is_nan());
        assert!(Unary::Sqrt.of(-1.0_f64).is_nan());
        assert!(Unary::Sign.of(f64::NAN).is_nan());
        assert!(Unary::Sign.of(0.0_f64).abs() < 1e-15);
        assert!((Unary::Sign.of(-3.0_f64) + 1.0).abs() < 1e-15);
    }
}
