// SPDX-License-Identifier: GPL-3.0-or-later
// As busy as a control program gets: step pulses by hardware at 16 kHz, back to
// back conversions and a 1 kHz tick by interrupt, floating point all the time,
// and a line of telemetry a hundred times a second.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <math.h>

static volatile uint16_t ticks, sum;
static volatile float result = 0.5;

ISR(TIMER3_COMPA_vect)
{
    ticks++;
}

ISR(ADC_vect)
{
    sum += ADC;
    ADMUX ^= 1;
    ADCSRA |= _BV(ADSC);
}

int main(void)
{
    DDRA = _BV(0) | _BV(2) | _BV(4);
    PORTA = _BV(0) | _BV(4);
    DDRB = _BV(5);
    OCR1A = 499; // toggles at 32 kHz
    TCCR1A = _BV(COM1A0);
    TCCR1B = _BV(WGM12) | _BV(CS10);
    OCR3A = 15999;
    TCCR3B = _BV(WGM32) | _BV(CS30);
    TIMSK3 = _BV(OCIE3A);
    ADMUX = _BV(REFS0);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADSC) | 7;
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);
    sei();
    uint16_t said = 0;
    for (;;) {
        result = powf(result, 1.727f) * 0.5f + 0.3f;
        if (ticks - said >= 10) {
            said = ticks;
            for (uint8_t i = 0; i < 60; i++) {
                while (!(UCSR0A & _BV(UDRE0)))
                    result = result * 0.99f + 0.001f;
                UDR0 = i < 59 ? 'a' + i % 26 : '\n';
            }
        }
    }
}
