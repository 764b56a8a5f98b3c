// SPDX-License-Identifier: GPL-3.0-or-later
//
// A board in simavr behind an opaque handle.
//
// simavr's central structure is large, differs between releases and is full of
// function pointers; mirroring it in Rust would break silently with the next
// release. This file is the only one that looks inside it.
//
// What must be exact to the cycle is done here, in callbacks: counting step
// pulses, drawing converter noise, pacing received bytes, EEPROM write times.
// Everything slower is left to Rust, which looks in between.

#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avr_adc.h>
#include <avr_eeprom.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_timer.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_core.h>
#include <sim_cycle_timers.h>
#include <sim_interrupts.h>
#include <sim_irq.h>

// Data-space addresses of the ATmega2560.
#define MARK_REGISTER 0x3e // GPIOR0
#define MCUSR 0x54
#define WDTCSR 0x60
#define ADCSRA 0x7a
#define TCCR1A 0x80
#define TCCR1B 0x81
#define OCR1AL 0x88
#define OCR1BL 0x8a
#define EECR 0x3f
#define EEDR 0x40
#define EEARL 0x41
#define EEARH 0x42
#define UCSR0A 0xc0
#define UCSR0B 0xc1
#define UBRR0L 0xc4
#define UBRR0H 0xc5

#define WDTCSR_WDE 0x08
#define WDTCSR_WDIE 0x40
#define WDTCSR_WDIF 0x80
#define WATCHDOG_HZ 128000
#define ADCSRA_ADIF 0x10
#define UCSR0A_U2X 0x02
#define UCSR0B_RXEN 0x10
#define EECR_EERE 0x01
#define EECR_EEPE 0x02
#define EECR_EEMPE 0x04
#define EECR_EERIE 0x08
#define EECR_EEPM 0x30
#define EECR_ERASE_ONLY 0x10
#define EECR_WRITE_ONLY 0x20

#define RAM_START 0x200 // the registers are below
#define RAM_PAINT 0xc5  // what memory that was never written reads as

// ATmega2560 data sheet, table 8-2: 26 368 cycles of the calibrated 8 MHz
// oscillator for erase and write; table 8-1: 1.8 ms for one half of it.
#define EEPROM_BOTH_US 3296
#define EEPROM_HALF_US 1800
// EEPE must follow EEMPE within so many cycles.
#define EEPROM_WINDOW 4

// ATmega2560 data sheet, 7.8.1: five cycles from an interrupt to its first instruction, with the three
// bytes of its program counter; as many more out of a sleep. simavr takes none.
#define CYCLES_TO_ENTER 5
#define CYCLES_TO_WAKE 5

// simavr looks for interrupts from its timers at least this often; without a
// limit above one it does so after every instruction, at half the speed.
#define RUN_AT_MOST 1000

// Later than this after a turn of a counter simavr does not look for what was due there: an instruction
// and the entry of an interrupt.
#define AFTER_TURN 16

// Bytes that the receiver holds: two in its buffer; a third in the shift
// register is lost when a fourth starts.
#define RECEIVER_HOLDS 2

#define PORTS 12 // A to L; there is no I
#define CHANNELS 8
#define NOISE_TABLE 4096

// What lets simavr compute the matches of timer 1 anew.
static const uint16_t compare_registers[] = {TCCR1A, TCCR1B, OCR1AL, OCR1BL};
#define COMPARE_REGISTERS (sizeof compare_registers / sizeof *compare_registers)

struct mark {
    uint64_t cycles;
    uint8_t id;
};

struct write {
    uint16_t address;
    uint8_t value;
};

struct total {
    uint64_t cycles, longest, count;
};

struct pin {
    uint16_t pin_register; // PINx; DDRx and PORTx follow
    uint8_t mask;
};

struct softrig_board {
    avr_t *avr;
    avr_run_t run_normally;
    avr_io_t module; // called by simavr when it resets
    avr_eeprom_t *eeprom_module;
    avr_uart_t *uart_module;
    avr_adc_t *adc_module;
    avr_timer_t *timer_1_module;
    struct {
        avr_io_write_t write;
        void *param;
    } compares[COMPARE_REGISTERS]; // simavr's own

    // Reset
    uint8_t reset_flags; // MCUSR as the firmware left it
    int clears_flags;    // the bootloader clears MCUSR before it starts the firmware
    int was_reset;
    uint64_t resets;

    // A main program that hangs: a jump to itself where it sleeps
    int hang_wanted, hang_deaf;
    uint64_t bitten_at; // since when the watchdog's interrupt waits; 0: it does not
    avr_flashaddr_t hung_at; // zero: it does not
    uint8_t hung_word[2];

    // Received bytes
    uint8_t *output;
    size_t output_len, output_cap;

    // Bytes on their way to the board
    uint8_t *input;
    size_t input_at, input_len, input_cap;
    avr_irq_t *receive;
    uint64_t byte_cycles;
    uint64_t overruns;
    int is_late;

    // Marks
    struct mark *marks;
    size_t marks_len, marks_cap;
    struct total totals[256];
    uint64_t mark_start;
    uint8_t mark_open;
    uint64_t slept;
    int was_asleep;

    // EEPROM
    int eeprom_busy;
    uint16_t eeprom_address;
    uint8_t eeprom_value;
    uint64_t eeprom_done;
    uint64_t eeprom_armed; // end of the window that EEMPE opens; 0 is closed
    uint64_t eeprom_writes;

    // Pins
    uint8_t external_mask[PORTS], external_level[PORTS];
    struct pin step, direction, enable;
    int step_level;
    int stalled, reversed, trembles, skips;
    int64_t position, lowest, highest;
    uint64_t edges, lost;
    int trace_steps;
    uint64_t *step_cycles;
    size_t step_cycles_len, step_cycles_cap;

    // What a handler that runs alone wrote to registers
    struct write *writes;
    size_t writes_len, writes_cap;

    // Converter
    double millivolts[CHANNELS], noise[CHANNELS];
    float noise_table[NOISE_TABLE];
    uint64_t noise_state;

    // A buffer that cannot grow loses data; the caller is told.
    int out_of_memory;
};

static int grow(void **buffer, size_t *cap, size_t len, size_t item)
{
    if (len < *cap)
        return 1;
    size_t wanted = *cap ? *cap * 2 : 256;
    void *bigger = realloc(*buffer, wanted * item);
    if (!bigger)
        return 0;
    *buffer = bigger;
    *cap = wanted;
    return 1;
}

// ---------------------------------------------------------------- serial line

static void on_uart_byte(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct softrig_board *board = param;
    if (!grow((void **)&board->output, &board->output_cap, board->output_len, 1)) {
        board->out_of_memory = 1;
        return;
    }
    board->output[board->output_len++] = (uint8_t)value;
}

// simavr counts a parity bit that nobody asked for, and overlooks U2X when it is
// set after the divisor.
static void on_uart_setup(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    (void)addr;
    (void)value;
    struct softrig_board *board = param;
    uint32_t divisor = avr->data[UBRR0L] | ((avr->data[UBRR0H] & 0x0f) << 8);
    uint32_t per_bit = (divisor + 1) * (avr->data[UCSR0A] & UCSR0A_U2X ? 8 : 16);
    board->byte_cycles = (uint64_t)per_bit * 10;
    if (board->uart_module)
        board->uart_module->cycles_per_byte = board->byte_cycles;
}

// Hands over the next byte once a byte's time has passed.
static avr_cycle_count_t feed(struct avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct softrig_board *board = param;
    if (board->input_at == board->input_len)
        return 0;
    const avr_uart_t *uart = board->uart_module;
    size_t unread = (size_t)((uart->input.write - uart->input.read) & (uart_fifo_fifo_size - 1));
    if (!(avr->data[UCSR0B] & UCSR0B_RXEN))
        return when + board->byte_cycles;
    if (unread >= RECEIVER_HOLDS) {
        if (!board->is_late) {
            board->is_late = 1;
            board->overruns++;
        }
        return when + board->byte_cycles;
    }
    board->is_late = 0;
    avr_raise_irq(board->receive, board->input[board->input_at++]);
    if (board->input_at == board->input_len) {
        board->input_at = board->input_len = 0;
        return 0;
    }
    return when + board->byte_cycles;
}

static void start_feeding(struct softrig_board *board)
{
    if (board->input_at != board->input_len &&
        avr_cycle_timer_status(board->avr, feed, board) == 0)
        avr_cycle_timer_register(board->avr, board->byte_cycles, feed, board);
}

// Returns 0 when memory is short.
int softrig_board_send(struct softrig_board *board, const uint8_t *bytes, size_t len)
{
    for (size_t i = 0; i < len; i++) {
        if (!grow((void **)&board->input, &board->input_cap, board->input_len, 1))
            return 0;
        board->input[board->input_len++] = bytes[i];
    }
    start_feeding(board);
    return 1;
}

size_t softrig_board_unsent(const struct softrig_board *board)
{
    return board->input_len - board->input_at;
}

uint64_t softrig_board_overruns(const struct softrig_board *board)
{
    return board->overruns;
}

size_t softrig_board_output_len(const struct softrig_board *board)
{
    return board->output_len;
}

// Copies the whole output, softrig_board_output_len bytes, and forgets it.
void softrig_board_take_output(struct softrig_board *board, uint8_t *into)
{
    if (board->output_len)
        memcpy(into, board->output, board->output_len);
    board->output_len = 0;
}

// --------------------------------------------------------------- cycle marks

static void add_to_total(struct softrig_board *board, uint8_t id, uint64_t cycles)
{
    struct total *total = &board->totals[id];
    total->cycles += cycles;
    total->count++;
    if (cycles > total->longest)
        total->longest = cycles;
}

// A non-zero write opens a stretch, zero closes it. Opening another one closes
// the first for the totals, but not as a mark: it was not closed on purpose.
static void on_mark(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    avr->data[addr] = value;
    uint8_t id = board->mark_open;
    uint64_t cycles = avr->cycle - board->mark_start;
    board->mark_open = value;
    board->mark_start = avr->cycle;
    if (!id)
        return;
    add_to_total(board, id, cycles);
    if (value)
        return;
    if (!grow((void **)&board->marks, &board->marks_cap, board->marks_len,
              sizeof *board->marks)) {
        board->out_of_memory = 1;
        return;
    }
    board->marks[board->marks_len++] = (struct mark){.cycles = cycles, .id = id};
}

size_t softrig_board_marks_len(const struct softrig_board *board)
{
    return board->marks_len;
}

// Copies all closed marks, softrig_board_marks_len of each, and forgets them.
void softrig_board_take_marks(struct softrig_board *board, uint8_t *ids, uint64_t *cycles)
{
    for (size_t i = 0; i < board->marks_len; i++) {
        ids[i] = board->marks[i].id;
        cycles[i] = board->marks[i].cycles;
    }
    board->marks_len = 0;
}

void softrig_board_mark_total(const struct softrig_board *board, uint8_t id, uint64_t *cycles,
                              uint64_t *longest, uint64_t *count)
{
    *cycles = board->totals[id].cycles;
    *longest = board->totals[id].longest;
    *count = board->totals[id].count;
}

// --------------------------------------------------------------------- sleep

// simavr sleeps in real time when its processor does; simulated time is enough.
static void no_real_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    struct softrig_board *board = avr->custom.data;
    // simavr counts one cycle more itself.
    board->slept += cycles + 1;
    board->was_asleep = 1;
}

// An interrupt begins, or ends with zero.
static void on_interrupt(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct softrig_board *board = param;
    if (!value)
        return;
    avr_t *avr = board->avr;
    avr_cycle_count_t taken = CYCLES_TO_ENTER + (board->was_asleep ? CYCLES_TO_WAKE : 0);
    avr->cycle += taken;
    // simavr runs so many cycles before it looks at its timers again: what is due meanwhile, a step edge
    // among it, would be late by what the entry took.
    avr->run_cycle_count = avr->run_cycle_count > taken ? avr->run_cycle_count - taken : 1;
    board->was_asleep = 0;
}

uint64_t softrig_board_slept(const struct softrig_board *board)
{
    return board->slept;
}

// ------------------------------------------------------------------- timer 1

// simavr sets up the matches of a turn some cycles after it began; what was due by then it would
// only see a turn later, and a match at zero never. Both come up to a microsecond late instead.
static void on_compare(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    for (size_t i = 0; i < COMPARE_REGISTERS; i++)
        if (addr == compare_registers[i])
            board->compares[i].write(avr, addr, value, board->compares[i].param);
    avr_timer_t *timer = board->timer_1_module;
    static const uint16_t registers[] = {[AVR_TIMER_COMPA] = OCR1AL, [AVR_TIMER_COMPB] = OCR1BL};
    for (int unit = AVR_TIMER_COMPA; unit <= AVR_TIMER_COMPB; unit++)
        if (timer->tov_cycles && avr->data[registers[unit] + 1] == 0 &&
            avr->data[registers[unit]] < AFTER_TURN)
            timer->comp[unit].comp_cycles = AFTER_TURN + 1;
}

// Puts it behind simavr's own, whose list of several for one register is full.
static void watch_compares(struct softrig_board *board)
{
    for (size_t i = 0; i < COMPARE_REGISTERS; i++) {
        avr_io_addr_t io = AVR_DATA_TO_IO(compare_registers[i]);
        board->compares[i].write = board->avr->io[io].w.c;
        board->compares[i].param = board->avr->io[io].w.param;
        board->avr->io[io].w.c = on_compare;
        board->avr->io[io].w.param = board;
    }
}

// -------------------------------------------------------------------- EEPROM

static void eeprom_settle(struct softrig_board *board)
{
    if (!board->eeprom_busy || board->avr->cycle < board->eeprom_done)
        return;
    board->eeprom_module->eeprom[board->eeprom_address] = board->eeprom_value;
    board->eeprom_busy = 0;
    board->eeprom_writes++;
}

static avr_cycle_count_t eeprom_is_done(struct avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)when;
    struct softrig_board *board = param;
    eeprom_settle(board);
    avr_raise_interrupt(avr, &board->eeprom_module->ready);
    return 0;
}

static uint8_t eeprom_control(struct softrig_board *board)
{
    const avr_t *avr = board->avr;
    eeprom_settle(board);
    uint8_t value = avr->data[EECR] & (EECR_EERIE | EECR_EEPM);
    if (board->eeprom_busy)
        value |= EECR_EEPE;
    if (board->eeprom_armed && avr->cycle <= board->eeprom_armed)
        value |= EECR_EEMPE;
    return value;
}

static uint8_t on_eeprom_control_read(struct avr_t *avr, avr_io_addr_t addr, void *param)
{
    avr->data[addr] = eeprom_control(param);
    return avr->data[addr];
}

// simavr's own EEPROM writes at once and never shows EEPE set, which hides every
// mistake in waiting for it.
static void on_eeprom_control(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    uint8_t before = eeprom_control(board);
    int was_armed = before & EECR_EEMPE;
    uint16_t at = (avr->data[EEARL] | (avr->data[EEARH] << 8)) & (board->eeprom_module->size - 1);
    uint8_t kept = board->eeprom_busy ? before & EECR_EEPM : value & EECR_EEPM;
    avr->data[addr] = kept | (value & EECR_EERIE);

    if ((value & EECR_EERE) && !board->eeprom_busy) {
        avr->data[EEDR] = board->eeprom_module->eeprom[at];
        avr->cycle += 4; // the processor is halted
    }
    if ((value & EECR_EEPE) && was_armed && !board->eeprom_busy) {
        uint8_t old = board->eeprom_module->eeprom[at];
        uint8_t data = avr->data[EEDR];
        uint32_t duration_us = EEPROM_HALF_US;
        switch (kept) {
        case EECR_ERASE_ONLY:
            data = 0xff;
            break;
        case EECR_WRITE_ONLY:
            data &= old;
            break;
        default:
            duration_us = EEPROM_BOTH_US;
        }
        board->eeprom_busy = 1;
        board->eeprom_address = at;
        board->eeprom_value = data;
        board->eeprom_armed = 0;
        uint64_t cycles = (uint64_t)duration_us * (avr->frequency / 1000000);
        board->eeprom_done = avr->cycle + cycles;
        avr_cycle_timer_register(avr, cycles, eeprom_is_done, board);
        avr->cycle += 2; // the processor is halted
    } else if (value & EECR_EEMPE) {
        board->eeprom_armed = avr->cycle + EEPROM_WINDOW;
    }
    // The interrupt is raised as long as nothing is being written.
    if ((value & EECR_EERIE) && !(before & EECR_EERIE) && !board->eeprom_busy)
        avr_raise_interrupt(avr, &board->eeprom_module->ready);
    avr->data[addr] = eeprom_control(board);
}

uint32_t softrig_board_eeprom_len(const struct softrig_board *board)
{
    return board->eeprom_module->size;
}

void softrig_board_eeprom_get(struct softrig_board *board, uint8_t *into)
{
    eeprom_settle(board);
    memcpy(into, board->eeprom_module->eeprom, board->eeprom_module->size);
}

// Writes softrig_board_eeprom_len bytes.
void softrig_board_eeprom_set(struct softrig_board *board, const uint8_t *from)
{
    memcpy(board->eeprom_module->eeprom, from, board->eeprom_module->size);
}

// The address that is being written, or -1.
int32_t softrig_board_eeprom_writing(struct softrig_board *board)
{
    eeprom_settle(board);
    return board->eeprom_busy ? board->eeprom_address : -1;
}

// Ends a write that is going on and leaves `value` in its place.
void softrig_board_eeprom_tear(struct softrig_board *board, uint8_t value)
{
    eeprom_settle(board);
    if (!board->eeprom_busy)
        return;
    board->eeprom_module->eeprom[board->eeprom_address] = value;
    board->eeprom_busy = 0;
}

uint64_t softrig_board_eeprom_writes(struct softrig_board *board)
{
    eeprom_settle(board);
    return board->eeprom_writes;
}

// ---------------------------------------------------------------------- pins

static uint16_t pin_register(char port)
{
    // Ports A to G are in the low registers, H, J, K and L in the extended ones.
    if (port <= 'G')
        return 0x20 + 3 * (port - 'A');
    return 0x100 + 3 * (port == 'H' ? 0 : port - 'I');
}

// The level that the board drives: 0 or 1, or -1 for a pin that is an input.
static int driven(const avr_t *avr, struct pin pin)
{
    if (!(avr->data[pin.pin_register + 1] & pin.mask))
        return -1;
    return !!(avr->data[pin.pin_register + 2] & pin.mask);
}

int softrig_board_driven(const struct softrig_board *board, char port, uint8_t bit)
{
    return driven(board->avr, (struct pin){pin_register(port), (uint8_t)(1 << bit)});
}

static void on_step(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct softrig_board *board = param;
    const avr_t *avr = board->avr;
    int level = (value & 0xff) && driven(avr, board->step) >= 0;
    int rising = level && !board->step_level;
    board->step_level = level;
    if (!rising)
        return;
    // The driver's enable input has a pull-up: it must be driven low.
    if (driven(avr, board->enable) != 0)
        return;
    board->edges++;
    if (board->trace_steps) {
        if (!grow((void **)&board->step_cycles, &board->step_cycles_cap,
                  board->step_cycles_len, sizeof *board->step_cycles))
            board->out_of_memory = 1;
        else
            board->step_cycles[board->step_cycles_len++] = avr->cycle;
    }
    int forward = (driven(avr, board->direction) == 1) != board->reversed;
    // Two full steps there and back, of sixteen microsteps each.
    if (board->trembles && board->edges % 64 < 32)
        forward = !forward;
    int64_t wanted = board->position + (forward ? 1 : -1);
    // Too little torque: nine steps of ten are lost.
    int skipped = board->skips && board->edges % 10;
    if (board->stalled || skipped || wanted < board->lowest || wanted > board->highest)
        board->lost++;
    else
        board->position = wanted;
}

// Each pin is a port letter and a bit. Positions are microsteps.
void softrig_board_wire_stepper(struct softrig_board *board, const char ports[3],
                                const uint8_t bits[3], int64_t position, int64_t lowest,
                                int64_t highest)
{
    struct pin *pins[] = {&board->step, &board->direction, &board->enable};
    for (int i = 0; i < 3; i++)
        *pins[i] = (struct pin){pin_register(ports[i]), (uint8_t)(1 << bits[i])};
    board->position = position;
    board->lowest = lowest;
    board->highest = highest;
    avr_irq_register_notify(
        avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(ports[0]), bits[0]), on_step, board);
}

// Lets the main program hang from its next sleep to the next reset; interrupts go on unless it is
// deaf.
void softrig_board_hang(struct softrig_board *board, int deaf)
{
    board->hang_wanted = 1;
    board->hang_deaf = deaf;
}

static void hang(struct softrig_board *board)
{
    static const uint8_t to_itself[2] = {0xff, 0xcf}; // rjmp .-2
    avr_t *avr = board->avr;
    board->hang_wanted = 0;
    board->hung_at = avr->pc;
    memcpy(board->hung_word, avr->flash + avr->pc, sizeof to_itself);
    memcpy(avr->flash + avr->pc, to_itself, sizeof to_itself);
    if (board->hang_deaf) {
        avr->sreg[S_I] = 0;
        avr->state = cpu_Running;
    }
}

static void end_of_hang(struct softrig_board *board)
{
    board->hang_wanted = 0;
    if (board->hung_at)
        memcpy(board->avr->flash + board->hung_at, board->hung_word, sizeof board->hung_word);
    board->hung_at = 0;
}

void softrig_board_reverse(struct softrig_board *board, int reversed)
{
    board->reversed = reversed;
}

void softrig_board_tremble(struct softrig_board *board, int trembles)
{
    board->trembles = trembles;
}

void softrig_board_skip(struct softrig_board *board, int skips)
{
    board->skips = skips;
}

void softrig_board_stall(struct softrig_board *board, int stalled)
{
    board->stalled = stalled;
}

void softrig_board_stepper(const struct softrig_board *board, int64_t *position, uint64_t *edges,
                           uint64_t *lost)
{
    *position = board->position;
    *edges = board->edges;
    *lost = board->lost;
}

void softrig_board_trace_steps(struct softrig_board *board, int on)
{
    board->trace_steps = on;
}

size_t softrig_board_step_cycles_len(const struct softrig_board *board)
{
    return board->step_cycles_len;
}

void softrig_board_take_step_cycles(struct softrig_board *board, uint64_t *into)
{
    if (board->step_cycles_len)
        memcpy(into, board->step_cycles, board->step_cycles_len * sizeof *into);
    board->step_cycles_len = 0;
}

// Sets what is connected to an input.
void softrig_board_set_input(struct softrig_board *board, char port, uint8_t bit, int level)
{
    int index = port - 'A';
    uint8_t mask = (uint8_t)(1 << bit);
    if ((board->external_mask[index] & mask) &&
        !level == !(board->external_level[index] & mask))
        return;
    board->external_mask[index] |= mask;
    board->external_level[index] &= (uint8_t)~mask;
    if (level)
        board->external_level[index] |= mask;
    // simavr needs to know, or a pull-up that is switched on wins.
    avr_ioport_external_t external = {
        .name = port,
        .mask = board->external_mask[index],
        .value = board->external_level[index],
    };
    avr_ioctl(board->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
    avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), !!level);
}

// ----------------------------------------------------------------- converter

// xorshift64*: a table of normal numbers is picked from at random, which costs
// less than drawing them.
static double draw_noise(struct softrig_board *board)
{
    uint64_t x = board->noise_state;
    x ^= x >> 12;
    x ^= x << 25;
    x ^= x >> 27;
    board->noise_state = x;
    return board->noise_table[(x * 0x2545f4914f6cdd1dull) >> 52];
}

// The count of a converter without errors is the nearest multiple of Vref/1024:
// the data sheet defines offset error against a first transition at half a step
// above 0 V, and gain error against a last one a step and a half below Vref.
// Cutting off instead of rounding would read half a step less everywhere, which
// is 0.34 kPa of the pressure sensor. simavr scales by 1023/Vref and cuts off:
// the voltage that it gets is chosen so that the right count comes out.
static void apply_channel(struct softrig_board *board, int channel)
{
    avr_t *avr = board->avr;
    double millivolts = board->millivolts[channel];
    if (board->noise[channel] > 0)
        millivolts += board->noise[channel] * draw_noise(board);
    double nearest = floor(millivolts * 1024.0 / avr->avcc + 0.5);
    uint32_t count = nearest < 0 ? 0 : nearest > 1023 ? 1023 : (uint32_t)nearest;
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel),
                  (count * avr->avcc + 1022) / 1023);
}

// A conversion starts: every sample has noise of its own.
static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct softrig_board *board = param;
    union {
        avr_adc_mux_t mux;
        uint32_t value;
    } e = {.value = value};
    if (e.mux.kind == ADC_MUX_SINGLE && e.mux.src < CHANNELS)
        apply_channel(board, e.mux.src);
}

// The flag of a conversion that is done is cleared by writing a one; simavr keeps the one.
static void on_converter_control(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    if (!(value & ADCSRA_ADIF))
        return;
    avr_clear_interrupt(avr, &board->adc_module->adc);
    avr->data[addr] &= (uint8_t)~ADCSRA_ADIF;
}

// The supply, which is the converter's reference too (mV).
void softrig_board_set_supply(struct softrig_board *board, uint32_t millivolts)
{
    board->avr->vcc = board->avr->avcc = millivolts;
}

void softrig_board_set_analog(struct softrig_board *board, uint8_t channel, double millivolts,
                              double noise)
{
    if (channel >= CHANNELS)
        return;
    board->millivolts[channel] = millivolts;
    board->noise[channel] = noise;
}

// `table` holds NOISE_TABLE numbers from the standard normal distribution.
void softrig_board_seed_noise(struct softrig_board *board, const float *table, uint64_t seed)
{
    memcpy(board->noise_table, table, sizeof board->noise_table);
    board->noise_state = seed ? seed : 1;
}

// --------------------------------------------------------------------- reset

static void on_reset(struct avr_io_t *io)
{
    struct softrig_board *board =
        (struct softrig_board *)((char *)io - offsetof(struct softrig_board, module));
    board->was_reset = 1;
}

static void on_reset_flags(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    // Flags can be cleared, not set.
    board->reset_flags &= value;
    avr->data[addr] = board->reset_flags;
}

// simavr would poll a low input for level interrupts every cycle, whether or not
// they are enabled, at a tenth of the speed; again after every reset.
static void no_level_polling(avr_t *avr)
{
    for (int i = 0; i < EXTINT_COUNT; i++)
        avr_extint_set_strict_lvl_trig(avr, (uint8_t)i, 0);
}

// simavr clears all registers and timers; what outlives a reset is put back.
static void after_reset(struct softrig_board *board)
{
    avr_t *avr = board->avr;
    board->was_reset = 0;
    board->resets++;
    end_of_hang(board);
    board->reset_flags |= avr->data[MCUSR]; // the watchdog's flag is there already
    if (board->clears_flags)
        board->reset_flags = 0;
    avr->data[MCUSR] = board->reset_flags;
    avr->run_cycle_limit = RUN_AT_MOST;
    no_level_polling(avr);
    board->mark_open = 0;
    board->was_asleep = 0;
    board->eeprom_armed = 0;
    board->step_level = 0;
    if (board->step.mask)
        avr_raise_irq(avr_io_getirq(avr,
                                    AVR_IOCTL_IOPORT_GETIRQ(
                                        'A' + (board->step.pin_register - 0x20) / 3),
                                    __builtin_ctz(board->step.mask)),
                      0);
    for (int i = 0; i < PORTS; i++)
        if (board->external_mask[i])
            avr->data[pin_register((char)('A' + i))] = board->external_level[i];
    // A write that has begun goes on, whatever the processor does.
    eeprom_settle(board);
    if (board->eeprom_busy)
        avr_cycle_timer_register(avr, board->eeprom_done - avr->cycle, eeprom_is_done, board);
    // The watchdog's reset leaves it running.
    start_feeding(board);
}

// Resets the processor and adds `flags` to MCUSR. At power-on the flags replace
// those before, and memory is lost.
void softrig_board_reset(struct softrig_board *board, uint8_t flags, int power_on)
{
    avr_t *avr = board->avr;
    avr->run = board->run_normally;
    if (power_on) {
        memset(avr->data + RAM_START, RAM_PAINT, avr->ramend + 1 - RAM_START);
        memset(avr->data, 0, 32);
        board->reset_flags = 0;
        board->input_at = board->input_len = 0;
    }
    avr_reset(avr);
    board->reset_flags |= flags;
    after_reset(board);
}

uint64_t softrig_board_resets(const struct softrig_board *board)
{
    return board->resets;
}

void softrig_board_clear_flags(struct softrig_board *board, int clears)
{
    board->clears_flags = clears;
    if (clears)
        board->reset_flags = board->avr->data[MCUSR] = 0;
}

uint8_t softrig_board_reset_flags(const struct softrig_board *board)
{
    return board->reset_flags;
}

// --------------------------------------------------------------------- board

static void log_problems(avr_t *avr, const int level, const char *format, va_list args)
{
    (void)avr;
    if (level == LOG_NONE || level > LOG_ERROR)
        return;
    fputs("simavr: ", stderr);
    vfprintf(stderr, format, args);
}

void softrig_board_free(struct softrig_board *board)
{
    if (!board)
        return;
    if (board->avr) {
        avr_terminate(board->avr);
        free(board->avr);
    }
    free(board->output);
    free(board->input);
    free(board->marks);
    free(board->step_cycles);
    free(board->writes);
    free(board);
}

// Returns NULL when simavr does not know the processor or memory is short.
struct softrig_board *softrig_board_new(const char *processor, uint32_t hertz,
                                        uint32_t supply_millivolts,
                                        const uint8_t *flash, uint32_t flash_len)
{
    struct softrig_board *board = calloc(1, sizeof *board);
    if (!board)
        return NULL;
    avr_global_logger_set(log_problems);
    avr_t *avr = avr_make_mcu_by_name(processor);
    if (!avr || flash_len > avr->flashend + 1) {
        free(avr);
        free(board);
        return NULL;
    }
    board->avr = avr;
    avr->custom.data = board;
    avr_init(avr);
    avr->frequency = hertz;
    // simavr's own default is 3.3 V, which would rescale every conversion.
    avr->vcc = avr->avcc = avr->aref = supply_millivolts;
    avr->sleep = no_real_sleep;
    board->run_normally = avr->run;
    avr->run_cycle_limit = RUN_AT_MOST;
    // avr_loadcode only reads, whatever its signature says.
    avr_loadcode(avr, (uint8_t *)flash, flash_len, 0);
    avr->codeend = flash_len;
    // Memory is undefined at power-on; painted, it shows later what was used.
    memset(avr->data + RAM_START, RAM_PAINT, avr->ramend + 1 - RAM_START);

    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        if (!strcmp(io->kind, "eeprom"))
            board->eeprom_module = (avr_eeprom_t *)io;
        if (!strcmp(io->kind, "uart") && ((avr_uart_t *)io)->name == '0')
            board->uart_module = (avr_uart_t *)io;
        if (!strcmp(io->kind, "adc"))
            board->adc_module = (avr_adc_t *)io;
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1')
            board->timer_1_module = (avr_timer_t *)io;
    }
    if (!board->eeprom_module || !board->uart_module || !board->adc_module ||
        !board->timer_1_module) {
        softrig_board_free(board);
        return NULL;
    }
    board->module = (avr_io_t){.kind = "softrig", .reset = on_reset};
    avr_register_io(avr, &board->module);
    board->reset_flags = avr->data[MCUSR];

    avr_register_io_write(avr, MARK_REGISTER, on_mark, board);
    avr_register_io_write(avr, MCUSR, on_reset_flags, board);
    // Instead of simavr's, not beside it.
    avr->io[AVR_DATA_TO_IO(EECR)].w.c = on_eeprom_control;
    avr->io[AVR_DATA_TO_IO(EECR)].w.param = board;
    avr_register_io_read(avr, EECR, on_eeprom_control_read, board);
    // After simavr's.
    avr_register_io_write(avr, UBRR0L, on_uart_setup, board);
    avr_register_io_write(avr, UCSR0A, on_uart_setup, board);
    avr_register_io_write(avr, ADCSRA, on_converter_control, board);
    watch_compares(board);
    board->byte_cycles = hertz / 11520;

    no_level_polling(avr);

    board->receive = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
        on_uart_byte, board);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER),
                            on_conversion, board);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, AVR_INT_ANY) + AVR_INT_IRQ_RUNNING,
                            on_interrupt, board);
    // Neither echo lines to our standard output nor sleep when polled.
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    return board;
}

uint64_t softrig_board_cycle(const struct softrig_board *board)
{
    return board->avr->cycle;
}

static avr_cycle_count_t stop_here(struct avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr;
    (void)when;
    (void)param;
    return 0;
}

// A watchdog whose interrupt is not served before its next time-out resets the processor (data
// sheet, 12.5.2). simavr would raise the interrupt for ever, so it is taken away shortly before.
static void watchdog_bites(struct softrig_board *board)
{
    avr_t *avr = board->avr;
    uint8_t control = avr->data[WDTCSR];
    if (!(control & WDTCSR_WDIF) || !(control & WDTCSR_WDE)) {
        board->bitten_at = 0;
        return;
    }
    if (!board->bitten_at)
        board->bitten_at = avr->cycle;
    unsigned prescaler = (control & 7) | (control & 0x20) >> 2;
    uint64_t period = (uint64_t)(2048u << prescaler) * (avr->frequency / WATCHDOG_HZ);
    if (avr->cycle - board->bitten_at > period - period / 16)
        avr->data[WDTCSR] &= (uint8_t)~WDTCSR_WDIE;
}

// Runs up to the given cycle. Returns 0 when the processor still runs, 1 when it
// halted (asleep with interrupts off), 2 when it crashed, 3 when memory is short.
int softrig_board_run_until(struct softrig_board *board, uint64_t cycle)
{
    avr_t *avr = board->avr;
    // A sleeping processor would otherwise jump to its own next timer.
    if (avr->cycle < cycle)
        avr_cycle_timer_register(avr, cycle - avr->cycle, stop_here, board);
    while (avr->cycle < cycle) {
        int state = avr_run(avr);
        if (board->was_reset) {
            after_reset(board);
            if (avr->cycle < cycle)
                avr_cycle_timer_register(avr, cycle - avr->cycle, stop_here, board);
        }
        if (state == cpu_Done) {
            // A running watchdog still wakes it.
            if (!(avr->data[WDTCSR] & WDTCSR_WDE))
                return 1;
            avr_cycle_count_t wait = avr_cycle_timer_process(avr);
            if (avr->run == board->run_normally)
                avr->cycle += wait ? wait : 1;
            board->slept += wait;
        }
        if (state == cpu_Crashed)
            return 2;
        watchdog_bites(board);
        // What is asleep is the main program, and nothing else is at that place.
        if (board->hang_wanted && avr->state == cpu_Sleeping)
            hang(board);
    }
    eeprom_settle(board);
    return board->out_of_memory ? 3 : 0;
}

// Lets time pass for a processor that does not run: halted, held in reset or
// without power.
void softrig_board_skip_to(struct softrig_board *board, uint64_t cycle)
{
    if (board->avr->cycle < cycle)
        board->avr->cycle = cycle;
    eeprom_settle(board);
}

// The first address at or above `from` that was ever written, or the end of RAM.
uint16_t softrig_board_first_written(const struct softrig_board *board, uint16_t from)
{
    const avr_t *avr = board->avr;
    uint32_t at = from < RAM_START ? RAM_START : from;
    while (at <= avr->ramend && avr->data[at] == RAM_PAINT)
        at++;
    return (uint16_t)at;
}

// Copies `len` bytes of flash from `address`; both must lie within it.
void softrig_board_flash_get(const struct softrig_board *board, uint32_t address, uint8_t *into,
                             uint32_t len)
{
    memcpy(into, board->avr->flash + address, len);
}

void softrig_board_flash_set(struct softrig_board *board, uint32_t address, const uint8_t *from,
                             uint32_t len)
{
    memcpy(board->avr->flash + address, from, len);
    if (address + len > board->avr->codeend)
        board->avr->codeend = address + len;
}

uint8_t softrig_board_data_get(const struct softrig_board *board, uint16_t address)
{
    return address <= board->avr->ramend ? board->avr->data[address] : 0;
}

// ------------------------------------------------------------ a handler alone

static void on_any_write(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    avr->data[addr] = value;
    if (!grow((void **)&board->writes, &board->writes_cap, board->writes_len,
              sizeof *board->writes)) {
        board->out_of_memory = 1;
        return;
    }
    board->writes[board->writes_len++] = (struct write){.address = addr, .value = value};
}

// Takes the peripherals away for good: their registers are memory from here on.
void softrig_board_take_peripherals(struct softrig_board *board)
{
    avr_t *avr = board->avr;
    memset(avr->io, 0, sizeof avr->io);
    for (size_t i = 0; i < sizeof avr->io / sizeof *avr->io; i++) {
        avr->io[i].w.c = on_any_write;
        avr->io[i].w.param = board;
    }
}

// Enters what is at `at` as an interrupt does, in this data space, and leaves there what it was
// when it returned. Returns the instructions that it took; 0 if it did not return within `limit`.
// `passed` says whether `through` was among them.
uint32_t softrig_board_enter(struct softrig_board *board, uint8_t *data, uint32_t at,
                             uint32_t through, uint32_t limit, int *passed)
{
    avr_t *avr = board->avr;
    // Where nothing else leads.
    const avr_flashaddr_t interrupted = avr->flashend - 1;
    memcpy(avr->data, data, avr->ramend + 1);
    SET_SREG_FROM(avr, data[R_SREG]);
    avr->sreg[S_I] = 0;
    avr->state = cpu_Running;
    _avr_push_addr(avr, interrupted);
    avr->pc = at;
    board->writes_len = 0;
    *passed = 0;
    for (uint32_t taken = 1; taken <= limit && avr->state == cpu_Running; taken++) {
        *passed |= avr->pc == through;
        avr->pc = avr_run_one(avr);
        if (avr->pc == interrupted) {
            READ_SREG_INTO(avr, avr->data[R_SREG]);
            memcpy(data, avr->data, avr->ramend + 1);
            return board->out_of_memory ? 0 : taken;
        }
    }
    return 0;
}

size_t softrig_board_writes_len(const struct softrig_board *board)
{
    return board->writes_len;
}

// Copies what was written, softrig_board_writes_len of each.
void softrig_board_get_writes(const struct softrig_board *board, uint16_t *addresses,
                              uint8_t *values)
{
    for (size_t i = 0; i < board->writes_len; i++) {
        addresses[i] = board->writes[i].address;
        values[i] = board->writes[i].value;
    }
}
