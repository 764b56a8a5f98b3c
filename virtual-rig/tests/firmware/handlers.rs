// SPDX-License-Identifier: GPL-3.0-or-later
//! The interrupts that are written twice, in assembly for the usual and in Rust for all: from the same
//! state of the machine both do the same.
//!
//! States are those of a rig that homes, in which what a handler looks at is drawn anew. Peripherals are taken
//! away, so that nothing but the state decides; what is written to their registers is compared in order.

use std::collections::BTreeMap;

use object::{
    Endianness,
    elf::{FileHeader32, SHT_SYMTAB},
    read::elf::{FileHeader, Sym},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use virtual_rig::alone::{Alone, Data, Handled};
use wire::command::Command;

use crate::bench::{Bench, elf, healthy, image};

const STATES: usize = 20_000;

// Data-space addresses of the ATmega2560, from its data sheet.
const PINB: u16 = 0x23;
const PIND: u16 = 0x29;
const PINE: u16 = 0x2c;
const GPIOR1: u16 = 0x4a;
const GPIOR2: u16 = 0x4b;
const SPL: u16 = 0x5d;
const SREG: u16 = 0x5f;
const ADCL: u16 = 0x78;
const ADCSRA: u16 = 0x7a;
const ADMUX: u16 = 0x7c;
const TCNT1: u16 = 0x84;
const OCR1A: u16 = 0x88;
const UCSR0B: u16 = 0xc1;
const UDR0: u16 = 0xc6;

/// Deeper than any handler's stack.
const SCRATCH: u16 = 300;

struct Machine {
    alone: Alone,
    symbols: BTreeMap<String, u32>,
    /// A rig that homes, at several times.
    states: Vec<Data>,
    random: Pcg64Mcg,
}

impl Machine {
    fn new(seed: u64) -> Option<Self> {
        let mut bench = Bench::start(healthy())?;
        bench.obey(Command::Arm);
        let states = (0..20)
            .map(|_| {
                bench.run(0.2037);
                let bytes: Vec<u8> = (0..0x2200).map(|at| bench.rig.data(at)).collect();
                Data::new(bytes.try_into().expect("the whole data space"))
            })
            .collect();
        Some(Self {
            alone: Alone::new(&image()?).expect("a processor"),
            symbols: symbols(&elf()?),
            states,
            random: Pcg64Mcg::seed_from_u64(seed),
        })
    }

    /// The address of a symbol of the board layer, by the end of its mangled name.
    fn at(&self, name: &str) -> u32 {
        let mut found = self.symbols.iter().filter(|(symbol, _)| {
            let symbol = symbol.strip_suffix(".0").unwrap_or(symbol);
            symbol == name || symbol.contains("5board") && symbol.ends_with(name)
        });
        let (_, &address) = found.next().unwrap_or_else(|| panic!("no symbol {name}"));
        assert!(found.next().is_none(), "several symbols {name}");
        address
    }

    fn variable(&self, name: &str) -> u16 {
        u16::try_from(self.at(name) & 0xffff).expect("sixteen bits")
    }

    /// A rig that homes, interrupted anywhere: registers, flags and stack are drawn.
    fn state(&mut self) -> Data {
        let mut state = self.states[self.random.random_range(0..self.states.len())].clone();
        self.random.fill(&mut state[..32]);
        put(&mut state, SREG, self.random.random::<u8>() | 0x80);
        put_word(&mut state, SPL, self.random.random_range(0x1c00..0x2100));
        state
    }

    fn below(&mut self, end: u8) -> u8 {
        self.random.random_range(0..end)
    }

    fn flag(&mut self) -> u8 {
        self.below(2)
    }

    /// A gap of the pulses: none, a short one, or one that is longer than a turn of the counter.
    fn gap(&mut self) -> u32 {
        match self.below(4) {
            0 => 0,
            1 => self.random.random_range(65_536..2_000_000),
            _ => self.random.random_range(400..65_536),
        }
    }

    fn enter(&mut self, state: &Data, at: u32, through: u32) -> Handled {
        let handled = self.alone.enter(state, at, through);
        handled.expect("the handler returns")
    }
}

/// Holds two results against each other. What is below the stack, and where assembly keeps what it
/// saves, is nobody's.
#[track_caller]
fn same(state: &Data, one: &Handled, other: &Handled) {
    let stack = word(state, SPL);
    let matters =
        |at: u16| !(stack - SCRATCH..=stack).contains(&at) && at != GPIOR1 && at != GPIOR2;
    for at in (0..0x2200).filter(|&at| matters(at)) {
        let (before, a, b) = (byte(state, at), byte(&one.data, at), byte(&other.data, at));
        assert_eq!(a, b, "at {at:#x}, where {before:#x} was");
    }
    for at in (0..32).chain([SPL, SPL + 1]) {
        assert_eq!(
            byte(state, at),
            byte(&one.data, at),
            "register {at:#x} is kept"
        );
    }
    assert_eq!(byte(state, SREG), byte(&one.data, SREG), "flags are kept");
    let peripherals = |handled: &Handled| -> Vec<(u16, u8)> {
        let writes = handled.writes.iter().copied();
        writes
            .filter(|&(at, _)| matters(at) && !(SPL..=SREG).contains(&at))
            .collect()
    };
    assert_eq!(peripherals(one), peripherals(other));
}

/// Both ways were tried often enough.
#[track_caller]
fn tried(slow: usize) {
    println!("{slow} of {STATES} states went on into Rust");
    assert!((STATES / 10..9 * STATES / 10).contains(&slow), "{slow}");
}

#[test]
fn a_conversion_is_the_same_in_assembly_and_in_rust() {
    let Some(mut machine) = Machine::new(1) else {
        return;
    };
    let (fast, full) = (machine.at("__vector_29"), machine.at("3adc9converted"));
    let [ends, count] = ["3adc4ENDS", "3adc5COUNT"].map(|name| machine.variable(name));
    let sums = ["3adc12PRESSURE_SUM", "3adc8FLEX_SUM"].map(|name| machine.variable(name));
    let wanted = machine.variable("3adc16IS_SUPPLY_WANTED");
    let mut slow = 0;
    for _ in 0..STATES {
        let mut state = machine.state();
        put(&mut state, ends, u8::from(machine.below(8) == 0));
        put(&mut state, count, machine.below(34));
        put(&mut state, wanted, machine.flag());
        for sum in sums {
            // Fifteen of ten bits, with or without a gap.
            let drawn = machine.random.random_range(0..=15 * 1_023_u16);
            let gap = u16::from(machine.flag()) << 15;
            put_word(&mut state, sum, drawn | gap);
        }
        let channel = [0x40, 0x41, 0x5e][usize::from(machine.below(3))];
        put(&mut state, ADMUX, channel);
        // Near what counts as no contact as often as anywhere.
        let end = [64, 1_024][usize::from(machine.flag())];
        let sample = machine.random.random_range(0..end);
        put_word(&mut state, ADCL, sample);
        let usual = machine.enter(&state, fast, full);
        let all = machine.enter(&state, full, full);
        same(&state, &usual, &all);
        slow += usize::from(usual.passed);
    }
    tried(slow);
}

#[test]
fn an_edge_is_the_same_in_assembly_and_in_rust() {
    let Some(mut machine) = Machine::new(2) else {
        return;
    };
    let (fast, full) = (machine.at("__vector_17"), machine.at("6pulses4edge"));
    let [short, made, waited] =
        ["6pulses9SHORT_GAP", "6pulses4MADE", "6pulses6WAITED"].map(|name| machine.variable(name));
    let mut slow = 0;
    for _ in 0..STATES {
        let mut state = machine.state();
        let gap = u16::try_from(machine.gap()).unwrap_or(0);
        put_word(&mut state, short, gap);
        // Its lower byte goes over as often as not.
        let steps = machine.random.random::<u16>() | (u16::from(machine.flag()) * 0xff);
        put_word(&mut state, made, steps);
        put_word(&mut state, waited, machine.random.random());
        put(&mut state, PINB, machine.random.random());
        let edge = match machine.below(4) {
            // The next one is near a turn of the counter.
            0 => gap
                .wrapping_neg()
                .wrapping_add(u16::from(machine.below(40))),
            1 => 400_u16
                .wrapping_neg()
                .wrapping_add(u16::from(machine.below(40))),
            _ => machine.random.random(),
        };
        let late = match machine.below(8) {
            0 => machine.random.random(),
            1 => machine.random.random_range(250..400),
            _ => machine.random.random_range(10..256),
        };
        put_word(&mut state, OCR1A, edge);
        put_word(&mut state, TCNT1, edge.wrapping_add(late));
        let usual = machine.enter(&state, fast, full);
        let all = machine.enter(&state, full, full);
        same(&state, &usual, &all);
        slow += usize::from(usual.passed);
    }
    tried(slow);
}

/// The beat starts its conversion and counts in assembly only; what a slot needs beside is in Rust.
#[test]
fn a_beat_starts_its_conversion_and_every_fourth_a_slot() {
    let Some(mut machine) = Machine::new(3) else {
        return;
    };
    let (fast, full) = (machine.at("__vector_32"), machine.at("5clock4slot"));
    let beat = machine.variable("5clock4BEAT");
    let gaps = machine.variable("6pulses4GAPS");
    let [in_use, slot, late] =
        ["6pulses6IN_USE", "6pulses4SLOT", "6pulses4LATE"].map(|name| machine.variable(name));
    let flags = [
        "6pulses10COMPRESSES",
        "6pulses15NEXT_COMPRESSES",
        "6pulses13IS_NEXT_READY",
        "6pulses10IS_RUNNING",
        "6pulses9IS_HALTED",
        "6pulses8IS_HOMED",
    ]
    .map(|name| machine.variable(name));
    let mut slow = 0;
    for _ in 0..STATES {
        let mut state = machine.state();
        for at in [beat, PINB, PIND, PINE] {
            put(&mut state, at, machine.random.random());
        }
        put(
            &mut state,
            ADCSRA,
            0x8f | machine.random.random::<u8>() & 0x50,
        );
        for place in 0..16 {
            let gap = machine.gap().to_le_bytes();
            for (at, byte) in (gaps + 4 * place..).zip(gap) {
                put(&mut state, at, byte);
            }
        }
        put(&mut state, in_use, 8 * machine.flag());
        put(&mut state, slot, machine.below(8));
        put(&mut state, late, machine.below(3));
        for flag in flags {
            put(&mut state, flag, machine.flag());
        }
        put_word(&mut state, TCNT1, machine.random.random());
        let handled = machine.enter(&state, fast, full);

        let mut after = state.clone();
        let mut writes = Vec::new();
        if byte(&state, ADCSRA) & 0x50 == 0 {
            put(&mut after, ADCSRA, 0xcf);
            writes.push((ADCSRA, 0xcf));
        }
        let beats = byte(&state, beat).wrapping_add(1);
        put(&mut after, beat, beats);
        let begins = beats.is_multiple_of(4);
        let mut expected = Handled {
            data: after.clone(),
            writes: Vec::new(),
            passed: begins,
        };
        if begins {
            expected = machine.enter(&after, full, full);
        }
        expected.writes.splice(0..0, writes);
        same(&state, &handled, &expected);
        assert_eq!(handled.passed, begins);
        slow += usize::from(begins);
    }
    tried(slow);
}

/// Sending is in assembly only: it takes what `Ring::pop` would.
#[test]
fn a_byte_is_sent_as_the_ring_has_it() {
    let Some(mut machine) = Machine::new(4) else {
        return;
    };
    let send = machine.at("__vector_26");
    let ring = machine.variable("6serial7TO_SEND");
    let (head, tail) = (ring + 256, ring + 257);
    let mut empty = 0;
    for _ in 0..STATES {
        let mut state = machine.state();
        for at in (ring..=tail).chain([UCSR0B]) {
            put(&mut state, at, machine.random.random());
        }
        if machine.flag() == 0 {
            let at = byte(&state, head);
            put(&mut state, tail, at);
        }
        let handled = machine.enter(&state, send, send);

        let mut data = state.clone();
        let at = byte(&state, tail);
        let (register, value) = if at == byte(&state, head) {
            empty += 1;
            (UCSR0B, byte(&state, UCSR0B) & !0x20)
        } else {
            put(&mut data, tail, at.wrapping_add(1));
            (UDR0, byte(&state, ring + u16::from(at)))
        };
        put(&mut data, register, value);
        let writes = vec![(register, value)];
        let passed = true;
        same(
            &state,
            &handled,
            &Handled {
                data,
                writes,
                passed,
            },
        );
    }
    tried(empty);
}

fn byte(data: &Data, at: u16) -> u8 {
    data[usize::from(at)]
}

fn word(data: &Data, at: u16) -> u16 {
    u16::from_le_bytes([byte(data, at), byte(data, at + 1)])
}

fn put(data: &mut Data, at: u16, value: u8) {
    data[usize::from(at)] = value;
}

fn put_word(data: &mut Data, at: u16, value: u16) {
    let [low, high] = value.to_le_bytes();
    put(data, at, low);
    put(data, at + 1, high);
}

/// Names and addresses of an ELF file.
fn symbols(elf: &[u8]) -> BTreeMap<String, u32> {
    let header = FileHeader32::<Endianness>::parse(elf).expect("an ELF file");
    let endian = header.endian().expect("an order of bytes");
    let sections = header.sections(endian, elf).expect("sections");
    let table = sections.symbols(endian, elf, SHT_SYMTAB).expect("symbols");
    let named = table.iter().filter_map(|symbol| {
        let name = symbol.name(endian, table.strings()).ok()?;
        let name = String::from_utf8(name.to_vec()).ok()?;
        Some((name, symbol.st_value(endian)))
    });
    named.collect()
}
