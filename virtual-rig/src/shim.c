// SPDX-License-Identifier: GPL-3.0-or-later
//
// A board in simavr behind an opaque handle.
//
// simavr's central structure is large, differs between releases and is full of
// function pointers; mirroring it in Rust would break silently with the next
// release. This file is the only one that looks inside it.

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_irq.h>

#define MARK_REGISTER 0x3e // GPIOR0, data-space address
#define RAM_START 0x200     // the registers are below
#define RAM_PAINT 0xc5      // what memory that was never written reads as

struct mark {
    uint64_t cycles;
    uint8_t id;
};

struct softrig_board {
    avr_t *avr;

    uint8_t *output;
    size_t output_len, output_cap;

    struct mark *marks;
    size_t marks_len, marks_cap;
    uint64_t mark_start;
    uint8_t mark_open;

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

// A non-zero write opens a stretch, zero closes it.
static void on_mark(struct avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct softrig_board *board = param;
    avr->data[addr] = value;
    if (value) {
        board->mark_open = value;
        board->mark_start = avr->cycle;
        return;
    }
    if (!board->mark_open)
        return;
    if (!grow((void **)&board->marks, &board->marks_cap, board->marks_len,
              sizeof *board->marks)) {
        board->out_of_memory = 1;
        return;
    }
    board->marks[board->marks_len++] = (struct mark){
        .cycles = avr->cycle - board->mark_start,
        .id = board->mark_open,
    };
    board->mark_open = 0;
}

// simavr sleeps in real time when its processor does; simulated time is enough.
static void no_real_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    (void)avr;
    (void)cycles;
}

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
    free(board->marks);
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
    avr_init(avr);
    avr->frequency = hertz;
    // simavr's own default is 3.3 V, which would rescale every conversion.
    avr->vcc = avr->avcc = avr->aref = supply_millivolts;
    avr->sleep = no_real_sleep;
    // avr_loadcode only reads, whatever its signature says.
    avr_loadcode(avr, (uint8_t *)flash, flash_len, 0);
    avr->codeend = flash_len;
    // Memory is undefined at power-on; painted, it shows later what was used.
    memset(avr->data + RAM_START, RAM_PAINT, avr->ramend + 1 - RAM_START);

    avr_register_io_write(avr, MARK_REGISTER, on_mark, board);
    avr_irq_register_notify(
        avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
        on_uart_byte, board);
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

// Runs up to the given cycle. Returns 0 when the processor still runs, 1 when it
// halted (asleep with interrupts off), 2 when it crashed, 3 when memory is short.
int softrig_board_run_until(struct softrig_board *board, uint64_t cycle)
{
    avr_t *avr = board->avr;
    while (avr->cycle < cycle) {
        int state = avr_run(avr);
        if (state == cpu_Done)
            return 1;
        if (state == cpu_Crashed)
            return 2;
    }
    return board->out_of_memory ? 3 : 0;
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

// The first address at or above `from` that was ever written, or the end of RAM.
uint16_t softrig_board_first_written(const struct softrig_board *board, uint16_t from)
{
    const avr_t *avr = board->avr;
    uint32_t at = from < RAM_START ? RAM_START : from;
    while (at <= avr->ramend && avr->data[at] == RAM_PAINT)
        at++;
    return (uint16_t)at;
}
