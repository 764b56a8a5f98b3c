// SPDX-License-Identifier: GPL-3.0-or-later
// Does what single letters on the serial line ask for, so that tests can move
// every pin of the virtual rig.

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

static uint8_t cause;
uint8_t kept __attribute__((section(".noinit")));

static void put(char c)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = c;
}

static void text(const char *s)
{
    while (*s)
        put(*s++);
}

static void number(const char *name, long value)
{
    char digits[12];
    int n = 0;
    text(name);
    put(' ');
    if (value < 0) {
        put('-');
        value = -value;
    }
    do
        digits[n++] = '0' + value % 10;
    while (value /= 10);
    while (n)
        put(digits[--n]);
    put('\n');
}

static char get(void)
{
    while (!(UCSR0A & _BV(RXC0)))
        ;
    return UDR0;
}

static uint16_t convert(uint8_t channel)
{
    ADMUX = _BV(REFS0) | channel;
    ADCSRA |= _BV(ADSC);
    while (ADCSRA & _BV(ADSC))
        ;
    return ADC;
}

static void steps(uint16_t count)
{
    while (count--) {
        PORTB |= _BV(5);
        for (volatile uint8_t i = 0; i < 4; i++)
            ;
        PORTB &= ~_BV(5);
        for (volatile uint8_t i = 0; i < 4; i++)
            ;
    }
}

int main(void)
{
    cause = MCUSR;
    MCUSR = 0;
    WDTCSR = _BV(WDCE) | _BV(WDE);
    WDTCSR = 0;
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0) | _BV(RXEN0);
    ADCSRA = _BV(ADEN) | 7;
    PORTE |= _BV(4) | _BV(5); // pull-ups
    PORTD |= _BV(0);
    text("ready\n");
    for (;;) {
        char c = get();
        GPIOR0 = 0x7f;
        switch (c) {
        case 'x': // outputs on, driver and valve off
            PORTA = _BV(2);
            DDRA = _BV(0) | _BV(2) | _BV(4);
            DDRB |= _BV(5) | _BV(7);
            break;
        case 'e': PORTA &= ~_BV(2); break;
        case 'd': PORTA |= _BV(2); break;
        case 'i': PORTA |= _BV(0); break;
        case 'o': PORTA &= ~_BV(0); break;
        case 'c': PORTA |= _BV(4); break;
        case 'v': PORTA &= ~_BV(4); break;
        case 'l': PORTB |= _BV(7); break;
        case 's': steps(16); break;
        case 'S': steps(16000); break;
        case 'p': number("pressure", convert(0)); break;
        case 'f': number("flex", convert(1)); break;
        case 'k': number("switches", (PINE >> 4 & 3) | (PIND & 1) << 2); break;
        case 'm': number("cause", cause); break;
        case 'M': kept = 42; break;
        case 'r': number("kept", kept); break;
        case 'w':
        { // one byte, counting how long EEPE stays set
            uint16_t turns = 0;
            EEAR = 100;
            EEDR = 0x5a;
            EECR = 0;
            EECR |= _BV(EEMPE);
            EECR |= _BV(EEPE);
            while (EECR & _BV(EEPE))
                turns++;
            number("turns", turns);
            number("reads", eeprom_read_byte((uint8_t *)100));
            break;
        }
        case 'W': // does not wait: the second byte is ignored
            EEAR = 200;
            EEDR = 1;
            EECR = 0;
            EECR |= _BV(EEMPE);
            EECR |= _BV(EEPE);
            EEAR = 201;
            EEDR = 2;
            EECR |= _BV(EEMPE);
            EECR |= _BV(EEPE);
            break;
        case 'L': // the window has closed
            EEAR = 300;
            EEDR = 3;
            EECR = 0;
            EECR |= _BV(EEMPE);
            __asm__ volatile("nop\n nop\n nop\n nop\n nop\n nop\n nop\n nop");
            EECR |= _BV(EEPE);
            break;
        case 'D': // bites in 16 ms
            wdt_enable(WDTO_15MS);
            for (;;)
                ;
        case 'H': // halts until the watchdog bites
            wdt_enable(WDTO_30MS);
            // fallthrough
        case 'h': // halts for good
            cli();
            SMCR = _BV(SE);
            sleep_cpu();
        case '\n': break;
        default: put(c); put('\n');
        }
        GPIOR0 = 0;
    }
}
