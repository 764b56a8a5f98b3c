// The step of firmware/src/self_test.rs as a laboratory would write it today:
// plain C, avr-libc's pow, no units, no effects. `cargo xtask bench board` runs it
// in the same simulator and prints its cycles beside ours.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#define MARK_STEP 1
#define MARK_POWER 3

// Volatile, so that nothing is computed while compiling.
volatile float inertia = 0.36, damping = 0.913, stiffness = 0.127, exponent = 2.365;
volatile float gain = 2.17e-5, pressure = 10000, dt = 0.005;
volatile float start_angle = 0.3, start_rate = 0.1, result;

struct model { float inertia, damping, stiffness, exponent, force; };
struct state { float angle, rate; };

static float acceleration(const struct model *m, float angle, float rate)
{
    float power = pow(fabs(angle), m->exponent);
    if (angle < 0)
        power = -power;
    return (m->force - m->damping * rate - m->stiffness * power) / m->inertia;
}

static __attribute__((noinline)) void step(const struct model *m, struct state *s, float h)
{
    float half = 0.5f * h;
    float v1 = s->rate, a1 = acceleration(m, s->angle, v1);
    float v2 = s->rate + half * a1, a2 = acceleration(m, s->angle + half * v1, v2);
    float v3 = s->rate + half * a2, a3 = acceleration(m, s->angle + half * v2, v3);
    float v4 = s->rate + h * a3, a4 = acceleration(m, s->angle + h * v3, v4);
    float sixth = h / 6.0f;
    s->angle += sixth * (v1 + 2 * (v2 + v3) + v4);
    s->rate += sixth * (a1 + 2 * (a2 + a3) + a4);
}

static void send(char c)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = c;
}

static void send_bits(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    for (int8_t shift = 28; shift >= 0; shift -= 4) {
        uint8_t digit = (bits >> shift) & 0xf;
        send(digit < 10 ? '0' + digit : 'a' + digit - 10);
    }
}

int main(void)
{
    UBRR0 = 16;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);

    struct model m = {inertia, damping, stiffness, exponent, gain * pressure};
    struct state s = {start_angle, start_rate};
    float h = dt, base = start_angle, power = exponent;

    GPIOR0 = MARK_POWER;
    result = pow(base, power);
    GPIOR0 = 0;

    GPIOR0 = MARK_STEP;
    step(&m, &s, h);
    GPIOR0 = 0;

    send_bits(s.angle);
    send(' ');
    send_bits(s.rate);
    send('\n');
    // Time for the last character to leave.
    for (volatile uint16_t wait = 0; wait < 2000; wait++)
        ;
    cli();
    sleep_mode();
}
