/* A second-order loop on the arrival of SYNC (docs/firmware.md, "Clock"); integers throughout. */
#include "firmware.h"

enum { PHASE_SHIFT = 4, RATE_SHIFT = 10, LIMIT_SHIFT = 4, JUMP_AFTER = 8, LOST_AFTER = 10 };

/* Divide by a power of two, rounding down also below zero. */
static int64_t shifted(int64_t value, int shift)
{
    int64_t unit = INT64_C(1) << shift;
    return value >= 0 ? value / unit : -((-value + unit - 1) / unit);
}

void clock_power_on(struct clock *clock, int64_t period_ns)
{
    *clock = (struct clock){.period_q16 = period_ns * 65536};
}

void clock_synchronise(struct clock *clock, int64_t arrival_ns, int64_t epochs_late)
{
    int64_t period_ns = clock->period_q16 / 65536;
    int64_t error_ns = arrival_ns - (clock->next_ns - epochs_late * period_ns);
    int64_t limit_ns = period_ns / (1 << LIMIT_SHIFT);
    clock->missed = 0;
    clock->lost = false;
    if (!clock->synchronised) {
        clock->next_ns = arrival_ns;
        clock->fraction_q16 = 0;
        clock->synchronised = true;
        clock->outliers = 0;
    } else if (error_ns > period_ns / 2 || error_ns < -(period_ns / 2)) {
        if (++clock->outliers == JUMP_AFTER) {
            clock->next_ns += error_ns;
            clock->jumps++;
            clock->outliers = 0;
        }
    } else {
        if (error_ns > limit_ns)
            error_ns = limit_ns;
        if (error_ns < -limit_ns)
            error_ns = -limit_ns;
        clock->next_ns += shifted(error_ns, PHASE_SHIFT);
        clock->period_q16 += shifted(error_ns * 65536, RATE_SHIFT);
        clock->outliers = 0;
    }
}

void clock_advance(struct clock *clock)
{
    clock->fraction_q16 += clock->period_q16;
    clock->next_ns += clock->fraction_q16 / 65536;
    clock->fraction_q16 %= 65536;
    if (!clock->seen) {
        clock->missed++;
        clock->lost = clock->missed >= LOST_AFTER;
    }
}

double clock_error_ppm(const struct clock *clock, int64_t period_ns)
{
    return ((double)clock->period_q16 / ((double)period_ns * 65536.0) - 1.0) * 1e6;
}
