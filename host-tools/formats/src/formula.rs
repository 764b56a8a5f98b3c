//! Compiles the text of a formula to a program.
//!
//! `a*tanh(w/b) + c*th^3` is parsed by precedence climbing (Pratt parser) in one pass that
//! emits the instructions of a [`Program`]; constant parts are computed at once. The parser
//! is our own, because fits need derivatives and errors need columns
//! (`docs/decisions/0044-effects-by-formula.md`).
//!
//! The text is untrusted: its length, its depth and its intermediate results are limited,
//! so that parsing is fast and cannot exhaust the stack.

use model_core::effects::custom::{Binary, Instruction, MAX_RESULTS, Operand, Program, Unary};
use model_core::effects::table::Variable;

use crate::numbers::short;

/// The most characters of a formula.
pub const LONGEST: usize = 1_000;

/// How deep parentheses, signs and powers may be nested.
const DEEPEST: usize = 40;

/// Whole exponents up to this one multiply; beyond, and with fractions, a power is only
/// of numbers that are not negative.
const LARGEST_WHOLE: f64 = 16.0;

/// The variables: how a formula spells them.
pub const VARIABLES: [(&str, Variable); 4] = [
    ("th", Variable::Angle),
    ("w", Variable::Rate),
    ("p", Variable::Pressure),
    ("t", Variable::Time),
];

const CONSTANTS: [(&str, f64); 1] = [("pi", std::f64::consts::PI)];

const FUNCTIONS: [(&str, Unary); 9] = [
    ("sin", Unary::Sin),
    ("cos", Unary::Cos),
    ("tan", Unary::Tan),
    ("tanh", Unary::Tanh),
    ("exp", Unary::Exp),
    ("log", Unary::Log),
    ("sqrt", Unary::Sqrt),
    ("abs", Unary::Abs),
    ("sign", Unary::Sign),
];

const FUNCTIONS_OF_TWO: [(&str, Binary); 3] = [
    ("pow", Binary::Power),
    ("min", Binary::Min),
    ("max", Binary::Max),
];

/// Common names that a formula does not know, with the names to use.
const OTHERWISE: [(&str, &str); 12] = [
    ("theta", "th"),
    ("angle", "th"),
    ("x", "th"),
    ("omega", "w"),
    ("rate", "w"),
    ("dth", "w"),
    ("thdot", "w"),
    ("pressure", "p"),
    ("time", "t"),
    ("ln", "log"),
    ("sgn", "sign"),
    ("fabs", "abs"),
];

/// Why a text is not a formula.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Where, as a byte of the text; its length at its end.
    pub at: usize,
    /// The text found there.
    pub found: String,
    /// Advice.
    pub advice: String,
}

impl Fault {
    fn new(at: usize, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            at,
            found: found.into(),
            advice: advice.into(),
        }
    }
}

/// A formula, read.
///
/// | binds | operators | side |
/// |---|---|---|
/// | least | `+` `-` | left |
/// | | `*` `/` | left |
/// | | sign `-` `+` | |
/// | most | `^` | right |
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    instructions: Vec<Instruction>,
    result: Operand,
    parameters: usize,
    memories: usize,
}

impl Formula {
    /// Reads a formula with these parameters.
    ///
    /// # Errors
    ///
    /// The first fault, with its place.
    pub fn parse(text: &str, parameters: &[&str]) -> Result<Self, Fault> {
        Self::with_memories(text, parameters, &[])
    }

    /// Reads a formula with these parameters and memories.
    ///
    /// # Errors
    ///
    /// The first fault, with its place.
    pub fn with_memories(
        text: &str,
        parameters: &[&str],
        memories: &[&str],
    ) -> Result<Self, Fault> {
        if let Some((at, _)) = text.char_indices().nth(LONGEST) {
            return Err(Fault::new(
                at,
                format!("the formula has more than {LONGEST} characters"),
                "make it shorter",
            ));
        }
        let mut parser = Parser {
            tokens: tokens(text)?,
            next: 0,
            end: text.len(),
            parameters,
            memories,
            instructions: Vec::new(),
            waiting: 0,
            depth: 0,
        };
        let result = parser.expression(0)?;
        let (at, token) = parser.peek();
        if token != Token::End {
            let advice = match token {
                Token::Close => "remove it, or open a parenthesis before it",
                Token::Comma => "a comma stands only between the two numbers of pow, min and max",
                _ => "put an operator before it: + - * / ^",
            };
            return Err(Fault::new(
                at,
                format!("{} is not expected here", token.shown()),
                advice,
            ));
        }
        Ok(Self {
            instructions: parser.instructions,
            result,
            parameters: parameters.len(),
            memories: memories.len(),
        })
    }

    /// Whether the parameter at this index occurs in the formula.
    pub fn uses(&self, parameter: usize) -> bool {
        self.operands()
            .any(|it| matches!(it, Operand::Parameter(index) if usize::from(index) == parameter))
    }

    /// Whether the memory at this index occurs in the formula.
    pub fn recalls(&self, memory: usize) -> bool {
        self.operands()
            .any(|it| matches!(it, Operand::Memory(index) if usize::from(index) == memory))
    }

    /// The variables that occur in the formula.
    pub fn variables(&self) -> Vec<Variable> {
        let reads = |variable| self.operands().any(|it| it == Operand::Variable(variable));
        Variable::ALL.into_iter().filter(|&it| reads(it)).collect()
    }

    fn operands(&self) -> impl Iterator<Item = Operand> {
        let of_instructions = self.instructions.iter().flat_map(|it| match *it {
            Instruction::Unary { x, .. } => [x, x],
            Instruction::Binary { x, y, .. } => [x, y],
        });
        of_instructions.chain([self.result])
    }

    /// The program.
    pub fn program(&self) -> Option<Program<'_>> {
        Program::new(
            &self.instructions,
            self.result,
            self.parameters,
            self.memories,
        )
    }

    /// The program for as long as this one runs.
    pub fn leaked(self) -> Option<Program<'static>> {
        let instructions = Box::leak(self.instructions.into_boxed_slice());
        Program::new(instructions, self.result, self.parameters, self.memories)
    }
}

/// A formula with numbers in place of its parameters, in three digits: `0.012*p*tanh(w/0.05)`. A
/// text that is not a formula is returned as it is.
pub fn with_values(text: &str, values: &[(&str, f64)]) -> String {
    let Ok(tokens) = tokens(text) else {
        return text.to_owned();
    };
    let mut shown = String::new();
    let mut copied = 0;
    for (at, token) in tokens {
        let Token::Name(name) = token else {
            continue;
        };
        let Some((_, value)) = values.iter().find(|(known, _)| *known == name) else {
            continue;
        };
        shown += &text[copied..at];
        // With a sign that a formula can have.
        let number = short(*value).replace('\u{2212}', "-");
        // Only at the beginning a sign needs no parentheses.
        let is_first = shown.is_empty();
        shown += &if number.starts_with('-') && !is_first {
            format!("({number})")
        } else {
            number
        };
        copied = at + name.len();
    }
    shown + &text[copied..]
}

/// Whether a name is one that a parameter can have.
pub fn is_name(text: &str) -> bool {
    let mut letters = text.chars();
    letters
        .next()
        .is_some_and(|first| first.is_ascii_alphabetic())
        && letters.all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
}

/// The meaning of a name that is not a parameter.
pub fn meaning(name: &str) -> Option<&'static str> {
    if VARIABLES.iter().any(|(known, _)| *known == name) {
        Some("a variable")
    } else if CONSTANTS.iter().any(|(known, _)| *known == name) {
        Some("a constant")
    } else if names_of_functions().any(|known| known == name) {
        Some("a function")
    } else {
        None
    }
}

fn names_of_functions() -> impl Iterator<Item = &'static str> {
    let one = FUNCTIONS.iter().map(|(name, _)| *name);
    one.chain(FUNCTIONS_OF_TWO.iter().map(|(name, _)| *name))
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Token<'t> {
    Number(f64),
    Name(&'t str),
    Operator(char),
    Open,
    Close,
    Comma,
    End,
}

impl Token<'_> {
    fn shown(self) -> String {
        match self {
            Self::Number(number) => format!("the number {number}"),
            Self::Name(name) => format!("\"{name}\""),
            Self::Operator(sign) => format!("\"{sign}\""),
            Self::Open => "\"(\"".to_owned(),
            Self::Close => "\")\"".to_owned(),
            Self::Comma => "\",\"".to_owned(),
            Self::End => "the end of the formula".to_owned(),
        }
    }
}

/// The words of a formula, each with its place.
fn tokens(text: &str) -> Result<Vec<(usize, Token<'_>)>, Fault> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(letter) = text[at..].chars().next() {
        let rest = &text[at..];
        let (token, length) = match letter {
            _ if letter.is_whitespace() => {
                at += letter.len_utf8();
                continue;
            }
            '+' | '-' | '*' | '/' | '^' => (Token::Operator(letter), 1),
            '(' => (Token::Open, 1),
            ')' => (Token::Close, 1),
            ',' => (Token::Comma, 1),
            '0'..='9' | '.' => {
                let length = length_of_number(rest);
                let number: Option<f64> = rest[..length].parse().ok();
                let number = number.filter(|number| number.is_finite()).ok_or_else(|| {
                    Fault::new(
                        at,
                        format!("\"{}\" is not a number", &rest[..length]),
                        "write numbers as 2, 0.5 or 1e-3",
                    )
                })?;
                (Token::Number(number), length)
            }
            _ if letter.is_alphabetic() || letter == '_' => {
                let is_part = |letter: char| letter.is_alphanumeric() || letter == '_';
                let length = rest.find(|letter| !is_part(letter)).unwrap_or(rest.len());
                (Token::Name(&rest[..length]), length)
            }
            _ => {
                let advice = match letter {
                    '[' | '{' | ']' | '}' => "use parentheses ( )",
                    '|' => "write abs(x) for |x|",
                    '−' | '–' => "use the minus sign of the keyboard",
                    '·' | '×' => "write * for a product",
                    _ => "a formula has numbers, names, + - * / ^ ( ) and commas",
                };
                return Err(Fault::new(
                    at,
                    format!("'{letter}' has no meaning in a formula"),
                    advice,
                ));
            }
        };
        tokens.push((at, token));
        at += length;
    }
    Ok(tokens)
}

/// The bytes of the number with which a text begins: digits, a point, an exponent.
fn length_of_number(text: &str) -> usize {
    let digits = |from: usize| {
        let rest = text.get(from..).unwrap_or("");
        from + rest
            .find(|letter: char| !letter.is_ascii_digit())
            .unwrap_or(rest.len())
    };
    let mut end = digits(0);
    if text[end..].starts_with('.') {
        end = digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = text[end + 1..].starts_with(['+', '-']);
        let from = end + 1 + usize::from(sign);
        let exponent = digits(from);
        // Without digits it is a name that begins with e, not an exponent.
        if exponent > from {
            end = exponent;
        }
    }
    end
}

struct Parser<'t> {
    tokens: Vec<(usize, Token<'t>)>,
    next: usize,
    end: usize,
    parameters: &'t [&'t str],
    memories: &'t [&'t str],
    instructions: Vec<Instruction>,
    /// Results that wait to be read. Expressions nest, so they are in the places below
    /// this one, and those that the next instruction reads are the last of them.
    waiting: usize,
    depth: usize,
}

/// How strongly a sign before a number binds: more than `*`, less than `^`.
const SIGN: u8 = 30;

impl<'t> Parser<'t> {
    fn peek(&self) -> (usize, Token<'t>) {
        let end = (self.end, Token::End);
        self.tokens.get(self.next).copied().unwrap_or(end)
    }

    fn take(&mut self) -> (usize, Token<'t>) {
        let token = self.peek();
        self.next += 1;
        token
    }

    /// An expression whose operators bind at least as strongly as `least`.
    fn expression(&mut self, least: u8) -> Result<Operand, Fault> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(Fault::new(
                self.peek().0,
                "the formula is nested too deeply",
                format!("leave out parentheses: {DEEPEST} may stand in each other"),
            ));
        }
        let mut left = self.operand()?;
        loop {
            let (at, token) = self.peek();
            let Token::Operator(sign) = token else { break };
            let (function, binds, right) = match sign {
                '+' => (Binary::Sum, 10, 11),
                '-' => (Binary::Difference, 10, 11),
                '*' => (Binary::Product, 20, 21),
                '/' => (Binary::Quotient, 20, 21),
                // From the right: 2^3^2 is 2^9.
                _ => (Binary::Power, 40, 40),
            };
            if binds < least {
                break;
            }
            self.next += 1;
            if sign == '*' && matches!(self.peek().1, Token::Operator('*')) {
                return Err(Fault::new(
                    at,
                    "\"**\" is not an operator",
                    "write ^ for a power",
                ));
            }
            let right = self.expression(right)?;
            left = self.binary(at, function, left, right)?;
        }
        self.depth -= 1;
        Ok(left)
    }

    /// A number, a name, a function of something, or an expression in parentheses.
    fn operand(&mut self) -> Result<Operand, Fault> {
        let (at, token) = self.take();
        match token {
            Token::Number(number) => Ok(Operand::Constant(number)),
            Token::Operator('-') => {
                let x = self.expression(SIGN)?;
                self.unary(at, Unary::Negative, x)
            }
            Token::Operator('+') => self.expression(SIGN),
            Token::Open => {
                let inner = self.expression(0)?;
                self.close(at)?;
                Ok(inner)
            }
            Token::Name(name) => self.name(at, name),
            token => Err(Fault::new(
                at,
                format!("a number or a name is missing before {}", token.shown()),
                "complete the formula there",
            )),
        }
    }

    fn name(&mut self, at: usize, name: &str) -> Result<Operand, Fault> {
        let is_call = self.peek().1 == Token::Open;
        let find = |known: &[&str]| {
            let place = known.iter().position(|known| *known == name);
            place.and_then(|index| u8::try_from(index).ok())
        };
        if let Some((_, function)) = FUNCTIONS.iter().find(|(known, _)| *known == name) {
            let [x] = self.arguments(at, name)?;
            return self.unary(at, *function, x);
        }
        if let Some((_, function)) = FUNCTIONS_OF_TWO.iter().find(|(known, _)| *known == name) {
            let [x, y] = self.arguments(at, name)?;
            return self.binary(at, *function, x, y);
        }
        let value = if let Some((_, variable)) = VARIABLES.iter().find(|(known, _)| *known == name)
        {
            Operand::Variable(*variable)
        } else if let Some((_, number)) = CONSTANTS.iter().find(|(known, _)| *known == name) {
            Operand::Constant(*number)
        } else if let Some(index) = find(self.parameters) {
            Operand::Parameter(index)
        } else if let Some(index) = find(self.memories) {
            Operand::Memory(index)
        } else {
            return Err(self.unknown(at, name, is_call));
        };
        if is_call {
            return Err(Fault::new(
                self.peek().0,
                format!("\"{name}\" is not a function"),
                format!("write {name}*( for a product"),
            ));
        }
        Ok(value)
    }

    fn unknown(&self, at: usize, name: &str, is_call: bool) -> Fault {
        let functions: Vec<&str> = names_of_functions().collect();
        let mut values: Vec<&str> = VARIABLES.iter().map(|(name, _)| *name).collect();
        values.extend(CONSTANTS.iter().map(|(name, _)| *name));
        values.extend(self.parameters);
        values.extend(self.memories);
        let (what, known) = if is_call {
            ("function", functions)
        } else {
            ("variable or parameter", values)
        };
        let otherwise = OTHERWISE
            .iter()
            .find(|(written, _)| name.eq_ignore_ascii_case(written))
            .map(|(_, meant)| *meant)
            .filter(|meant| known.contains(meant));
        let nearest = otherwise.or_else(|| nearest(name, &known));
        let list = known.join(", ");
        let advice = match nearest {
            Some(nearest) => format!("did you mean {nearest}? There are {list}"),
            None => format!("use one of: {list}"),
        };
        Fault::new(at, format!("there is no {what} \"{name}\""), advice)
    }

    fn arguments<const N: usize>(&mut self, at: usize, name: &str) -> Result<[Operand; N], Fault> {
        let usage = || {
            let arguments = ["x", "y"].get(..N).unwrap_or(&[]).join(", ");
            format!("write {name}({arguments})")
        };
        let (place, token) = self.take();
        if token != Token::Open {
            return Err(Fault::new(
                at,
                format!("{name} is a function without its parentheses"),
                usage(),
            ));
        }
        let mut arguments = [Operand::Constant(0.0); N];
        for (index, argument) in arguments.iter_mut().enumerate() {
            if index > 0 {
                let (at, token) = self.take();
                if token != Token::Comma {
                    return Err(Fault::new(
                        at,
                        format!("{} stands where {name} needs a comma", token.shown()),
                        usage(),
                    ));
                }
            }
            *argument = self.expression(0)?;
        }
        if let (at, Token::Comma) = self.peek() {
            return Err(Fault::new(
                at,
                format!("{name} takes {N} and not more"),
                usage(),
            ));
        }
        self.close(place)?;
        Ok(arguments)
    }

    fn close(&mut self, opened: usize) -> Result<(), Fault> {
        match self.take() {
            (_, Token::Close) => Ok(()),
            (_, Token::End) => Err(Fault::new(
                opened,
                "this parenthesis is not closed",
                "add the missing )",
            )),
            (at, token) => Err(Fault::new(
                at,
                format!("{} stands where ) or an operator should", token.shown()),
                "put an operator before it: + - * / ^",
            )),
        }
    }

    fn unary(&mut self, at: usize, function: Unary, x: Operand) -> Result<Operand, Fault> {
        if let Operand::Constant(number) = x {
            return constant(at, function.of(number));
        }
        let into = self.place(at, &[x])?;
        self.instructions
            .push(Instruction::Unary { function, x, into });
        Ok(Operand::Result(into))
    }

    fn binary(
        &mut self,
        at: usize,
        function: Binary,
        x: Operand,
        y: Operand,
    ) -> Result<Operand, Fault> {
        if let (Operand::Constant(x), Operand::Constant(y)) = (x, y) {
            let is_whole = function == Binary::Power && whole(y).is_some();
            let value = match whole(y).filter(|_| is_whole) {
                Some(n) => Unary::Whole(n).of(x),
                None => function.of(x, y),
            };
            return constant(at, value);
        }
        if let (Binary::Power, Operand::Constant(exponent)) = (function, y)
            && let Some(n) = whole(exponent)
        {
            return self.unary(at, Unary::Whole(n), x);
        }
        let into = self.place(at, &[x, y])?;
        self.instructions.push(Instruction::Binary {
            function,
            x,
            y,
            into,
        });
        Ok(Operand::Result(into))
    }

    /// Where the result of what reads these goes.
    fn place(&mut self, at: usize, reads: &[Operand]) -> Result<u8, Fault> {
        let is_result = |operand: &&Operand| matches!(operand, Operand::Result(_));
        let place = self.waiting - reads.iter().filter(is_result).count();
        self.waiting = place + 1;
        u8::try_from(place)
            .ok()
            .filter(|_| place < MAX_RESULTS)
            .ok_or_else(|| {
                Fault::new(
                    at,
                    "the formula keeps too many results at once",
                    "put its longest part first, or leave out parentheses",
                )
            })
    }
}

/// A small whole exponent.
fn whole(exponent: f64) -> Option<i8> {
    #[allow(clippy::cast_possible_truncation)] // It is whole and small.
    (exponent.fract() == 0.0 && exponent.abs() <= LARGEST_WHOLE).then_some(exponent as i8)
}

fn constant(at: usize, value: f64) -> Result<Operand, Fault> {
    if value.is_finite() {
        Ok(Operand::Constant(value))
    } else {
        Err(Fault::new(
            at,
            format!("this is {value}, whatever the state is"),
            "correct the numbers there",
        ))
    }
}

/// The known name that a slip of the keyboard may have changed into this one.
fn nearest<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    known
        .iter()
        .map(|known| {
            let distance = strsim::osa_distance(&name.to_lowercase(), known);
            (distance, known.len().abs_diff(name.len()), *known)
        })
        .filter(|(distance, _, known)| *distance <= if known.len() > 3 { 2 } else { 1 })
        .min()
        .map(|(.., known)| known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::effects::Instant;
    use proptest::prelude::*;

    const PARAMETERS: [&str; 3] = ["a", "b", "c"];
    const VALUES: [f64; 3] = [0.7, 1.3, -0.4];
    const NO_MEMORY: [f64; 2] = [0.0; 2];
    /// th = 0.6 rad, w = −0.8 rad/s, p = 20 kPa, t = 3 s.
    const STATE: [f64; 4] = [0.6, -0.8, 20.0, 3.0];

    fn at(state: [f64; 4]) -> Instant<f64> {
        let [angle, rate, kpa, time] = state;
        Instant {
            time,
            angle,
            rate,
            pressure: 1_000.0 * kpa,
        }
    }

    fn value(text: &str) -> f64 {
        let formula = Formula::parse(text, &PARAMETERS).unwrap_or_else(|fault| {
            panic!("{text}: {fault:?}");
        });
        formula
            .program()
            .unwrap()
            .at(&VALUES, &at(STATE), &NO_MEMORY)
    }

    fn fault(text: &str) -> Fault {
        match Formula::parse(text, &PARAMETERS) {
            Err(fault) => fault,
            Ok(formula) => panic!("{text}: {formula:?}"),
        }
    }

    /// Beside closures in which Rust's own rules say what binds.
    #[test]
    fn formulas_mean_what_they_say() {
        let ([a, b, c], [th, w, p, t]) = (VALUES, STATE);
        for (text, expected) in [
            ("a*tanh(w/b) + c*th^3", a * (w / b).tanh() + c * th.powi(3)),
            ("a - b - c", a - b - c),
            ("a / b / c", a / b / c),
            ("a - b * c / th + w", a - b * c / th + w),
            ("-a^2", -(a * a)),
            ("(-a)^2", a * a),
            ("2^3^2", 512.0),
            ("2^-1", 0.5),
            ("a^-b*c", a.powf(-b) * c),
            ("--a + +b", a + b),
            ("a*-b", a * -b),
            ("w^3", w.powi(3)),
            ("w^-2", w.powi(-2)),
            ("abs(w)^1.5*sign(w)", -w.abs().powf(1.5)),
            ("pow(th, 2) + pow(th, b)", th * th + th.powf(b)),
            ("min(a, b)*max(c, th)", a * th),
            ("p*t", p * t),
            ("sin(th)*cos(th) + tan(th)", th.sin() * th.cos() + th.tan()),
            (
                "exp(-abs(w)/b) + log(p) + sqrt(t)",
                (w / b).exp() + p.ln() + t.sqrt(),
            ),
            ("sin(pi*th)", (std::f64::consts::PI * th).sin()),
            ("1e-3*th + .5 + 2.", 1e-3 * th + 2.5),
            ("1e3", 1_000.0),
            ("(((a)))", a),
            (
                "a*(b+(c-(th*(w/(p+(t-a))))))",
                a * (b + (c - th * (w / (p + (t - a))))),
            ),
            (
                "(a+b)*(c+th)*((w+p)/(t+a))",
                (a + b) * (c + th) * ((w + p) / (t + a)),
            ),
            (
                "sin(a*b)*sin(b*c)+(sin(c*a)+sin(th*a)*sin(w*a))",
                (a * b).sin() * (b * c).sin() + ((c * a).sin() + (th * a).sin() * (w * a).sin()),
            ),
        ] {
            let found = value(text);
            let room = 1e-12 * expected.abs().max(1.0);
            assert!(
                (found - expected).abs() < room,
                "{text}: {found} instead of {expected}"
            );
        }
    }

    #[test]
    fn faults_say_where_they_are() {
        for (text, place, found) in [
            ("", 0, "missing before the end"),
            ("a*", 2, "missing before the end"),
            ("a*(b+c", 2, "not closed"),
            ("a*b)", 3, "\")\" is not expected"),
            ("2th", 1, "\"th\" is not expected"),
            ("a b", 2, "\"b\" is not expected"),
            ("a(b)", 1, "not a function"),
            ("sin th", 0, "without its parentheses"),
            ("sin()", 4, "missing before \")\""),
            ("sin(a, b)", 5, "takes 1"),
            ("pow(a)", 5, "needs a comma"),
            ("a # b", 2, "'#' has no meaning"),
            ("a*θ", 2, "\"θ\""),
            ("tan(a) ** 2", 7, "\"**\" is not an operator"),
            ("1.2.3", 3, "is not expected"),
            ("1e999*a", 0, "not a number"),
            ("a + log(0)", 4, "-inf"),
            ("a + 1/0", 5, "inf"),
            ("a, b", 1, "\",\" is not expected"),
            ("(a b)", 3, "should"),
        ] {
            let fault = fault(text);
            assert_eq!(fault.at, place, "{text}: {fault:?}");
            assert!(fault.found.contains(found), "{text}: {fault:?}");
            assert!(!fault.advice.is_empty());
        }
    }

    #[test]
    fn unknown_names_come_with_what_was_meant() {
        for (text, meant) in [
            ("a*theta", "th"),
            ("a*Omega", "w"),
            ("A*w", "a"),
            ("ln(th)", "log"),
            ("tahn(w)", "tanh"),
            ("sqr(w)", "sqrt"),
            ("PI*th", "pi"),
        ] {
            let advice = fault(text).advice;
            let expected = format!("did you mean {meant}?");
            assert!(advice.starts_with(&expected), "{text}: {advice}");
        }
        assert!(
            fault("zzzz*th")
                .advice
                .starts_with("use one of: th, w, p, t, pi, a, b, c")
        );
    }

    #[test]
    fn hostile_formulas_are_refused() {
        let deep = |n: usize| format!("{}a{}", "(".repeat(n), ")".repeat(n));
        assert_eq!(value(&deep(30)).to_bits(), VALUES[0].to_bits());
        assert!(fault(&deep(450)).found.contains("nested"));
        assert!(fault(&"(".repeat(999)).found.contains("nested"));
        assert!(fault(&"-".repeat(999)).found.contains("nested"));
        assert!(fault(&"a^".repeat(400)).found.contains("nested"));
        assert!(fault(&"sin(".repeat(200)).found.contains("nested"));
        assert!(fault(&"é".repeat(1_001)).found.contains("characters"));
        // Sums are long and not deep.
        let long = vec!["a"; 500].join("+");
        assert!((value(&long) - 350.0).abs() < 1e-9);
        // Each opens a product that waits for what is in its parentheses.
        let wide = |n: usize| format!("{}a{}", "a*b+(".repeat(n), ")".repeat(n));
        assert!(value(&wide(14)).is_finite());
        assert!(fault(&wide(20)).found.contains("too many results"));
    }

    #[test]
    fn what_a_formula_uses_is_known() {
        let formula = Formula::parse("a*sin(3*th) + w*0", &PARAMETERS).unwrap();
        assert_eq!(
            [0, 1, 2].map(|index| formula.uses(index)),
            [true, false, false]
        );
        assert_eq!(formula.variables(), [Variable::Angle, Variable::Rate]);
        assert_eq!(
            with_values("(a + b*p)*tanh(w/b)", &[("a", 0.0123), ("b", -2.0)]),
            "(0.0123 + (-2.00)*p)*tanh(w/(-2.00))"
        );
        assert_eq!(with_values("c*th", &[("c", -0.5)]), "-0.500*th");
        assert!(is_name("k_2") && !is_name("2k") && !is_name("") && !is_name("a-b"));
        assert_eq!(meaning("tanh"), Some("a function"));
        assert_eq!(meaning("a"), None);
    }

    type OfOne = fn(f64) -> f64;
    type OfTwo = fn(f64, f64) -> f64;

    /// A formula of a tree, with every parenthesis, and what it is by closures.
    #[derive(Clone, Debug)]
    enum Tree {
        Leaf(&'static str, f64),
        Function(&'static str, OfOne, Box<Tree>),
        Operator(char, OfTwo, Box<Tree>, Box<Tree>),
    }

    impl Tree {
        fn text(&self) -> String {
            match self {
                Self::Leaf(name, _) => (*name).to_owned(),
                Self::Function(name, _, x) => format!("{name}({})", x.text()),
                Self::Operator(sign, _, x, y) => format!("({} {sign} {})", x.text(), y.text()),
            }
        }

        fn value(&self) -> f64 {
            match self {
                Self::Leaf(_, value) => *value,
                Self::Function(_, function, x) => function(x.value()),
                Self::Operator(_, operator, x, y) => operator(x.value(), y.value()),
            }
        }

        fn is_deep(&self, left: usize) -> bool {
            left == 0
                || match self {
                    Self::Leaf(..) => false,
                    Self::Function(_, _, x) => x.is_deep(left - 1),
                    Self::Operator(_, _, x, y) => x.is_deep(left - 1) || y.is_deep(left - 1),
                }
        }
    }

    fn trees() -> impl Strategy<Value = Tree> {
        let leaf = prop::sample::select(vec![
            ("a", VALUES[0]),
            ("b", VALUES[1]),
            ("c", VALUES[2]),
            ("th", STATE[0]),
            ("w", STATE[1]),
            ("p", STATE[2]),
            ("t", STATE[3]),
            ("2", 2.0),
            ("0.25", 0.25),
        ]);
        let leaf = leaf.prop_map(|(name, value)| Tree::Leaf(name, value));
        leaf.prop_recursive(7, 60, 2, |inner| {
            let functions: Vec<(&str, OfOne)> = vec![
                ("sin", f64::sin),
                ("cos", f64::cos),
                ("tanh", f64::tanh),
                ("abs", f64::abs),
                ("-", |x| -x),
            ];
            let operators: Vec<(char, OfTwo)> = vec![
                ('+', |x, y| x + y),
                ('-', |x, y| x - y),
                ('*', |x, y| x * y),
                ('/', |x, y| x / y),
            ];
            prop_oneof![
                (prop::sample::select(functions), inner.clone())
                    .prop_map(|((name, function), x)| Tree::Function(name, function, x.into())),
                (prop::sample::select(operators), inner.clone(), inner)
                    .prop_map(|((sign, by), x, y)| Tree::Operator(sign, by, x.into(), y.into())),
            ]
        })
    }

    /// Texts of the signs that formulas are made of.
    fn texts() -> impl Strategy<Value = String> {
        let parts = prop::sample::select(vec![
            "a", "b", "c", "th", "w", "p", "t", "pi", "sin", "pow", "min", "log", "sqrt", "sign",
            "(", ")", ",", "+", "-", "*", "/", "^", " ", "2", "0.5", "1e3", "e", ".", "x", "é",
        ]);
        prop::collection::vec(parts, 0..60).prop_map(|parts| parts.concat())
    }

    proptest! {
        #[test]
        fn formulas_compute_what_closures_do(tree in trees()) {
            let (text, expected) = (tree.text(), tree.value());
            match Formula::parse(&text, &PARAMETERS) {
                Ok(formula) => {
                    let found = formula.program().unwrap().at(&VALUES, &at(STATE), &NO_MEMORY);
                    let room = 1e-9 * expected.abs().max(1.0);
                    prop_assert!(
                        (found - expected).abs() <= room || !expected.is_finite(),
                        "{text}: {found} instead of {expected}"
                    );
                }
                // Constants that divide by nothing, and what is too deep.
                Err(fault) => prop_assert!(
                    fault.found.contains("whatever the state") || tree.is_deep(5),
                    "{text}: {fault:?}"
                ),
            }
        }

        /// Any text is a program or a fault that points into it, and any program ends.
        #[test]
        fn any_text_is_a_formula_or_a_fault(text in prop_oneof![texts(), any::<String>()], state in prop::array::uniform4(any::<f64>())) {
            match Formula::parse(&text, &PARAMETERS) {
                Ok(formula) => {
                    let program = formula.program();
                    prop_assert!(program.is_some(), "{text}");
                    if let Some(program) = program {
                        let _ = program.at(&VALUES, &at(state), &NO_MEMORY);
                        let [angle, rate, pressure, time] = [0.0_f32; 4];
                        let _ = program.at(&[0.0_f32; 3], &Instant { time, angle, rate, pressure }, &[0.0; 2]);
                    }
                }
                Err(fault) => prop_assert!(text.is_char_boundary(fault.at), "{text}: {fault:?}"),
            }
        }
    }
}
