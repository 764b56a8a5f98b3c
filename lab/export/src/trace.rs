//! A scalar that records the computation (tracing).
//!
//! The physics in `model-core` is written once, for every scalar that implements
//! [`Real`]. Run on [`Traced`], it gives no numbers but a graph of expressions over named
//! parameters and states, which is printed in other languages.
//!
//! A comparison needs an answer, but the graph has only names. So [`Tape::explore`] runs the
//! function once for each answer, and joins the results by an [`Expression::Select`] as deep in
//! the graph as possible: parts that do not depend on the answer appear once.

use std::cell::{Ref, RefCell};
use std::cmp::Ordering;
use std::collections::HashMap;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use model_core::power::Power;
use model_core::real::Real;

/// The most runs of one function: three effects have some dozens of branches together.
const MOST_RUNS: usize = 1 << 12;

/// The place of an expression on its tape. What it is made of lies before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(usize);

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unary {
    /// −x.
    Negate,
    /// |x|.
    Absolute,
    /// eˣ.
    Exp,
    /// ln x.
    Log,
    /// tanh x.
    Tanh,
    /// sin x.
    Sin,
    /// cos x.
    Cos,
}

/// A function of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Binary {
    /// x + y.
    Add,
    /// x − y.
    Subtract,
    /// x·y.
    Multiply,
    /// x/y.
    Divide,
    /// The larger of both.
    Max,
    /// xʸ for x ≥ 0.
    Power,
    /// sign(x)·|x|ʸ.
    SignedPower,
}

/// How two numbers compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Relation {
    /// x < y.
    Less,
    /// x ≤ y.
    NotGreater,
    /// x = y.
    Equal,
}

/// A question whose answer is known only when the exported code runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Condition {
    /// How both are compared.
    pub relation: Relation,
    /// The number on the left.
    pub left: Id,
    /// The number on the right.
    pub right: Id,
}

/// An entry of a tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Expression {
    /// A number, by its bits: numbers that are equal have one place.
    Literal(u64),
    /// A name, by its number on the tape.
    Symbol(usize),
    /// A function of one expression.
    Unary(Unary, Id),
    /// A function of two.
    Binary(Binary, Id, Id),
    /// The first where the condition holds, else the second.
    Select(Condition, Id, Id),
}

impl Expression {
    /// The expressions that it is made of.
    pub fn parts(self) -> impl Iterator<Item = Id> {
        let parts = match self {
            Self::Literal(_) | Self::Symbol(_) => [None; 4],
            Self::Unary(_, x) => [Some(x), None, None, None],
            Self::Binary(_, x, y) => [Some(x), Some(y), None, None],
            Self::Select(Condition { left, right, .. }, x, y) => {
                [Some(left), Some(right), Some(x), Some(y)]
            }
        };
        parts.into_iter().flatten()
    }

    /// Whether it is a number or a name.
    pub fn is_leaf(self) -> bool {
        matches!(self, Self::Literal(_) | Self::Symbol(_))
    }
}

/// A function has more branches than can be gone through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("has too many branches")]
pub struct TooManyBranches;

/// Everything that was computed, each expression once.
#[derive(Debug, Default)]
pub struct Tape {
    expressions: RefCell<Vec<Expression>>,
    places: RefCell<HashMap<Expression, Id>>,
    symbols: RefCell<Vec<String>>,
    run: RefCell<Tracing>,
}

/// Answers to the comparisons of one run of a function.
#[derive(Debug, Default)]
struct Tracing {
    /// The first answers; all later answers are yes.
    given: Vec<bool>,
    /// The conditions asked, with their answers.
    asked: Vec<(Condition, bool)>,
}

impl Tape {
    /// A number with a name.
    pub fn symbol(&self, name: &str) -> Traced<'_> {
        let known = self.symbols.borrow().iter().position(|known| known == name);
        let number = known.unwrap_or_else(|| {
            self.symbols.borrow_mut().push(name.to_owned());
            self.symbols.borrow().len() - 1
        });
        self.traced(Expression::Symbol(number))
    }

    /// The name of a symbol.
    pub fn name(&self, symbol: usize) -> Ref<'_, str> {
        Ref::map(self.symbols.borrow(), |symbols| symbols[symbol].as_str())
    }

    /// The entry at a place.
    pub fn get(&self, id: Id) -> Expression {
        self.expressions.borrow()[id.0]
    }

    /// How many places there are.
    pub fn len(&self) -> usize {
        self.expressions.borrow().len()
    }

    /// All places that some expressions are made of, parts first.
    pub fn reached(&self, from: &[Id]) -> Vec<Id> {
        let mut reached = vec![false; self.len()];
        for id in from {
            reached[id.0] = true;
        }
        for place in (0..reached.len()).rev() {
            if reached[place] {
                for part in self.get(Id(place)).parts() {
                    reached[part.0] = true;
                }
            }
        }
        (0..reached.len())
            .filter(|&place| reached[place])
            .map(Id)
            .collect()
    }

    /// Whether an expression is of one of some names.
    pub fn depends(&self, id: Id, names: &[&str]) -> bool {
        !names.is_empty()
            && self.reached(&[id]).into_iter().any(|part| {
                matches!(self.get(part), Expression::Symbol(symbol)
                    if names.contains(&&*self.name(symbol)))
            })
    }

    /// Runs a function for every way in which its comparisons can come out, and joins the
    /// results.
    ///
    /// # Errors
    ///
    /// If these are more than anybody would read.
    pub fn explore<'t>(
        &'t self,
        mut function: impl FnMut() -> Vec<Traced<'t>>,
    ) -> Result<Vec<Id>, TooManyBranches> {
        let mut runs = 0;
        let mut given = Vec::new();
        self.branch(&mut function, &mut given, &mut runs)
    }

    /// [`Tape::explore`] for a function with one result.
    ///
    /// # Errors
    ///
    /// The same as [`Tape::explore`].
    pub fn single<'t>(
        &'t self,
        mut function: impl FnMut() -> Traced<'t>,
    ) -> Result<Id, TooManyBranches> {
        Ok(self.explore(|| vec![function()])?[0])
    }

    fn branch<'t>(
        &'t self,
        function: &mut impl FnMut() -> Vec<Traced<'t>>,
        given: &mut Vec<bool>,
        runs: &mut usize,
    ) -> Result<Vec<Id>, TooManyBranches> {
        *runs += 1;
        if *runs > MOST_RUNS {
            return Err(TooManyBranches);
        }
        *self.run.borrow_mut() = Tracing {
            given: given.clone(),
            asked: Vec::new(),
        };
        let results: Vec<Id> = function().into_iter().map(|x| self.place(x)).collect();
        let next = self.run.borrow().asked.get(given.len()).copied();
        let Some((condition, _)) = next else {
            return Ok(results);
        };
        given.push(true);
        let yes = self.branch(function, given, runs)?;
        *given.last_mut().expect("it was pushed") = false;
        let no = self.branch(function, given, runs)?;
        given.pop();
        Ok(yes
            .into_iter()
            .zip(no)
            .map(|(yes, no)| self.joined(condition, yes, no))
            .collect())
    }

    /// The first of two expressions where a condition holds, else the second. Where they
    /// differ in one part only, the choice is made of that.
    fn joined(&self, condition: Condition, yes: Id, no: Id) -> Id {
        use Expression::{Binary, Select, Unary};
        if yes == no {
            return yes;
        }
        if let Some(power) = self.signed_power(condition, yes, no) {
            return power;
        }
        let joined = match (self.get(yes), self.get(no)) {
            (Unary(f, x), Unary(g, y)) if f == g => Unary(f, self.joined(condition, x, y)),
            (Binary(f, a, x), Binary(g, b, y)) if f == g && a == b => {
                Binary(f, a, self.joined(condition, x, y))
            }
            (Binary(f, x, a), Binary(g, y, b)) if f == g && a == b => {
                Binary(f, self.joined(condition, x, y), a)
            }
            (Select(c, a, x), Select(d, b, y)) if c == d && a == b => {
                Select(c, a, self.joined(condition, x, y))
            }
            (Select(c, x, a), Select(d, y, b)) if c == d && a == b => {
                Select(c, self.joined(condition, x, y), a)
            }
            _ => Select(condition, yes, no),
        };
        self.insert(joined)
    }

    /// `model_core::power::signed_power`, whose two branches are no two formulas to a reader.
    fn signed_power(&self, condition: Condition, yes: Id, no: Id) -> Option<Id> {
        let (Expression::Unary(Unary::Negate, mirrored), Expression::Binary(Binary::Power, x, n)) =
            (self.get(yes), self.get(no))
        else {
            return None;
        };
        let negated = self
            .places
            .borrow()
            .get(&Expression::Unary(Unary::Negate, x))
            .copied()?;
        let zero = self.insert(Expression::Literal(0.0_f64.to_bits()));
        let below_zero = Condition {
            relation: Relation::Less,
            left: x,
            right: zero,
        };
        let mirrors = self.get(mirrored) == Expression::Binary(Binary::Power, negated, n);
        (mirrors && condition == below_zero)
            .then(|| self.insert(Expression::Binary(Binary::SignedPower, x, n)))
    }

    /// Whether an expression shows that it cannot be below zero.
    fn is_never_negative(&self, id: Id) -> bool {
        let is = |id| self.is_never_negative(id);
        match self.get(id) {
            Expression::Literal(bits) => f64::from_bits(bits) >= 0.0,
            Expression::Unary(Unary::Absolute | Unary::Exp, _) => true,
            Expression::Binary(Binary::Multiply, x, y) if x == y => true,
            Expression::Binary(Binary::Add | Binary::Multiply | Binary::Divide, x, y) => {
                is(x) && is(y)
            }
            Expression::Binary(Binary::Max, x, y) => is(x) || is(y),
            Expression::Binary(Binary::Power, x, _) => is(x),
            _ => false,
        }
    }

    fn decide(&self, condition: Condition) -> bool {
        let mut run = self.run.borrow_mut();
        if let Some((_, answer)) = run.asked.iter().find(|(asked, _)| *asked == condition) {
            return *answer;
        }
        let answer = run.given.get(run.asked.len()).copied().unwrap_or(true);
        run.asked.push((condition, answer));
        answer
    }

    fn insert(&self, expression: Expression) -> Id {
        *self
            .places
            .borrow_mut()
            .entry(expression)
            .or_insert_with(|| {
                let mut all = self.expressions.borrow_mut();
                all.push(expression);
                Id(all.len() - 1)
            })
    }

    fn traced(&self, expression: Expression) -> Traced<'_> {
        Traced::On(self, self.insert(expression))
    }

    fn place(&self, x: Traced<'_>) -> Id {
        match x {
            Traced::Literal(value) => self.insert(Expression::Literal(value.to_bits())),
            Traced::On(_, id) => id,
        }
    }
}

/// A number that is known, or what stands at a place of a tape.
#[derive(Clone, Copy, Debug)]
pub enum Traced<'t> {
    /// A number of the source.
    Literal(f64),
    /// The expression at this place.
    On(&'t Tape, Id),
}

impl<'t> Traced<'t> {
    /// Whether it is the number zero, and was never anything else.
    pub fn is_zero(self) -> bool {
        matches!(self, Self::Literal(value) if value == 0.0)
    }

    fn is_one(self) -> bool {
        #[expect(clippy::float_cmp, reason = "only exactly 1 leaves a product as it is")]
        let is_one = matches!(self, Self::Literal(value) if value == 1.0);
        is_one
    }

    /// Both numbers, if both are known, or else the tape that one of them is on.
    fn tape(self, other: Self) -> Result<[f64; 2], &'t Tape> {
        match (self, other) {
            (Self::Literal(x), Self::Literal(y)) => Ok([x, y]),
            (Self::On(tape, _), _) | (_, Self::On(tape, _)) => Err(tape),
        }
    }

    fn unary(self, function: Unary, of_number: fn(f64) -> f64) -> Self {
        match self {
            Self::Literal(x) => Self::Literal(of_number(x)),
            Self::On(tape, x) => tape.traced(Expression::Unary(function, x)),
        }
    }

    fn binary(self, function: Binary, other: Self, of_numbers: fn(f64, f64) -> f64) -> Self {
        match self.tape(other) {
            Ok([x, y]) => Self::Literal(of_numbers(x, y)),
            Err(tape) => {
                let [x, y] = [self, other].map(|x| tape.place(x));
                tape.traced(Expression::Binary(function, x, y))
            }
        }
    }

    /// One of two numbers by a comparison with another, which is no branch of what follows.
    fn select(self, relation: Relation, other: Self, yes: Self, no: Self) -> Self {
        match self.tape(other) {
            Ok(_) if self.compare(relation, other) => yes,
            Ok(_) => no,
            Err(tape) => {
                let [left, right, yes, no] = [self, other, yes, no].map(|x| tape.place(x));
                let condition = Condition {
                    relation,
                    left,
                    right,
                };
                tape.traced(Expression::Select(condition, yes, no))
            }
        }
    }

    /// Whether it shows that it cannot be below zero.
    fn is_never_negative(self) -> bool {
        match self {
            Self::Literal(value) => value >= 0.0,
            Self::On(tape, id) => tape.is_never_negative(id),
        }
    }

    fn compare(self, relation: Relation, other: Self) -> bool {
        match self.tape(other) {
            Ok([x, y]) => match relation {
                Relation::Less => x < y,
                Relation::NotGreater => x <= y,
                #[expect(clippy::float_cmp, reason = "it is the comparison")]
                Relation::Equal => x == y,
            },
            Err(tape) => {
                let [left, right] = [self, other].map(|x| tape.place(x));
                if left == right {
                    return relation != Relation::Less;
                }
                tape.decide(Condition {
                    relation,
                    left,
                    right,
                })
            }
        }
    }
}

impl PartialEq for Traced<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.compare(Relation::Equal, *other)
    }
}

impl PartialOrd for Traced<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(if self < other {
            Ordering::Less
        } else if self > other {
            Ordering::Greater
        } else {
            Ordering::Equal
        })
    }
    fn lt(&self, other: &Self) -> bool {
        self.compare(Relation::Less, *other)
    }
    fn le(&self, other: &Self) -> bool {
        self.compare(Relation::NotGreater, *other)
    }
    fn gt(&self, other: &Self) -> bool {
        other.compare(Relation::Less, *self)
    }
    fn ge(&self, other: &Self) -> bool {
        other.compare(Relation::NotGreater, *self)
    }
}

impl Add for Traced<'_> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        if self.is_zero() {
            other
        } else if other.is_zero() {
            self
        } else {
            self.binary(Binary::Add, other, |x, y| x + y)
        }
    }
}

impl Sub for Traced<'_> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        if other.is_zero() {
            self
        } else if self.is_zero() {
            -other
        } else {
            self.binary(Binary::Subtract, other, |x, y| x - y)
        }
    }
}

impl Mul for Traced<'_> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        if self.is_zero() || other.is_zero() {
            // Of finite numbers.
            Self::Literal(0.0)
        } else if self.is_one() {
            other
        } else if other.is_one() {
            self
        } else {
            self.binary(Binary::Multiply, other, |x, y| x * y)
        }
    }
}

impl Div for Traced<'_> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        self.binary(Binary::Divide, other, |x, y| x / y)
    }
}

impl AddAssign for Traced<'_> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Traced<'_> {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Neg for Traced<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        if let Self::On(tape, id) = self
            && let Expression::Unary(Unary::Negate, x) = tape.get(id)
        {
            return Self::On(tape, x);
        }
        self.unary(Unary::Negate, |x| -x)
    }
}

impl Real for Traced<'_> {
    type DefaultPower = Written;

    fn from_i16(n: i16) -> Self {
        Self::Literal(f64::from(n))
    }
    fn from_f32(x: f32) -> Self {
        Self::Literal(f64::from(x))
    }
    fn abs(self) -> Self {
        self.unary(Unary::Absolute, f64::abs)
    }
    fn max(self, other: Self) -> Self {
        self.binary(Binary::Max, other, f64::max)
    }
    fn exp(self) -> Self {
        self.unary(Unary::Exp, f64::exp)
    }
    fn from_double(x: f64) -> Self {
        Self::Literal(x)
    }
    fn ln(self) -> Self {
        self.unary(Unary::Log, f64::ln)
    }
    fn tanh(self) -> Self {
        self.unary(Unary::Tanh, f64::tanh)
    }
    fn sin(self) -> Self {
        self.unary(Unary::Sin, f64::sin)
    }
    fn cos(self) -> Self {
        self.unary(Unary::Cos, f64::cos)
    }
    // A formula is evaluated at hundreds of states to find its steepest slopes. Choices in it
    // are written where they are made: as branches of all that follows they would multiply.
    fn sign(self) -> Self {
        let zero = Self::Literal(0.0);
        let below = self.select(Relation::Less, zero, -Self::one(), zero);
        zero.select(Relation::Less, self, Self::one(), below)
    }
    fn least(self, other: Self) -> Self {
        other.select(Relation::Less, self, other, self)
    }
    fn power_of_positive(self, exponent: Self) -> Self {
        let power = Written::pow(self, exponent);
        if self.is_never_negative() {
            return power;
        }
        self.select(Relation::Less, Self::zero(), Self::Literal(f64::NAN), power)
    }
    // What a model computes of finite numbers is taken for finite.
    fn is_finite(self) -> bool {
        !matches!(self, Self::Literal(value) if !value.is_finite())
    }
}

/// The power function of whatever language it is written in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written;

impl<'t> Power<Traced<'t>> for Written {
    fn pow(base: Traced<'t>, exponent: Traced<'t>) -> Traced<'t> {
        base.binary(Binary::Power, exponent, f64::powf)
    }
}

#[cfg(test)]
impl Tape {
    /// The values of all expressions, to compare them with the traced function.
    pub(super) fn values(&self, of: impl Fn(&str) -> f64) -> Vec<f64> {
        let mut values: Vec<f64> = Vec::new();
        for expression in self.expressions.borrow().iter() {
            let part = |id: Id| values[id.0];
            let value = match *expression {
                Expression::Literal(bits) => f64::from_bits(bits),
                Expression::Symbol(symbol) => of(&self.name(symbol)),
                Expression::Unary(f, x) => match f {
                    Unary::Negate => -part(x),
                    Unary::Absolute => part(x).abs(),
                    Unary::Exp => part(x).exp(),
                    Unary::Log => part(x).ln(),
                    Unary::Tanh => part(x).tanh(),
                    Unary::Sin => part(x).sin(),
                    Unary::Cos => part(x).cos(),
                },
                Expression::Binary(f, x, y) => match f {
                    Binary::Add => part(x) + part(y),
                    Binary::Subtract => part(x) - part(y),
                    Binary::Multiply => part(x) * part(y),
                    Binary::Divide => part(x) / part(y),
                    Binary::Max => part(x).max(part(y)),
                    Binary::Power => part(x).powf(part(y)),
                    Binary::SignedPower => part(x).abs().powf(part(y)).copysign(part(x)),
                },
                Expression::Select(c, x, y) => {
                    let (left, right) = (part(c.left), part(c.right));
                    #[expect(clippy::float_cmp, reason = "it is the comparison")]
                    let holds = match c.relation {
                        Relation::Less => left < right,
                        Relation::NotGreater => left <= right,
                        Relation::Equal => left == right,
                    };
                    part(if holds { x } else { y })
                }
            };
            values.push(value);
        }
        values
    }

    /// The value of one of them.
    pub(super) fn value(&self, id: Id, of: impl Fn(&str) -> f64) -> f64 {
        self.values(of)[id.0]
    }
}

impl Id {
    /// Its value among those of all.
    #[cfg(test)]
    pub(super) fn of(self, values: &[f64]) -> f64 {
        values[self.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::power::signed_power;

    /// Branches in branches, loops, and numbers that meet again behind them.
    fn crooked<R: Real>(x: R, y: R) -> R {
        let mut sum = R::zero();
        for k in 0..3 {
            let step = R::from_i16(k) - x;
            if step > y {
                sum += step * y;
            } else if x <= y {
                sum -= step.abs() / (R::one() + y * y);
            } else {
                sum = sum * R::half() + (step.max(y) * x).exp().tanh();
            }
        }
        sum.sin() + sum.cos()
    }

    #[test]
    fn every_branch_gives_what_the_source_gives() {
        let tape = Tape::default();
        let (x, y) = (tape.symbol("x"), tape.symbol("y"));
        let traced = tape.explore(|| vec![crooked(x, y)]).unwrap()[0];
        for step_x in -20..20 {
            for step_y in -20..20 {
                let (x, y) = (0.17 * f64::from(step_x), 0.13 * f64::from(step_y));
                let found = tape.value(traced, |name| if name == "x" { x } else { y });
                let expected = crooked(x, y);
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{x} {y}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_choice_stands_where_the_branches_differ() {
        let tape = Tape::default();
        let (x, y) = (tape.symbol("x"), tape.symbol("y"));
        let traced = tape
            .explore(|| {
                let slope = if x < y {
                    Traced::Literal(2.0)
                } else {
                    Traced::Literal(3.0)
                };
                vec![(slope * x - y).exp()]
            })
            .unwrap()[0];
        let Expression::Unary(Unary::Exp, difference) = tape.get(traced) else {
            panic!("the exponential is outside")
        };
        let Expression::Binary(Binary::Subtract, product, _) = tape.get(difference) else {
            panic!("then the difference")
        };
        let Expression::Binary(Binary::Multiply, slope, _) = tape.get(product) else {
            panic!("then the product")
        };
        assert!(matches!(tape.get(slope), Expression::Select(..)));
    }

    #[test]
    fn the_two_sides_of_the_power_are_one_formula() {
        let tape = Tape::default();
        let (x, n) = (tape.symbol("x"), tape.symbol("n"));
        let traced = tape
            .explore(|| vec![signed_power::<_, Written>(x, n)])
            .unwrap()[0];
        assert!(matches!(
            tape.get(traced),
            Expression::Binary(Binary::SignedPower, ..)
        ));
    }

    #[test]
    fn endless_branches_end() {
        let tape = Tape::default();
        let x = tape.symbol("x");
        let endless = tape.explore(|| {
            let mut y = x;
            for k in 0..40 {
                if y < Traced::from_i16(k) {
                    y += x.sin();
                }
            }
            vec![y]
        });
        assert_eq!(endless, Err(TooManyBranches));
    }
}
