//! The deepest that the stack can be, from the disassembly of an image.
//!
//! A run shows how deep the stack was; what it did not try stays unknown. Here every function has the
//! registers that it pushes, its frame and the arguments that it pushes, every call three bytes
//! of return address, and the deepest path through the graph of calls is added up. Interrupts do
//! not nest: the deepest one comes on top of the deepest path of the main program.
//!
//! Whether a path can be taken is not asked, so this is a bound. There is none if a function calls
//! itself or an address that is computed; the image may have neither.
//!
//! That interrupts do not nest is the second question to the same graph: see [`nesting`].

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::shell::Outcome;

/// A return address on a processor of more than 128 KiB.
const RETURN_ADDRESS: u64 = 3;

/// The main program, which the start-up code calls.
const MAIN: &str = "main";

/// Where the processor finds the handlers, and the one of interrupts that have none, which starts anew.
const VECTORS: &str = "__vectors";
const NO_HANDLER: &str = "__bad_interrupt";

/// SREG among the ports and in memory, and GPIOR2, in which `firmware/src/board/entry.rs` keeps it.
const SREG: &str = "0x3f";
const SREG_IN_MEMORY: &str = "0x005F";
const KEPT: &str = "0x2b";

/// Instructions whose first operand is only read.
const READING: [&str; 6] = ["push", "tst", "cp", "cpc", "cpi", "cpse"];

/// Instructions behind which the next one in memory does not follow. A call at the end of a function
/// does not return.
const ENDS: [&str; 8] = [
    "ret", "reti", "jmp", "rjmp", "ijmp", "eijmp", "call", "rcall",
];

/// Instructions in which a frame that was computed reaches the stack pointer.
const FRAME_IS_SET_WITHIN: usize = 8;

/// How the stack can be at its deepest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Bytes, the deepest interrupt included.
    pub bytes: u64,
    /// The deepest path of the main program: a function, and what it alone takes.
    pub path: Vec<(String, u64)>,
}

/// An instruction: its name, its operands, and where it leads.
struct Instruction<'text> {
    name: &'text str,
    operands: &'text str,
    target: Option<u64>,
}

/// A function: what it takes, and the functions that it calls or goes on in.
#[derive(Default)]
struct Function {
    own: u64,
    calls: Vec<(u64, u64)>,
    is_indirect: bool,
    /// The instruction that may switch interrupts on.
    switches_on: Option<String>,
    /// It ends as a handler does, which switches them on too.
    ends_interrupt: bool,
}

/// Adds up an image from the output of `avr-objdump -d --no-show-raw-insn`.
pub fn bound(disassembly: &str) -> Outcome<Bound> {
    let (names, code) = parse(disassembly);
    let functions = functions(&names, &code);
    let start = names
        .iter()
        .find(|(_, name)| **name == MAIN)
        .map(|(&at, _)| at)
        .ok_or("the image has no function `main`")?;
    let mut depths = Depths {
        names: &names,
        functions: &functions,
        known: HashMap::new(),
        open: HashSet::new(),
    };
    let (main, path) = depths.of(start)?;
    let mut interrupt = 0;
    for at in handlers(&names, &code)? {
        interrupt = interrupt.max(RETURN_ADDRESS + depths.of(at)?.0);
    }
    let path = path
        .into_iter()
        .map(|at| (plain(names[&at]), functions[&at].own))
        .collect();
    Ok(Bound {
        bytes: RETURN_ADDRESS + main + interrupt,
        path,
    })
}

/// What could let an interrupt come while another is served: everything that a handler of the table
/// reaches has interrupts off up to the `reti` at its end. What is written to SREG must be what was
/// read from it; a store to an address that is computed is not looked at.
pub fn nesting(disassembly: &str) -> Outcome<Vec<String>> {
    let (names, code) = parse(disassembly);
    let functions = functions(&names, &code);
    let mut wrong = Vec::new();
    for handler in handlers(&names, &code)? {
        let mut seen = HashSet::new();
        let mut open = vec![(handler, false)];
        while let Some((at, is_called)) = open.pop() {
            let Some(function) = functions.get(&at).filter(|_| seen.insert((at, is_called))) else {
                continue;
            };
            let why = match &function.switches_on {
                _ if function.is_indirect => Some("an address that is computed"),
                Some(instruction) => Some(instruction.as_str()),
                None => (is_called && function.ends_interrupt).then_some("reti, called"),
            };
            wrong.extend(why.map(|why| {
                format!(
                    "interrupts may nest: {} comes to `{why}` in {}",
                    names[&handler],
                    plain(names[&at])
                )
            }));
            let calls = function.calls.iter();
            open.extend(calls.map(|&(to, cost)| (to, is_called || cost > 0)));
        }
    }
    Ok(wrong)
}

type Names<'text> = BTreeMap<u64, &'text str>;
type Code<'text> = BTreeMap<u64, Vec<Instruction<'text>>>;

/// The handlers of the vector table, whose first entry is the reset.
fn handlers(names: &Names<'_>, code: &Code<'_>) -> Outcome<HashSet<u64>> {
    let table = names.iter().find(|(_, name)| **name == VECTORS);
    let table = table.and_then(|(at, _)| code.get(at)).into_iter().flatten();
    let handlers: HashSet<u64> = table
        .skip(1)
        .filter_map(|entry| entry.target)
        .filter(|at| names.get(at).is_none_or(|name| *name != NO_HANDLER))
        .collect();
    match handlers.iter().find(|at| !code.contains_key(at)) {
        Some(at) => Err(format!("an interrupt leads to {at:#x}, where no function begins").into()),
        None if handlers.is_empty() => Err("the image has no interrupt handlers".into()),
        None => Ok(handlers),
    }
}

fn functions(names: &Names<'_>, code: &Code<'_>) -> BTreeMap<u64, Function> {
    let owner = |address: u64| names.range(..=address).next_back().map(|(&at, _)| at);
    code.iter()
        .map(|(&at, instructions)| {
            let mut function = function(at, instructions, owner);
            if let Some(last) = instructions.last()
                && !ENDS.contains(&last.name)
            {
                let next = names.range(at + 1..).next();
                function.calls.extend(next.map(|(&next, _)| (next, 0)));
            }
            (at, function)
        })
        .collect()
}

/// Where functions begin, and their instructions. What begins with a dot is a label within one.
fn parse(disassembly: &str) -> (Names<'_>, Code<'_>) {
    let mut names = Names::new();
    let mut code = Code::new();
    let mut now = None;
    for line in disassembly.lines() {
        if let Some((at, name)) = line
            .strip_suffix(">:")
            .and_then(|line| line.split_once(" <"))
        {
            if name.starts_with('.') {
                continue;
            }
            if let Ok(at) = u64::from_str_radix(at, 16) {
                names.entry(at).or_insert(name);
                code.entry(at).or_default();
                now = Some(at);
            }
            continue;
        }
        let mut fields = line.trim_start().splitn(3, '\t');
        let (Some(at), Some(name)) = (fields.next(), fields.next()) else {
            continue;
        };
        if !at.ends_with(':') {
            continue;
        }
        let (operands, remark) = match fields.next() {
            Some(rest) => rest.split_once(';').unwrap_or((rest, "")),
            None => ("", ""),
        };
        let target = remark
            .split_whitespace()
            .next()
            .and_then(|word| u64::from_str_radix(word.strip_prefix("0x")?, 16).ok());
        if let Some(code) = now.and_then(|at| code.get_mut(&at)) {
            code.push(Instruction {
                name: name.trim(),
                operands: operands.trim(),
                target,
            });
        }
    }
    (names, code)
}

fn function(at: u64, instructions: &[Instruction], owner: impl Fn(u64) -> Option<u64>) -> Function {
    let mut function = Function::default();
    for (index, instruction) in instructions.iter().enumerate() {
        let rest = &instructions[index + 1..];
        if function.switches_on.is_none() && switches_on(instruction, &instructions[..index]) {
            let text = format!("{} {}", instruction.name, instruction.operands);
            function.switches_on = Some(text.trim_end().to_owned());
        }
        function.ends_interrupt |= instruction.name == "reti";
        match instruction.name {
            "push" => function.own += 1,
            "sbiw" | "subi" => function.own += frame(instruction, rest),
            "icall" | "eicall" | "ijmp" | "eijmp" => function.is_indirect = true,
            name => {
                let is_call = matches!(name, "call" | "rcall");
                let leads_on = is_call || matches!(name, "jmp" | "rjmp") || name.starts_with("br");
                let Some(to) = instruction.target.filter(|_| leads_on).and_then(&owner) else {
                    continue;
                };
                if is_call {
                    function.calls.push((to, RETURN_ADDRESS));
                } else if to != at {
                    function.calls.push((to, 0));
                }
            }
        }
    }
    function
}

/// Whether an instruction may switch interrupts on, unless it ends one: whether it does, or writes to
/// SREG what was not read from there, perhaps by way of the stack or of GPIOR2.
fn switches_on(instruction: &Instruction, before: &[Instruction]) -> bool {
    let Instruction { name, operands, .. } = *instruction;
    let Some((to, from)) = operands.split_once(", ") else {
        return name == "sei";
    };
    if !(name == "out" && to == SREG) {
        return name == "sts" && to == SREG_IN_MEMORY;
    }
    let source = before
        .iter()
        .rev()
        .find(|it| it.operands.split(", ").next() == Some(from) && !READING.contains(&it.name));
    let is_kept = |by: &str, operands: &dyn Fn(&str) -> String| {
        before.windows(2).any(|pair| {
            let register = pair[0].operands.strip_suffix(", 0x3f");
            pair[0].name == "in"
                && pair[1].name == by
                && register.is_some_and(|register| pair[1].operands == operands(register))
        })
    };
    !source.is_some_and(|it| match (it.name, it.operands.split_once(", ")) {
        ("pop", _) => is_kept("push", &str::to_owned),
        ("in", Some((_, SREG))) => true,
        ("in", Some((_, KEPT))) => is_kept("out", &|register| format!("{KEPT}, {register}")),
        _ => false,
    })
}

/// The bytes by which an instruction lowers the stack pointer: it subtracts from Y, of which Y then
/// goes to the stack pointer. Raising it again is a subtraction of a negative number.
fn frame(instruction: &Instruction, rest: &[Instruction]) -> u64 {
    let number = |instruction: &Instruction, register: &str| {
        let (to, number) = instruction.operands.split_once(", ")?;
        let number = number.strip_prefix("0x")?;
        (to == register)
            .then(|| u64::from_str_radix(number, 16).ok())
            .flatten()
    };
    let Some(low) = number(instruction, "r28") else {
        return 0;
    };
    let high = match (instruction.name, rest.first()) {
        ("subi", Some(next)) if next.name == "sbci" => number(next, "r29").unwrap_or(0),
        ("subi", _) => return 0,
        _ => 0,
    };
    let bytes = high << 8 | low;
    let is_set = rest
        .iter()
        .take(FRAME_IS_SET_WITHIN)
        .any(|next| next.name == "out" && next.operands.starts_with("0x3d"));
    if is_set && bytes < 0x8000 { bytes } else { 0 }
}

struct Depths<'a> {
    names: &'a Names<'a>,
    functions: &'a BTreeMap<u64, Function>,
    known: HashMap<u64, (u64, Vec<u64>)>,
    open: HashSet<u64>,
}

impl Depths<'_> {
    /// The deepest path that begins in a function.
    fn of(&mut self, at: u64) -> Outcome<(u64, Vec<u64>)> {
        if let Some(known) = self.known.get(&at) {
            return Ok(known.clone());
        }
        let Some(function) = self.functions.get(&at) else {
            return Ok((0, Vec::new()));
        };
        let name = self.names[&at];
        if function.is_indirect {
            return Err(format!(
                "{} calls what it computed: the stack has no bound",
                plain(name)
            )
            .into());
        }
        if !self.open.insert(at) {
            // avr-libc's arithmetic jumps to and fro and calls the common ends of its
            // functions, which call nothing.
            return if name.starts_with("__") {
                Ok((0, Vec::new()))
            } else {
                Err(format!("{} calls itself: the stack has no bound", plain(name)).into())
            };
        }
        let mut deepest = (0, Vec::new());
        for &(to, cost) in &function.calls {
            let (bytes, path) = self.of(to)?;
            if bytes + cost > deepest.0 {
                deepest = (bytes + cost, path);
            }
        }
        self.open.remove(&at);
        let mut path = vec![at];
        path.extend(deepest.1);
        let found = (function.own + deepest.0, path);
        self.known.insert(at, found.clone());
        Ok(found)
    }
}

/// A symbol as a person reads it: the last two names in it. Names have their length before them;
/// what follows `Cs` is the number of a crate.
fn plain(symbol: &str) -> String {
    let mut names = Vec::new();
    let mut rest = symbol;
    while let Some(start) = rest.find(|letter: char| letter.is_ascii_digit()) {
        if let Some((before, after)) = rest.split_once("Cs")
            && before.len() < start
        {
            rest = after.split_once('_').map_or("", |(_, after)| after);
            continue;
        }
        let digits = &rest[start..];
        let end = digits
            .find(|letter: char| !letter.is_ascii_digit())
            .unwrap_or(digits.len());
        let after = &digits[end..];
        let length = digits[..end].parse().unwrap_or(0);
        match after.get(..length) {
            Some(name) if name.starts_with(|letter: char| letter.is_ascii_alphabetic()) => {
                names.push(name);
                rest = &after[length..];
            }
            _ => rest = after,
        }
    }
    match names.as_slice() {
        [] => symbol.to_owned(),
        [.., a, b] => format!("{a}::{b}"),
        [a] => (*a).to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two pushed registers and a near frame of five bytes, a call of a function with a far
    /// frame of 300, and an interrupt that jumps to what pushes three more.
    const IMAGE: &str = "\
00000000 <__vectors>:
   0:\tjmp\t0x30\t; 0x30 <main>
   4:\tjmp\t0x10\t; 0x10 <__vector_17>
   8:\tjmp\t0xc\t; 0xc <__bad_interrupt>

0000000c <__bad_interrupt>:
   c:\tjmp\t0\t; 0x0 <__vectors>

00000010 <__vector_17>:
  10:\tpush\tr24
  12:\tpop\tr24
  14:\tjmp\t0x20\t; 0x20 <edge>

00000020 <edge>:
  20:\tpush\tr0
  22:\tpush\tr1
  24:\tpush\tr2
  26:\treti

00000030 <main>:
  30:\tpush\tr28
  32:\tpush\tr29
  34:\tin\tr28, 0x3d\t; 61
  36:\tsbiw\tr28, 0x05\t; 5
  38:\tout\t0x3e, r29\t; 62
  3a:\tout\t0x3d, r28\t; 61
  3c:\tcall\t0x50\t; 0x50 <deep>
  3e:\tadiw\tr28, 0x05\t; 5

00000050 <deep>:
  50:\tsubi\tr28, 0x2C\t; 44
  52:\tsbci\tr29, 0x01\t; 1
  54:\tout\t0x3e, r29\t; 62
  56:\tout\t0x3d, r28\t; 61

00000058 <.loop>:
  58:\tbrne\t.-2\t; 0x58 <.loop>
  5a:\tsubi\tr28, 0xD4\t; 212
  5c:\tsbci\tr29, 0xFE\t; 254
  5e:\tout\t0x3d, r28\t; 61
  60:\tret
";

    #[test]
    fn registers_frames_calls_and_the_deepest_interrupt_are_added() {
        let found = bound(IMAGE).unwrap();
        let main = 3 + 7 + 3 + 300;
        assert_eq!(found.bytes, main + 3 + 1 + 3);
        assert_eq!(
            found.path,
            [("main".to_owned(), 7), ("deep".to_owned(), 300)]
        );
    }

    #[test]
    fn what_has_no_bound_is_refused() {
        let itself = IMAGE.replace("  60:\tret", "  60:\trcall\t.-18\t; 0x50 <deep>");
        let said = bound(&itself).unwrap_err().to_string();
        assert!(said.contains("deep calls itself"), "{said}");
        let computed = IMAGE.replace("  60:\tret", "  60:\ticall");
        assert!(bound(&computed).is_err());
        // What nobody calls is data.
        let data = format!("{IMAGE}\n00000080 <TEXT>:\n  80:\tijmp\n");
        assert!(bound(&data).is_ok());
        assert!(bound("").is_err());
    }

    /// The image with another instruction or several in the second of the handler's functions.
    fn with(instructions: &str) -> String {
        let lines = instructions.split("; ").map(|it| it.replacen(' ', "\t", 1));
        IMAGE.replace(
            "push\tr1\n",
            &(lines.collect::<Vec<_>>().join("\n  22:\t") + "\n"),
        )
    }

    #[test]
    fn an_interrupt_that_lets_others_in_is_found() {
        let wrong = |image: &str| nesting(image).unwrap();
        for off in [
            "push r1",
            "in r0, 0x3f; push r0; cpi r0, 0x80; pop r0; out 0x3f, r0",
            "in r24, 0x3f; out 0x2b, r24; ldi r24, 0x80; in r24, 0x2b; out 0x3f, r24",
            "in r0, 0x3f; cli; out 0x3e, r29; out 0x3f, r0; out 0x3d, r28",
            "out 0x3e, r0",
        ] {
            assert_eq!(wrong(&with(off)), [""; 0], "{off}");
        }
        for on in [
            "sei",
            "ldi r24, 0x80; out 0x3f, r24",
            "in r24, 0x3f; ori r24, 0x80; out 0x3f, r24",
            "pop r0; out 0x3f, r0",
            "in r24, 0x2b; out 0x3f, r24",
            "sts 0x005F, r24",
            "ijmp",
        ] {
            let said = wrong(&with(on));
            assert!(
                said.len() == 1 && said[0].contains("__vector_17"),
                "{on}: {said:?}"
            );
        }
        let falls = IMAGE.replace("  14:\tjmp\t0x20\t; 0x20 <edge>\n", "");
        let falls = falls.replace("  22:\tpush\tr1", "  22:\tsei");
        assert_eq!(wrong(&falls).len(), 1);
        let called = IMAGE.replace("  14:\tjmp\t", "  14:\tcall\t");
        assert!(wrong(&called)[0].contains("reti, called"));
        // The main program may, and what has no table shows nothing.
        assert!(wrong(&IMAGE.replace("  60:\tret", "  60:\tsei")).is_empty());
        assert!(nesting(&IMAGE.replace("__vectors", "vectors")).is_err());
        assert!(nesting(&IMAGE.replace("; 0x10 <", "; 0x12 <")).is_err());
    }

    #[test]
    fn symbols_are_shortened() {
        let symbol = "_RNvNtCsk5biBv9X7Uf_8firmware8settings5check";
        assert_eq!(plain(symbol), "settings::check");
        assert_eq!(plain("__mulsf3x"), "__mulsf3x");
    }
}
