/*
 * The navigation computer on a Cortex-M7 without an operating system, in QEMU's mps2-an500.
 *
 * A host feeds it through semihosting: the command line names two pipes. An epoch is a head and
 * its frames, in either direction; the head back tells how many instructions the step took.
 */
#include <stddef.h>
#include <stdint.h>

#include "rrins_firmware.h"

enum { INBOX = 512, STACK = 65536 };
enum { SYS_OPEN = 1, SYS_WRITE = 5, SYS_READ = 6, SYS_GET_CMDLINE = 0x15, SYS_EXIT = 0x18 };
enum { MODE_READ = 1, MODE_WRITE = 5, EXIT_STOPPED = 0x20026, EXIT_FAULT = 0x20023 };

struct head_in {
    int64_t sync_arrival_ns;
    uint32_t count, is_whole;
};
struct head_out {
    int64_t epoch;
    uint32_t count, consumed, ticks, mode;
};

static struct rrins_firmware_ram ram;
static struct rrins_frame inbox[INBOX], outbox[RRINS_FIRMWARE_OUTBOX];

extern uint32_t data_start, data_end, data_load, bss_start, bss_end, stack_end;

static volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010;

static intptr_t host(intptr_t call, const void *arguments)
{
    register intptr_t r0 __asm__("r0") = call;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static _Noreturn void leave(uintptr_t reason)
{
    host(SYS_EXIT, (const void *)reason);
    for (;;)
        ;
}

static void transfer(intptr_t call, intptr_t pipe, void *data, size_t size)
{
    uint8_t *at = data;
    while (size > 0) {
        const intptr_t arguments[] = {pipe, (intptr_t)at, (intptr_t)size};
        size_t left = (size_t)host(call, arguments);
        if (left > size || (left == size && call == SYS_READ))
            leave(EXIT_STOPPED); /* the host has closed the pipe */
        at += size - left;
        size = left;
    }
}

static intptr_t open_pipe(char *name, intptr_t mode)
{
    size_t length = 0;
    while (name[length] != '\0' && name[length] != ' ')
        length++;
    const intptr_t arguments[] = {(intptr_t)name, mode, (intptr_t)length};
    name[length] = '\0';
    return host(SYS_OPEN, arguments);
}

static char *word(char *text, int number)
{
    while (number > 0 && *text != '\0')
        if (*text++ == ' ')
            number--;
    return text;
}

static void navigate(void)
{
    static char line[512];
    const intptr_t arguments[] = {(intptr_t)line, sizeof line};
    intptr_t from, to;
    char *first, *second;
    host(SYS_GET_CMDLINE, arguments);
    first = word(line, 1);
    second = word(line, 2);
    to = open_pipe(second, MODE_WRITE);
    from = open_pipe(first, MODE_READ);
    if (from < 0 || to < 0)
        leave(EXIT_FAULT);
    rrins_firmware_power_on(&ram);
    for (;;) {
        struct head_in in;
        struct head_out out = {0};
        uint32_t before;
        transfer(SYS_READ, from, &in, sizeof in);
        if (in.count > INBOX)
            leave(EXIT_FAULT);
        transfer(SYS_READ, from, inbox, in.count * sizeof *inbox);
        ram.clock.sync_arrival_ns = in.sync_arrival_ns;
        ram.clock.is_whole = in.is_whole != 0;
        before = systick[2];
        out.count = (uint32_t)rrins_firmware_step(&ram, rrins_contract, inbox, (int32_t)in.count,
                                                  outbox);
        out.ticks = (before - systick[2]) & 0xFFFFFF; /* it counts down */
        out.epoch = ram.epoch;
        out.consumed = (uint32_t)ram.consumed;
        out.mode = (uint32_t)ram.modes.mode;
        transfer(SYS_WRITE, to, &out, sizeof out);
        transfer(SYS_WRITE, to, outbox, out.count * sizeof *outbox);
    }
}

void reset(void)
{
    volatile uint32_t *const cpacr = (volatile uint32_t *)0xE000ED88;
    uint32_t *from = &data_load;
    *cpacr |= 0xF << 20; /* the floating-point unit */
    __asm__ volatile("dsb\n isb");
    for (uint32_t *at = &data_start; at < &data_end;)
        *at++ = *from++;
    for (uint32_t *at = &bss_start; at < &bss_end;)
        *at++ = 0;
    systick[1] = 0xFFFFFF;
    systick[2] = 0;
    systick[0] = 5; /* on, by the processor's clock */
    navigate();
}

/* LLVM's names of what the C library has under those of ARM's ABI. */
double __floatdidf(int64_t value);
double __floatundidf(uint64_t value);
int64_t __fixdfdi(double value);

double __floatdidf(int64_t value)
{
    return (double)value;
}

double __floatundidf(uint64_t value)
{
    return (double)value;
}

int64_t __fixdfdi(double value)
{
    return (int64_t)value;
}

/* The start-up code of the C library, which is never entered, refers to it. */
int main(void)
{
    return 0;
}

static void fault(void)
{
    leave(EXIT_FAULT);
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_end, reset, fault, fault, fault, fault, fault,
    [11] = fault, [12] = fault, [14] = fault, [15] = fault,
};
