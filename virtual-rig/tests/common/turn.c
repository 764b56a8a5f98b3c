// SPDX-License-Identifier: GPL-3.0-or-later
// A match of timer 1 toggles STEP once in each turn of the counter, at 0, 0, 1, 1 and so on up to 39,
// while another interrupt comes at any time.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

EMPTY_INTERRUPT(TIMER3_COMPA_vect)

static volatile uint8_t at;

// Far from any match.
ISR(TIMER1_COMPB_vect)
{
    OCR1A = at++ / 2;
}

int main(void)
{
    DDRA = 1 << PA2; // ENABLE, low
    DDRB = 1 << PB5; // STEP
    OCR1B = 0x8000;
    TIMSK1 = 1 << OCIE1B;
    TCCR1A = 1 << COM1A0;
    TCCR1B = 1 << CS10;
    OCR3A = 36;
    TIMSK3 = 1 << OCIE3A;
    TCCR3B = 1 << WGM32 | 1 << CS30;
    sei();
    for (;;)
        sleep_mode();
}
