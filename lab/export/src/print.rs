//! Prints expressions in the syntax of a language.
//!
//! Subexpressions that are used twice, or that have a name, become variables. The four
//! languages agree on sums and products; a [`Syntax`] holds their differences.

use std::collections::HashMap;

use super::physics::Physics;
use super::trace::{Binary, Condition, Expression, Id, Relation, Tape, Unary};
use softrig_formats::numbers::exact;

/// Lines are broken at their sums beyond so many characters.
const WIDTH: usize = 96;

/// What most languages call a function.
pub fn common_name(function: Unary) -> &'static str {
    match function {
        Unary::Negate => "-",
        Unary::Absolute => "abs",
        Unary::Exp => "exp",
        Unary::Log => "log",
        Unary::Tanh => "tanh",
        Unary::Sin => "sin",
        Unary::Cos => "cos",
    }
}

/// How a language writes what it does not share with the others.
pub trait Syntax {
    /// The name of a constant, state or variable.
    fn symbol(&self, name: &str) -> String;
    /// Where the state of a number is kept.
    fn place(&self, _state: usize) -> String {
        String::new()
    }
    /// Where the rate of that state is put.
    fn rate_place(&self, _state: usize) -> String {
        String::new()
    }
    /// The language's NaN.
    fn nan(&self) -> &'static str;
    /// A function of one number, other than a minus sign.
    fn unary(&self, function: Unary, x: &str) -> String {
        format!("{}({x})", self.name(function))
    }
    /// What a function is called.
    fn name(&self, function: Unary) -> &'static str {
        common_name(function)
    }
    /// The larger of two numbers.
    fn max(&self, x: &str, y: &str) -> String {
        format!("max({x}, {y})")
    }
    /// xʸ for x ≥ 0.
    fn power(&self, x: &str, y: &str) -> String {
        self.signed_power(x, y)
    }
    /// sign(x)·|x|ʸ.
    fn signed_power(&self, x: &str, y: &str) -> String {
        format!("signed_power({x}, {y})")
    }
    /// A comparison.
    fn condition(&self, relation: Relation, left: &str, right: &str) -> String {
        let sign = match relation {
            Relation::Less => "<",
            Relation::NotGreater => "<=",
            Relation::Equal => "==",
        };
        format!("{left} {sign} {right}")
    }
    /// One of two numbers, in parentheses; none where a language knows that as a statement
    /// only.
    fn select(&self, condition: &str, yes: &str, no: &str) -> Option<String>;
    /// Whether a choice between choices is written as a statement.
    fn has_statements(&self) -> bool {
        true
    }
    /// The lines before a new variable gets its value in a statement.
    fn declare(&self, _name: &str, _into: &mut Vec<String>) {}
    /// The lines that give a new variable its value.
    fn define(&self, name: &str, value: &Lines, into: &mut Vec<String>);
    /// The lines that give what is there a value.
    fn assign(&self, target: &str, value: &Lines, into: &mut Vec<String>);
    /// Lines that do one or the other.
    fn branch(&self, _condition: &str, _yes: &[String], _no: &[String], _into: &mut Vec<String>) {}
}

/// A value, cut into lines where it is long.
#[derive(Clone, Debug)]
pub struct Lines(pub Vec<String>);

impl Lines {
    /// The lines behind the first one indented, each but the last ending in `end`.
    pub fn joined(&self, end: &str) -> String {
        self.0.join(&format!("{end}\n    "))
    }

    /// Whether it is more than one.
    pub fn is_long(&self) -> bool {
        self.0.len() > 1
    }
}

/// Functions of functions go no deeper than this: Python reads no more than two hundred
/// parentheses in each other.
const DEEPEST: usize = 24;

/// How tightly a text holds together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Tightness {
    Sum,
    Product,
    Atom,
}

/// Prints expressions of a tape.
pub struct Printer<'a, S> {
    tape: &'a Tape,
    syntax: &'a S,
    /// Names of the parts that were computed before.
    names: HashMap<Id, String>,
    labels: &'a [(Id, String)],
    /// The prefix of generated names.
    prefix: &'static str,
    /// Names that a part must not be of if it is to be computed before.
    in_place: &'static [&'static str],
    /// Nothing is computed before.
    at_once: bool,
}

impl<'a, S: Syntax> Printer<'a, S> {
    /// For the expressions of a model.
    pub fn new(physics: &'a Physics, syntax: &'a S) -> Self {
        Self {
            tape: &physics.tape,
            syntax,
            names: HashMap::new(),
            labels: &physics.labels,
            prefix: "t",
            in_place: &[],
            at_once: false,
        }
    }

    /// Computes nothing before that depends on some names, has no use for labels, and names
    /// the other parts with this prefix.
    pub fn apart(self, prefix: &'static str, in_place: &'static [&'static str]) -> Self {
        Self {
            labels: &[],
            prefix,
            in_place,
            ..self
        }
    }

    /// Computes nothing before: each value is one expression.
    pub fn in_place(self) -> Self {
        Self {
            labels: &[],
            at_once: true,
            ..self
        }
    }

    /// One expression on one line.
    pub fn expression(&self, id: Id) -> String {
        self.text(id).0
    }

    /// The lines that give each target its value.
    pub fn assignments(mut self, targets: &[(String, Id)]) -> Vec<String> {
        let mut lines = Vec::new();
        let results: Vec<Id> = targets.iter().map(|(_, id)| *id).collect();
        let mut uses: HashMap<Id, usize> = HashMap::new();
        let reached = self.tape.reached(&results);
        for part in reached.iter().flat_map(|id| self.tape.get(*id).parts()) {
            *uses.entry(part).or_default() += 1;
        }
        for id in &results {
            *uses.entry(*id).or_default() += 1;
        }
        let mut count = 0;
        // How deep each part without a name is.
        let mut depths: HashMap<Id, usize> = HashMap::new();
        for id in reached {
            let expression = self.tape.get(id);
            let below = expression.parts().filter_map(|part| depths.get(&part));
            let depth = 1 + below.max().copied().unwrap_or(0);
            if expression.is_leaf() || self.at_once || self.tape.depends(id, self.in_place) {
                continue;
            }
            let label = self.labels.iter().find(|(known, _)| *known == id);
            let is_statement = self.is_statement(id);
            let is_result = results.contains(&id);
            let name = match label {
                Some((_, label)) => label.clone(),
                // A choice within a choice is a branch within a branch.
                None if uses[&id] > 1
                    || depth >= DEEPEST
                    || is_statement && !is_result && !self.is_within_choice(id, &results) =>
                {
                    count += 1;
                    format!("{}{count}", self.prefix)
                }
                None => {
                    depths.insert(id, depth);
                    continue;
                }
            };
            let name = self.syntax.symbol(&name);
            if is_statement {
                self.syntax.declare(&name, &mut lines);
                self.value(id, &mut lines, &|syntax, value, into| {
                    syntax.assign(&name, value, into);
                });
            } else {
                self.syntax.define(&name, &self.broken(id), &mut lines);
            }
            self.names.insert(id, name);
        }
        for (target, id) in targets {
            self.value(*id, &mut lines, &|syntax, value, into| {
                syntax.assign(target, value, into);
            });
        }
        lines
    }

    /// Whether an expression is a choice that is written as a statement: one between
    /// choices, or any where the language has no other way.
    fn is_statement(&self, id: Id) -> bool {
        let is_choice = |id| matches!(self.tape.get(id), Expression::Select(..));
        let Expression::Select(_, yes, no) = self.tape.get(id) else {
            return false;
        };
        self.syntax.has_statements()
            && (is_choice(yes) || is_choice(no) || self.syntax.select("", "", "").is_none())
    }

    /// Whether the only use of an expression is as an end of a choice.
    fn is_within_choice(&self, id: Id, results: &[Id]) -> bool {
        self.tape.reached(results).into_iter().any(|user| {
            matches!(self.tape.get(user), Expression::Select(_, yes, no) if yes == id || no == id)
        })
    }

    /// Writes what hands the value of an expression on.
    fn value(
        &self,
        id: Id,
        into: &mut Vec<String>,
        hand_on: &dyn Fn(&S, &Lines, &mut Vec<String>),
    ) {
        match self.tape.get(id) {
            Expression::Select(condition, yes, no)
                if !self.names.contains_key(&id)
                    && (self.is_statement(id)
                        || self.syntax.has_statements() && self.text(id).0.len() > WIDTH) =>
            {
                let [mut of_yes, mut of_no] = [vec![], vec![]];
                self.value(yes, &mut of_yes, hand_on);
                self.value(no, &mut of_no, hand_on);
                self.syntax
                    .branch(&self.condition(condition), &of_yes, &of_no, into);
            }
            _ => hand_on(self.syntax, &self.broken(id), into),
        }
    }

    fn condition(&self, condition: Condition) -> String {
        let [left, right] = [condition.left, condition.right].map(|id| self.text(id).0);
        self.syntax.condition(condition.relation, &left, &right)
    }

    /// A value, cut at its sums where it is long.
    fn broken(&self, id: Id) -> Lines {
        let (text, _) = self.text(id);
        if text.chars().count() <= WIDTH {
            return Lines(vec![text]);
        }
        let mut lines = vec![String::new()];
        let mut depth = 0_usize;
        let mut rest = text.as_str();
        while let Some(character) = rest.chars().next() {
            let is_sum = rest.starts_with(" + ") || rest.starts_with(" - ");
            let is_choice = rest.starts_with(" : ") || rest.starts_with(" else ");
            if depth == 0 && is_sum || is_choice {
                lines.push(String::new());
                rest = &rest[1..];
                continue;
            }
            match character {
                '(' => depth += 1,
                ')' => depth = depth.saturating_sub(1),
                _ => {}
            }
            if let Some(line) = lines.last_mut() {
                line.push(character);
            }
            rest = &rest[character.len_utf8()..];
        }
        Lines(lines)
    }

    fn text(&self, id: Id) -> (String, Tightness) {
        use Tightness::{Atom, Product, Sum};
        if let Some(name) = self.names.get(&id) {
            return (name.clone(), Atom);
        }
        match self.tape.get(id) {
            Expression::Literal(bits) => {
                let value = f64::from_bits(bits);
                let tightness = if value < 0.0 { Sum } else { Atom };
                if value.is_nan() {
                    (self.syntax.nan().to_owned(), Atom)
                } else {
                    (exact(value), tightness)
                }
            }
            Expression::Symbol(symbol) => (self.syntax.symbol(&self.tape.name(symbol)), Atom),
            Expression::Unary(Unary::Negate, x) => {
                (format!("-{}", within(&self.text(x), Product)), Sum)
            }
            Expression::Unary(function, x) => (self.syntax.unary(function, &self.text(x).0), Atom),
            Expression::Binary(function, x, y) => {
                // Once each: twice at every level would be 2ⁿ times for n terms of a sum.
                let (of_x, of_y) = (self.text(x), self.text(y));
                let infix = |sign: &str, left, right, own| {
                    let (left, right) = (within(&of_x, left), within(&of_y, right));
                    (format!("{left} {sign} {right}"), own)
                };
                match function {
                    Binary::Add => infix("+", Sum, Product, Sum),
                    Binary::Subtract => infix("-", Sum, Product, Sum),
                    Binary::Multiply => infix("*", Product, Atom, Product),
                    Binary::Divide => infix("/", Product, Atom, Product),
                    Binary::Max => (self.syntax.max(&of_x.0, &of_y.0), Atom),
                    Binary::Power => (self.syntax.power(&of_x.0, &of_y.0), Atom),
                    Binary::SignedPower => (self.syntax.signed_power(&of_x.0, &of_y.0), Atom),
                }
            }
            Expression::Select(condition, yes, no) => {
                let [yes, no] = [yes, no].map(|id| self.text(id).0);
                let text = self.syntax.select(&self.condition(condition), &yes, &no);
                (text.unwrap_or_default(), Atom)
            }
        }
    }
}

/// A part of an expression, in parentheses where it would fall apart.
fn within((text, tightness): &(String, Tightness), least: Tightness) -> String {
    if *tightness < least {
        format!("({text})")
    } else {
        text.clone()
    }
}

/// Lines one step further to the right.
pub fn indented(lines: &[String]) -> impl Iterator<Item = String> {
    lines.iter().map(|line| format!("    {line}"))
}
