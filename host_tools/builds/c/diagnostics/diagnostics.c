#include "diagnostics.h"

#include <stdio.h>
#include <string.h>

#include "uds.h"

_Static_assert(DIAGNOSTIC_FRAMES == SLOTS, "room for the frames of diagnostics");

static struct server server;
static struct isotp tp;
static struct store *fault_store;
static struct write_job *fault_job;
static struct out out;
static bool is_awake, is_reset_due;
static int64_t steps_before;

static int64_t time_ns(void)
{
    return (steps_before + server.computer.ram->steps) * PERIOD_NS;
}

static void recall_faults(void)
{
    static uint8_t image[FAULT_CAPACITY];
    uint64_t sequence;
    size_t size;
    enum condition condition;
    if (fault_store == NULL)
        return;
    condition = store_read(fault_store, image, &size, &sequence);
    if (condition == MEMORY_WHOLE || condition == MEMORY_ONE_DAMAGED) {
        faults_recall(&server.computer, image, size);
        faults_begin_cycle(&server.computer);
    }
    server.computer.are_faults_new = is_awake = true; /* the power may fail before anything else */
}

bool diagnostics_open(const char *path, char *reason, size_t size)
{
    char beside[4096];
    int length = snprintf(beside, sizeof beside, "%s.dtc", path);
    if (length < 0 || (size_t)length >= sizeof beside) {
        snprintf(reason, size, "too long a path");
        return false;
    }
    server.computer.memory.store = store_open(path, CALIBRATION_CAPACITY, reason, size);
    if (server.computer.memory.store != NULL)
        fault_store = store_open(beside, FAULT_CAPACITY, reason, size);
    return fault_store != NULL;
}

void diagnostics_power_on(struct rrins_firmware_ram *ram)
{
    server.computer.ram = ram;
    server.computer.operation_cycles = 1;
    server.session = SESSION_DEFAULT;
    server.closed_until_ns = -1;
    server.computer.memory.waits = true;
    isotp_reset(&tp);
    parameters_load(&server.computer.memory);
    computer_power_on(&server.computer);
    routines_forget(&server);
    recall_faults();
}

bool diagnostics_restart_if_due(void)
{
    static uint8_t kept[sizeof server.computer.ram->diagnostics.troubles];
    struct computer *computer = &server.computer;
    bool is_hard = server.reset_wanted == RESET_HARD;
    if (!is_reset_due)
        return false;
    if (is_hard) {
        store_wait(computer->memory.store);
        store_wait(fault_store);
        parameters_load(&computer->memory);
    }
    memcpy(kept, &computer->ram->diagnostics.troubles, sizeof kept);
    steps_before += computer->ram->steps;
    computer_power_on(computer);
    memcpy(&computer->ram->diagnostics.troubles, kept, sizeof kept);
    faults_begin_test(computer);
    if (is_hard) {
        faults_begin_cycle(computer);
        computer->are_faults_new = true;
    }
    routines_forget(&server);
    isotp_reset(&tp);
    server_power_on(&server);
    is_reset_due = false;
    is_awake = true;
    return true;
}

static void receive(const struct rrins_frame *inbox, size_t count)
{
    for (size_t k = 0; k < count; k++)
        if (inbox[k].can_id == REQUEST_ID || inbox[k].can_id == FUNCTIONAL_ID)
            isotp_put(&tp, (uint16_t)inbox[k].can_id, inbox[k].data,
                      inbox[k].length < 8 ? inbox[k].length : 8);
}

static void save_faults(bool waits)
{
    static uint8_t image[FAULT_CAPACITY];
    struct computer *computer = &server.computer;
    if (fault_store == NULL) {
        computer->are_faults_new = false;
        return;
    }
    if (fault_job != NULL && write_job_is_done(fault_job))
        fault_job = NULL;
    if (computer->are_faults_new && fault_job == NULL) {
        computer->are_faults_new = false;
        faults_image(computer, image);
        fault_job = store_write(fault_store, image, sizeof image, waits);
    }
}

/* Let the server process at most one request; the number of frames to send. */
static size_t serve(uint8_t frames[SLOTS][8])
{
    int64_t now_ns = time_ns();
    bool is_answered;
    size_t sent;
    isotp_begin(&tp, now_ns);
    if (isotp_is_sending(&tp) || tp.is_receiving)
        server.last_ns = now_ns;
    is_answered = server_poll(&server, now_ns, &out);
    if (!is_answered && !isotp_is_sending(&tp)) {
        const struct message *request = isotp_functional(&tp);
        bool is_functional = request != NULL;
        if (request == NULL)
            request = isotp_request(&tp);
        if (request != NULL)
            is_answered = server_handle(&server, request->at, request->size, is_functional,
                                        now_ns, &out);
    }
    if (is_answered) {
        /* Many tools count P2 to the last frame of a response, not to the first. */
        if (isotp_sending_ns(&tp, out.size) > LONG_SENDING_NS) {
            const uint8_t pending[] = {0x7F, (uint8_t)(out.at[0] - 0x40), RESPONSE_PENDING};
            (void)isotp_send(&tp, pending, sizeof pending);
        }
        (void)isotp_send(&tp, out.at, out.size);
    }
    sent = isotp_end(&tp, frames);
    is_reset_due = server.reset_wanted != RESET_NONE && !isotp_is_sending(&tp);
    return sent;
}

static int silenced_type(uint32_t can_id)
{
    for (size_t k = 0; k < SILENCED_IDS; k++)
        if (silenced_ids[k] == can_id)
            return silenced_types[k];
    return 0;
}

/* Remove the cyclic messages that a tool has stopped. */
static size_t without_silenced(struct rrins_frame *outbox, size_t sent)
{
    size_t kept = 0;
    for (size_t k = 0; k < sent; k++)
        if ((silenced_type(outbox[k].can_id) & server.silent) == 0)
            outbox[kept++] = outbox[k];
    return kept;
}

size_t diagnostics_run(const struct rrins_frame *inbox, size_t count, struct rrins_frame *outbox,
                       size_t sent, bool waits)
{
    struct rrins_firmware_ram *ram = server.computer.ram;
    int64_t attention = ram->diagnostics.attention;
    uint8_t frames[SLOTS][8];
    if (attention == 0 && !is_awake)
        return sent;
    server.computer.memory.waits = waits;
    ram->diagnostics.attention = 0;
    if ((attention & ATTENTION_FRAMES) != 0)
        receive(inbox, count);
    if ((attention & ATTENTION_TROUBLES) != 0)
        server.computer.are_faults_new = true;
    save_faults(waits);
    if ((attention & ATTENTION_FRAMES) != 0 || is_awake) {
        size_t answers = serve(frames);
        sent = without_silenced(outbox, sent);
        if (answers > 0) {
            outbox[sent - 1 + answers] = outbox[sent - 1];
            for (size_t k = 0; k < answers; k++) {
                struct rrins_frame *frame = &outbox[sent - 1 + k];
                *frame = (struct rrins_frame){.can_id = RESPONSE_ID, .length = 8};
                memcpy(frame->data, frames[k], sizeof frames[k]);
            }
            sent += answers;
        }
    }
    is_awake = !isotp_is_idle(&tp) || !server_is_idle(&server) || server.silent != 0 ||
               fault_job != NULL || server.computer.are_faults_new;
    return sent;
}

void diagnostics_close(void)
{
    static uint8_t image[FAULT_CAPACITY];
    if (fault_store != NULL) {
        faults_image(&server.computer, image);
        (void)store_write(fault_store, image, sizeof image, true);
    }
    store_wait(server.computer.memory.store);
}
