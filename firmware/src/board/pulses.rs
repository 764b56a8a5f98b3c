//! Step pulses: edges by hardware, everything else beside them.
//!
//! Timer 1 counts freely at the processor's clock, and its compare unit A
//! toggles the STEP pin by itself when the counter reaches OCR1A. An edge is
//! thus exact to a cycle however late its interrupt is served; the interrupt only
//! has to name the time of the next edge before that has come, 400 cycles later
//! at the earliest. A pulse is always high for the same 25 µs; the gap after it
//! makes the rate. A gap longer than the counter's 65 536 cycles is waited for in
//! hops of compare unit B, half a turn each, while unit A stays parked one turn
//! ahead.
//!
//! The main program hands over a [`Plan`] for a whole control period; the clock's
//! interrupt takes its slots one by one. When the main program is late, the last
//! rate goes on for a period: then it hangs, and the pulses stop. So they do
//! within two looks at a pressed emergency stop or at an end switch that the plunger
//! runs into, without waiting for the main program.

use core::mem::size_of;

use avr_device::atmega2560::{TC1, tc1::RegisterBlock as Timer};
use firmware::{
    byte::Byte,
    io,
    stepper::{HIGH_CYCLES, Plan, Planner, SHORTEST_GAP, SLOTS},
    wiring,
};

use super::{
    entry::{enter, handler, restore},
    pins::{is_at, pin_type},
    registers::{OCR1A, TCNT1},
    shared::{self, CriticalSection, Shared, SharedByte, SharedFlag},
    switches::{self, PUSHED, RETRACTED, STOP},
};

type Step = pin_type!(Output, STEP);
type Direction = pin_type!(Output, DIRECTION);
type Enable = pin_type!(Output, ENABLE);

const _: () = assert!(
    is_at(wiring::STEP, b'B', 5),
    "compare unit A of timer 1 is on PB5"
);

/// Cycles that an interrupt needs to set the next edge.
const LEAD: u16 = 60;

/// Cycles after which the start of a long gap is handed to unit B.
const HANDOVER: u16 = 200;

/// A hop of a long wait: half a turn of the counter.
const HOP: u16 = 0x8000;

#[allow(clippy::cast_possible_truncation)]
const LAST_SLOT: u8 = SLOTS as u8 - 1;

/// What leads from one plan's place in the list to the other's.
#[allow(clippy::cast_possible_truncation)]
const OTHER: u8 = SLOTS as u8;

/// The gap in use (cycles); zero is a standstill.
static GAP: Shared<u32> = Shared::new(0);
/// Cycles waited in a long gap, in hops.
static WAITED: Shared<u32> = Shared::new(0);
/// The gap in use if it is shorter than a turn of the counter; else zero.
static SHORT_GAP: Shared<u16> = Shared::new(0);
/// Microsteps made, counted in the direction of [`COMPRESSES`]: a step adds one, whichever that
/// is, and turning round changes the sign. Wraps, and the main program looks often enough to tell
/// how far it went.
static MADE: Shared<u16> = Shared::new(0);
/// Whether steps push the plunger in.
static COMPRESSES: SharedFlag = SharedFlag::new(true);
/// Edges are being made.
static IS_RUNNING: Shared<bool> = Shared::new(false);

/// The gaps of the plan in use and of the one to come, in one list: indices into
/// it can be masked instead of checked.
static GAPS: [Shared<u32>; 2 * SLOTS] = [const { Shared::new(0) }; 2 * SLOTS];
const _: () = assert!(SLOTS.is_power_of_two());
/// Where the plan in use begins.
static IN_USE: SharedByte = SharedByte::new(0);
/// Whether the plan to come compresses.
static NEXT_COMPRESSES: SharedFlag = SharedFlag::new(false);
/// The other one is complete and begins with the next period.
static IS_NEXT_READY: SharedFlag = SharedFlag::new(false);
/// The slot that comes next.
static SLOT: SharedByte = SharedByte::new(0);
/// Periods that began without a new plan since the one in use did.
static LATE: SharedByte = SharedByte::new(0);
/// With so many, the main program hangs: three periods have gone by since the plan in use
/// began, four at most since the main program did anything.
const LATEST: u8 = 2;

/// Whether either end switch stops pulses in either direction: the plunger is homed and
/// stands clear of both. Else only the one that it moves towards does.
static IS_HOMED: SharedFlag = SharedFlag::new(true);
/// The switches that stopped pulses since the main program last looked.
static STOPPED_BY: SharedByte = SharedByte::new(0);

/// Stopped at once; slots are passed over until a new plan begins.
static IS_HALTED: SharedFlag = SharedFlag::new(true);

/// The pump's motor driver.
pub struct Pulses {
    timer: TC1,
    planner: Planner,
    /// Microsteps of [`MADE`] that are in `position`.
    counted: u16,
    position: i32,
    enable: Enable,
    _direction: Direction,
    _step: Step,
}

impl Pulses {
    /// Creates the driver, disabled.
    ///
    /// # Safety
    ///
    /// Only once: the pins have one owner.
    pub unsafe fn new(timer: TC1) -> Self {
        // SAFETY: passed on.
        let (mut enable, mut direction, step) =
            unsafe { (Enable::new(), Direction::new(), Step::new()) };
        enable.high();
        // As `COMPRESSES` is at first.
        direction.high();
        // Counts freely, no prescaler, pin disconnected.
        timer.tccr1b.write(|w| w.cs1().direct());
        Self {
            timer,
            planner: Planner::new(),
            counted: 0,
            position: 0,
            enable,
            _direction: direction,
            _step: step,
        }
    }

    /// Does what the control logic asks for. `acceleration` is in microsteps/s²; a plunger
    /// that `is_homed` stands clear of both end switches.
    pub fn obey(&mut self, pump: io::Pump, acceleration: f32, is_homed: bool) {
        IS_HOMED.set(is_homed);
        match pump {
            io::Pump::Off => {
                self.halt();
                self.enable.high();
            }
            io::Pump::Brake => {
                self.halt();
                self.enable.low();
            }
            io::Pump::Rate(rate) => {
                self.enable.low();
                // Every plan goes on from the one before and has to be played: one
                // that was late, and still waits for its period, stays.
                if IS_NEXT_READY.acquire() {
                    return;
                }
                let Plan { compress, gaps } = self.planner.plan(rate, acceleration);
                // The interrupt does not look at it before it is ready.
                NEXT_COMPRESSES.set(compress);
                let next = usize::from(IN_USE.get()) ^ SLOTS;
                for (place, gap) in GAPS.iter().skip(next).zip(gaps) {
                    shared::free(|section| place.set(section, gap));
                }
                IS_NEXT_READY.release(true);
            }
        }
    }

    /// Stops at once; a pulse that has begun ends by itself.
    fn halt(&mut self) {
        self.planner.halt();
        shared::free(|section| {
            IS_NEXT_READY.release(false);
            IS_HALTED.set(true);
            set_gap(section, 0);
            stop(section, &self.timer);
        });
    }

    /// The switches that stopped the pulses since the last look.
    pub fn stopped_by(&mut self) -> u8 {
        shared::free(|_| {
            let switches = STOPPED_BY.get();
            STOPPED_BY.set(0);
            switches
        })
    }

    /// Microsteps made since the position was last set; positive compresses.
    pub fn position(&mut self) -> i32 {
        let made = shared::free(|section| {
            let made = MADE.get(section);
            if COMPRESSES.get() {
                made
            } else {
                made.wrapping_neg()
            }
        });
        // At most 200 a control period.
        #[allow(clippy::cast_possible_wrap)]
        let since = made.wrapping_sub(self.counted) as i16;
        self.counted = made;
        self.position = self.position.wrapping_add(i32::from(since));
        self.position
    }

    /// Declares the position of the last look to be this.
    pub fn set_position(&mut self, steps: i32) {
        self.position = steps;
    }
}

/// Names the time of the next edge: `ahead` cycles after the one at `edge`, or as
/// soon as possible when that has passed.
#[inline(always)]
fn set_edge(timer: &Timer, edge: u16, ahead: u16) {
    let now = timer.tcnt1.read().bits();
    let at = if now.wrapping_sub(edge).wrapping_add(LEAD) < ahead {
        edge.wrapping_add(ahead)
    } else {
        now.wrapping_add(LEAD)
    };
    timer.ocr1a.write(|w| w.bits(at));
}

/// Waits for the end of a long gap, of which `waited` is over at `now`: sets the
/// next edge if it is near, else hops.
fn wait(section: CriticalSection<'_>, timer: &Timer, now: u16, waited: u32) {
    let left = GAP.get(section).saturating_sub(waited);
    let is_near = left <= u32::from(u16::MAX);
    #[allow(clippy::cast_possible_truncation)] // Compared above.
    if is_near {
        set_edge(timer, now, left as u16);
    } else {
        WAITED.set(section, waited + u32::from(HOP));
        // Unit A stays parked: it would match in a turn, and unit B hops before.
        timer.ocr1a.write(|w| w.bits(now));
        timer.ocr1b.write(|w| w.bits(now.wrapping_add(HOP)));
        timer.tifr1.write(|w| w.ocf1b().set_bit());
    }
    timer.timsk1.write(|w| {
        w.ocie1a().set_bit();
        w.ocie1b().bit(!is_near)
    });
}

/// Starts the pulses, the first one a gap from now.
fn start(section: CriticalSection<'_>, timer: &Timer) {
    IS_RUNNING.set(section, true);
    wait(section, timer, timer.tcnt1.read().bits(), 0);
    // The compare register is set, so no old match can come any more; one that
    // has come is forgotten, and only then may a match move the pin.
    timer.tifr1.write(|w| w.ocf1a().set_bit());
    timer.tccr1a.write(|w| w.com1a().match_toggle());
}

/// Stops the pulses unless one has begun; the end of that one will.
fn stop(section: CriticalSection<'_>, timer: &Timer) {
    if !IS_RUNNING.get(section) || Step::is_set() {
        return;
    }
    // Out of the counter's way, then look whether the edge was faster.
    let now = timer.tcnt1.read().bits();
    timer.ocr1a.write(|w| w.bits(now.wrapping_sub(LEAD)));
    if timer.tifr1.read().ocf1a().bit_is_set() {
        // It was: its interrupt is pending and lets the pulse end.
        return;
    }
    disconnect(section, timer);
}

/// Takes the pin from the timer. It falls back to its port bit, which is low.
fn disconnect(section: CriticalSection<'_>, timer: &Timer) {
    timer.timsk1.reset();
    timer.tccr1a.reset();
    IS_RUNNING.set(section, false);
}

/// A slot of the plan begins; called by the clock.
#[inline(always)]
pub(super) fn slot(section: CriticalSection<'_>, is_first: bool) {
    // SAFETY: the main program touches the timer in critical sections only.
    let timer = unsafe { &*TC1::ptr() };
    if is_first {
        if IS_NEXT_READY.acquire() {
            begin_plan(section, timer);
        } else {
            LATE.set(LATE.get().saturating_add(1));
        }
    }
    if IS_HALTED.get() {
        return;
    }
    // A switch that let go before the main program looked still counts: the plan that
    // was made meanwhile knows nothing of it.
    let stopping = switches::now() & stopping() | STOPPED_BY.get();
    if stopping != 0 || LATE.get() >= LATEST {
        STOPPED_BY.set(STOPPED_BY.get() | stopping);
        IS_HALTED.set(true);
        set_gap(section, 0);
        stop(section, timer);
        return;
    }
    let slot = SLOT.get();
    let index = usize::from(IN_USE.get() | slot) & (2 * SLOTS - 1);
    let gap = GAPS[index].get(section);
    if slot < LAST_SLOT {
        SLOT.set(slot + 1);
    }
    set_gap(section, gap);
    if gap == 0 {
        stop(section, timer);
    } else if !IS_RUNNING.get(section) {
        start(section, timer);
    }
}

/// The switches that stop the pulses.
#[inline(always)]
fn stopping() -> u8 {
    let ends = if IS_HOMED.get() {
        RETRACTED | PUSHED
    } else if COMPRESSES.get() {
        PUSHED
    } else {
        RETRACTED
    };
    ends | STOP
}

#[inline(always)]
fn set_gap(section: CriticalSection<'_>, gap: u32) {
    GAP.set(section, gap);
    SHORT_GAP.set(section, u16::try_from(gap).unwrap_or(0));
}

/// The plan to come is the one in use now.
fn begin_plan(section: CriticalSection<'_>, timer: &Timer) {
    IS_NEXT_READY.release(false);
    IS_HALTED.set(false);
    LATE.set(0);
    IN_USE.set(IN_USE.get() ^ OTHER);
    SLOT.set(0);
    let compresses = NEXT_COMPRESSES.get();
    if compresses == COMPRESSES.get() {
        return;
    }
    // The planner reverses at standstill only. Were it ever otherwise, the motor
    // would run away: rather no pulses at all.
    if IS_RUNNING.get(section) {
        IS_HALTED.set(true);
        set_gap(section, 0);
        stop(section, timer);
        return;
    }
    // The first edge is at least 25 µs away, longer than any driver wants to see
    // the direction before.
    COMPRESSES.set(compresses);
    MADE.set(section, MADE.get(section).wrapping_neg());
    // SAFETY: the pin's owner hands it to this interrupt.
    let mut direction = unsafe { Direction::new() };
    if compresses {
        direction.high();
    } else {
        direction.low();
    }
}

// An edge was made. With 28 000 of them a second this is the interrupt that
// counts, and written in assembly it takes 45 cycles. It does the usual alone; what is not usual,
// being late or a gap that is no short one, it leaves untouched to `edge`
// below, which can do it all. Which of a pulse's two edges it was, the pin says.
handler!(
    "
    .section .text.softrig_edge,\"ax\",@progbits
    .global __vector_17
    .type __vector_17,@function
__vector_17:                        ; TIMER1_COMPA
    ",
    enter!(),
    "
    push r25
    push r26

    lds  r24, {tcnt1}
    lds  r25, {tcnt1}+1
    lds  r26, {ocr1a}               ; when the edge was
    sub  r24, r26
    lds  r24, {ocr1a}+1
    sbc  r25, r24
    tst  r25
    brne 2f                         ; 256 cycles ago or more
    sbis {pin}, {bit}
    rjmp 1f

    subi r26, {minus_high_low}      ; a pulse has begun: its end
    sbci r24, {minus_high_high}
    sts  {ocr1a}+1, r24
    sts  {ocr1a}, r26
    lds  r24, {made}
    inc  r24
    sts  {made}, r24
    breq 3f
    pop  r26
    pop  r25
    ",
    restore!(),
    "
    reti

3:  lds  r24, {made}+1
    inc  r24
    sts  {made}+1, r24
    pop  r26
    pop  r25
    ",
    restore!(),
    "
    reti

1:  lds  r25, {short_gap}           ; it has ended: the next one
    add  r26, r25
    lds  r25, {short_gap}+1
    adc  r24, r25
    tst  r25
    breq 2f                         ; no short gap
    sts  {ocr1a}+1, r24
    sts  {ocr1a}, r26
    pop  r26
    pop  r25
    ",
    restore!(),
    "
    reti

2:  pop  r26
    pop  r25
    ",
    restore!(),
    "
    jmp  {edge}
    ",
    tcnt1 = const TCNT1,
    ocr1a = const OCR1A,
    pin = const wiring::STEP.port_address() - 2,
    bit = const wiring::STEP.bit,
    made = sym MADE,
    short_gap = sym SHORT_GAP,
    minus_high_low = const HIGH_CYCLES.wrapping_neg() & 0xff,
    minus_high_high = const HIGH_CYCLES.wrapping_neg() >> 8,
    edge = sym edge,
);

// What the assembly takes for granted: the values lie at their statics' addresses, every gap has
// something in its upper byte, and an edge 256 cycles late leaves time to set the next one.
const _: () = assert!(size_of::<Shared<u16>>() == 2 && SHORTEST_GAP > 0xff);
const _: () = assert!(HIGH_CYCLES >= 256 + 2 * LEAD && SHORTEST_GAP >= HIGH_CYCLES as u32);

/// An edge was made, in full; entered as an interrupt.
extern "avr-interrupt" fn edge() {
    // SAFETY: this is an interrupt handler.
    let section = unsafe { shared::in_interrupt() };
    // SAFETY: the main program touches the timer in critical sections only.
    let timer = unsafe { &*TC1::ptr() };
    let edge = timer.ocr1a.read().bits();
    if !Step::is_set() {
        let gap = SHORT_GAP.get(section);
        if gap != 0 {
            set_edge(timer, edge, gap);
        } else {
            // A long gap or a stop. Unit A is parked where it is, a turn ahead.
            // Served later than that, unit B would match a turn too late, and unit A
            // would make an edge that nobody asked for before it.
            let late = timer.tcnt1.read().bits().wrapping_sub(edge);
            let after = late.saturating_add(LEAD).max(HANDOVER);
            WAITED.set(section, u32::from(after));
            timer.ocr1b.write(|w| w.bits(edge.wrapping_add(after)));
            timer.tifr1.write(|w| w.ocf1b().set_bit());
            timer.timsk1.write(|w| {
                w.ocie1a().set_bit();
                w.ocie1b().set_bit()
            });
        }
    } else {
        set_edge(timer, edge, HIGH_CYCLES);
        MADE.set(section, MADE.get(section).wrapping_add(1));
    }
}

// Part of a long gap is over, or the pulses shall stop.
#[avr_device::interrupt(atmega2560)]
fn TIMER1_COMPB() {
    // SAFETY: this is an interrupt handler.
    let section = unsafe { shared::in_interrupt() };
    // SAFETY: the main program touches the timer in critical sections only.
    let timer = unsafe { &*TC1::ptr() };
    if GAP.get(section) == 0 {
        stop(section, timer);
    } else {
        let now = timer.ocr1b.read().bits();
        wait(section, timer, now, WAITED.get(section));
    }
}
