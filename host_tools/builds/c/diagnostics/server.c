/* Sessions, the order of checks, and the services that manage them: ISO 14229-1, 8.7. */
#include <string.h>

#include "uds.h"

enum { NEGATIVE = 0x7F, POSITIVE = 0x40, SUPPRESS = 0x80 };
enum { SEED = 1, KEY = 2 };

static int session_control(struct server *, const uint8_t *, size_t, struct out *);
static service_function reset_computer, access_security, control_communication, tester_present,
    control_setting;

static service_function *handler_of(uint8_t number)
{
    switch (number) {
    case 0x10: return session_control;
    case 0x11: return reset_computer;
    case 0x14: return clear_troubles;
    case 0x19: return read_troubles;
    case 0x22: return read_data;
    case 0x23: return read_memory;
    case 0x27: return access_security;
    case 0x28: return control_communication;
    case 0x2E: return write_data;
    case 0x2F: return control_output;
    case 0x31: return control_routine;
    case 0x34: return request_download;
    case 0x35: return request_upload;
    case 0x36: return transfer_data;
    case 0x37: return exit_transfer;
    case 0x3E: return tester_present;
    case 0x85: return control_setting;
    default: return NULL;
    }
}

static const struct service *service_of(uint8_t number)
{
    for (size_t k = 0; k < SERVICES; k++)
        if (services[k].number == number)
            return &services[k];
    return NULL;
}

bool server_allows(const struct server *server, uint8_t access)
{
    return (access >> server->session & 1) != 0;
}

bool server_is_open(const struct server *server, uint8_t access)
{
    return server->is_unlocked || (access & ACCESS_SECURED) == 0;
}

bool server_is_idle(const struct server *server)
{
    return server->poll == NULL && server->session == SESSION_DEFAULT &&
           server->reset_wanted == RESET_NONE && !routines_are_busy(server);
}

/* Enter a session, and lock the computer again. */
static void enter_session(struct server *server, int session)
{
    server->is_unlocked = server->has_seed = false;
    server->transfer.is_active = false;
    if (session == SESSION_DEFAULT) {
        server->silent = 0;
        server->computer.ram->diagnostics.held = false;
        return_control(server);
        routines_leave_session(server);
    }
    server->session = session;
}

void server_power_on(struct server *server)
{
    enter_session(server, SESSION_DEFAULT);
    server->poll = NULL;
    server->reset_wanted = RESET_NONE;
}

static bool refused(uint8_t service, int code, bool is_functional, struct out *out)
{
    static const int silent_when_functional[] = SILENT_WHEN_FUNCTIONAL;
    out->size = 0;
    for (size_t k = 0; k < sizeof silent_when_functional / sizeof(int) && is_functional; k++)
        if (silent_when_functional[k] == code)
            return false; /* it may be for others */
    put_number(out, (uint64_t)NEGATIVE << 16 | (uint64_t)service << 8 | (uint64_t)code, 3);
    return true;
}

static bool poll_pending(struct server *server, struct out *out)
{
    uint8_t service = server->pending_service;
    int said;
    out->size = 0;
    put_number(out, (uint64_t)service + POSITIVE, 1);
    said = server->poll(server, out);
    if (said == DONE) {
        server->poll = NULL;
        return server->is_wanted;
    }
    if (said != LATER) {
        server->poll = NULL;
        return refused(service, said, server->is_functional, out);
    }
    if (server->now_ns < server->due_ns)
        return false;
    server->due_ns = server->now_ns + PENDING_AGAIN_NS;
    server->is_wanted = true; /* a response pending obliges to respond */
    return refused(service, RESPONSE_PENDING, false, out);
}

/* Check the sub-function in the first byte; a negative response code, or 0. */
static int check_subfunction(const struct server *server, const struct service *service,
                             const uint8_t *data, size_t size)
{
    if (size < 1)
        return INCORRECT_MESSAGE_LENGTH;
    for (size_t k = 0; k < service->subfunction_count; k++) {
        uint8_t access = service->subfunctions[k].access;
        if (service->subfunctions[k].number != (data[0] & ~SUPPRESS))
            continue;
        if (access != 0 && !server_allows(server, access))
            return SUB_FUNCTION_NOT_SUPPORTED_IN_ACTIVE_SESSION;
        return access != 0 && !server_is_open(server, access) ? SECURITY_ACCESS_DENIED : 0;
    }
    return SUB_FUNCTION_NOT_SUPPORTED;
}

static bool serve(struct server *server, const uint8_t *request, size_t size, bool is_functional,
                  struct out *out)
{
    static uint8_t data[MESSAGE_CAPACITY + 1];
    const struct service *service = service_of(request[0]);
    bool is_wanted = true;
    int said = 0;
    if (service == NULL || server->reset_wanted != RESET_NONE)
        return refused(request[0], SERVICE_NOT_SUPPORTED, is_functional, out);
    if (!server_allows(server, service->access))
        return refused(request[0], SERVICE_NOT_SUPPORTED_IN_ACTIVE_SESSION, is_functional, out);
    if (!server_is_open(server, service->access))
        return refused(request[0], SECURITY_ACCESS_DENIED, is_functional, out);
    memcpy(data, request + 1, size - 1);
    if (service->subfunction_count > 0) {
        said = check_subfunction(server, service, data, size - 1);
        if (said != 0)
            return refused(request[0], said, is_functional, out);
        is_wanted = (data[0] & SUPPRESS) == 0;
        data[0] &= (uint8_t)~SUPPRESS;
    }
    put_number(out, (uint64_t)request[0] + POSITIVE, 1);
    said = handler_of(request[0])(server, data, size - 1, out);
    if (said == DONE)
        return is_wanted;
    if (said != LATER)
        return refused(request[0], said, is_functional, out);
    server->pending_service = request[0];
    server->is_wanted = is_wanted;
    server->is_functional = is_functional;
    server->due_ns = server->now_ns + PENDING_NS;
    return poll_pending(server, out);
}

bool server_handle(struct server *server, const uint8_t *request, size_t size, bool is_functional,
                   int64_t now_ns, struct out *out)
{
    server->now_ns = server->last_ns = now_ns;
    out->size = 0;
    out->is_too_long = false;
    if (size == 0 || (server->poll != NULL && is_functional))
        return false;
    if (server->poll != NULL)
        return refused(request[0], BUSY_REPEAT_REQUEST, false, out);
    return serve(server, request, size, is_functional, out);
}

bool server_poll(struct server *server, int64_t now_ns, struct out *out)
{
    bool is_answered = false;
    server->now_ns = now_ns;
    if (routines_are_busy(server))
        routines_work(server);
    if (server->poll != NULL)
        is_answered = poll_pending(server, out);
    if (server->poll != NULL)
        server->last_ns = now_ns;
    else if (server->session != SESSION_DEFAULT && now_ns - server->last_ns >= S3_NS)
        enter_session(server, SESSION_DEFAULT);
    return is_answered;
}

static int session_control(struct server *server, const uint8_t *data, size_t size,
                           struct out *out)
{
    if (size != 1)
        return INCORRECT_MESSAGE_LENGTH;
    enter_session(server, data[0]);
    put(out, data, 1);
    put_number(out, P2_MS, 2);
    put_number(out, P2_STAR_MS / 10, 2);
    return DONE;
}

static int reset_computer(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    int64_t mode = server->computer.ram->modes.mode;
    bool navigates = mode == RRINS_MODE_FINE_ALIGNMENT ||
                     mode == RRINS_MODE_NAVIGATION_STRAPDOWN ||
                     mode == RRINS_MODE_NAVIGATION_ROTATING;
    if (size != 1)
        return INCORRECT_MESSAGE_LENGTH;
    if (navigates && !server->is_unlocked)
        return CONDITIONS_NOT_CORRECT;
    server->reset_wanted = data[0] == RESET_HARD ? RESET_HARD : RESET_SOFT;
    put(out, data, 1);
    return DONE;
}

static int give_seed(struct server *server, struct out *out)
{
    static const uint8_t zeros[SEED_SIZE];
    if (server->is_unlocked) {
        put(out, zeros, sizeof zeros);
        return DONE;
    }
    if (server->now_ns < server->closed_until_ns)
        return REQUIRED_TIME_DELAY_NOT_EXPIRED;
    server->has_seed = false;
    if (!random_bytes(server->seed, SEED_SIZE))
        return CONDITIONS_NOT_CORRECT; /* without a seed nobody is let in */
    if (memcmp(server->seed, zeros, SEED_SIZE) == 0)
        memset(server->seed, 1, SEED_SIZE); /* zero: unlocked */
    server->has_seed = true;
    put(out, server->seed, SEED_SIZE);
    return DONE;
}

static int access_security(struct server *server, const uint8_t *data, size_t size,
                           struct out *out)
{
    uint8_t right[KEY_SIZE], difference = 0;
    put(out, data, 1);
    if (data[0] == SEED)
        return size == 1 ? give_seed(server, out) : INCORRECT_MESSAGE_LENGTH;
    if (size != 1 + KEY_SIZE)
        return INCORRECT_MESSAGE_LENGTH;
    if (!server->has_seed)
        return REQUEST_SEQUENCE_ERROR;
    key_of(server->seed, right);
    server->has_seed = false;
    for (size_t k = 0; k < KEY_SIZE; k++) /* all of it: the time tells nothing */
        difference |= (uint8_t)(right[k] ^ data[1 + k]);
    if (difference == 0) {
        server->attempts = 0;
        server->is_unlocked = true;
        return DONE;
    }
    if (++server->attempts < ATTEMPTS)
        return INVALID_KEY;
    server->attempts = ATTEMPTS - 1; /* one more after the delay */
    server->closed_until_ns = server->now_ns + ATTEMPT_DELAY_NS;
    return EXCEEDED_NUMBER_OF_ATTEMPTS;
}

static int control_communication(struct server *server, const uint8_t *data, size_t size,
                                 struct out *out)
{
    int types, network;
    if (size != 2)
        return INCORRECT_MESSAGE_LENGTH;
    types = data[1] & 0x0F, network = data[1] & 0xF0;
    if ((network != 0x00 && network != 0xF0) || types == 0 || types > 3)
        return REQUEST_OUT_OF_RANGE;
    server->silent = data[0] == 1 ? server->silent | types : server->silent & ~types;
    put(out, data, 1);
    return DONE;
}

static int tester_present(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    (void)server;
    if (size != 1)
        return INCORRECT_MESSAGE_LENGTH;
    put(out, data, 1);
    return DONE;
}

static int control_setting(struct server *server, const uint8_t *data, size_t size,
                           struct out *out)
{
    if (size != 1)
        return INCORRECT_MESSAGE_LENGTH;
    server->computer.ram->diagnostics.held = data[0] == 2;
    put(out, data, 1);
    return DONE;
}
