#define _GNU_SOURCE
#include "rrins_bus.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the embedded bus is for little-endian machines"
#endif

enum {
    HELLO = 1,
    WELCOME = 2,
    REFUSED = 3,
    BYE = 4,
    FRAMES = 5,
    CLOSES_EPOCH = 1,
    TEXT_LIMIT = 512,
    DATAGRAM_LIMIT = 65536,
    SEND_BUFFER = 4 * 1024 * 1024,
    BACKLOG_LIMIT = 4 * 1024 * 1024,
    RETRY_NS = 20000000
};

struct header {
    uint8_t magic[4];
    uint8_t kind;
    uint8_t flags;
    uint16_t count;
    uint32_t sender;
    uint32_t reserved;
    uint64_t epoch;
    int64_t time_ns;
};

_Static_assert(sizeof(struct header) == 32, "the header of a datagram has 32 bytes");
_Static_assert(sizeof(struct rrins_frame) == 16, "a frame has 16 bytes");

static const uint8_t MAGIC[4] = {'R', 'R', 'B', '0' + RRINS_BUS_VERSION};

/* A datagram that arrived while this end waited for room to send. */
struct kept {
    struct kept *next;
    size_t size;
    uint8_t bytes[];
};

struct rrins_bus {
    int socket;
    uint32_t number;
    bool has_ended;
    char channel[128];
    char reason[TEXT_LIMIT + 160];
    struct kept *first, *last;
    size_t kept_bytes;
    uint8_t buffer[DATAGRAM_LIMIT + 1];
};

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Wait until a socket is ready, for at most left_ns. */
static int ready(int socket, short events, int64_t left_ns)
{
    struct pollfd wait = {.fd = socket, .events = events};
    struct timespec left = {0, 0};
    if (left_ns > 0)
        left = (struct timespec){(time_t)(left_ns / 1000000000), (long)(left_ns % 1000000000)};
    return ppoll(&wait, 1, &left, NULL);
}

static void say(char *reason, size_t size, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    vsnprintf(reason, size, format, values);
    va_end(values);
}

/* Write the path of a channel's socket; a folder of channels has to be this user's alone. */
static int socket_path(const char *channel, char *path, size_t path_size, char *reason,
                       size_t size)
{
    char folder[256];
    const char *runtime = getenv("XDG_RUNTIME_DIR");
    const char *temporary = getenv("TMPDIR");
    struct stat status;
    if (strchr(channel, '/') != NULL) {
        if ((size_t)snprintf(path, path_size, "%s", channel) >= path_size) {
            say(reason, size, "the path %s is too long for a socket", channel);
            return -1;
        }
        return 0;
    }
    if (runtime != NULL && stat(runtime, &status) == 0 && S_ISDIR(status.st_mode))
        snprintf(folder, sizeof folder, "%s/rrins", runtime);
    else
        snprintf(folder, sizeof folder, "%s/rrins-%u",
                 temporary != NULL && *temporary ? temporary : "/tmp", (unsigned)geteuid());
    if (lstat(folder, &status) == 0 &&
        (!S_ISDIR(status.st_mode) || status.st_uid != geteuid() || (status.st_mode & 077))) {
        say(reason, size, "the folder of the bus %s is not this user's alone", folder);
        return -1;
    }
    if ((size_t)snprintf(path, path_size, "%s/%s.sock", folder, channel) >= path_size) {
        say(reason, size, "the path of channel %s is too long for a socket", channel);
        return -1;
    }
    return 0;
}

/* Connect to the host of a channel; -1 with errno, or with a reason and errno 0. */
static int connect_once(const struct sockaddr_un *address, char *reason, size_t size)
{
    struct ucred host;
    socklen_t length = sizeof host;
    int width = SEND_BUFFER;
    int end = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    if (end < 0)
        return -1;
    if (connect(end, (const struct sockaddr *)address, sizeof *address) != 0) {
        int number = errno;
        close(end);
        errno = number;
        return -1;
    }
    if (getsockopt(end, SOL_SOCKET, SO_PEERCRED, &host, &length) != 0 ||
        (host.uid != geteuid() && host.uid != 0 && geteuid() != 0)) {
        say(reason, size, "the bus at %s is hosted by another user", address->sun_path);
        close(end);
        errno = 0;
        return -1;
    }
    setsockopt(end, SOL_SOCKET, SO_SNDBUF, &width, sizeof width);
    return end;
}

static int connect_until(const char *path, int64_t deadline_ns, char *reason, size_t size)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    for (;;) {
        const struct timespec pause = {0, RETRY_NS};
        int end = connect_once(&address, reason, size);
        if (end >= 0 || errno == 0)
            return end;
        if (errno != ENOENT && errno != ECONNREFUSED && errno != EAGAIN && errno != EINTR) {
            say(reason, size, "cannot attach at %s: %s", path, strerror(errno));
            return -1;
        }
        if (now_ns() >= deadline_ns) {
            say(reason, size, "nobody hosts a bus at %s", path);
            return -1;
        }
        nanosleep(&pause, NULL);
    }
}

/* Check a datagram; on a fault write a reason and return false. */
static bool is_sound(const uint8_t *buffer, size_t size, char *reason, size_t room)
{
    struct header head;
    size_t k;
    if (size < sizeof head || size > DATAGRAM_LIMIT) {
        say(reason, room, "a datagram of %zu bytes, shorter or longer than any", size);
        return false;
    }
    memcpy(&head, buffer, sizeof head);
    if (memcmp(head.magic, MAGIC, 3) == 0 && head.magic[3] != MAGIC[3]) {
        say(reason, room, "the bus speaks version %c of its protocol, this client version %d",
            head.magic[3], RRINS_BUS_VERSION);
        return false;
    }
    if (memcmp(head.magic, MAGIC, 4) != 0 || head.reserved != 0) {
        say(reason, room, "a datagram of another program");
        return false;
    }
    if (head.kind == FRAMES) {
        if (size != sizeof head + head.count * sizeof(struct rrins_frame)) {
            say(reason, room, "a malformed batch of %zu bytes", size);
            return false;
        }
        for (k = 0; k < head.count; k++)
            if (buffer[sizeof head + k * sizeof(struct rrins_frame) + 4] > 8) {
                say(reason, room, "a frame of more than 8 bytes");
                return false;
            }
    } else if (head.kind <= BYE && size != sizeof head + head.count) {
        say(reason, room, "a malformed control datagram of %zu bytes", size);
        return false;
    }
    return true;
}

static int send_hello(int end, const char *name, unsigned wishes)
{
    uint8_t bytes[sizeof(struct header) + 64];
    size_t length = strlen(name);
    struct header head = {.kind = HELLO, .flags = (uint8_t)wishes, .count = (uint16_t)length};
    if (length < 1 || length > 64) {
        errno = EINVAL;
        return -1;
    }
    memcpy(head.magic, MAGIC, sizeof head.magic);
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, name, length);
    /* Refused already: the reason is waiting. */
    if (send(end, bytes, sizeof head + length, MSG_NOSIGNAL) < 0 && errno != EPIPE)
        return -1;
    return 0;
}

static bool is_welcome(struct rrins_bus *bus, int64_t deadline_ns, char *reason, size_t size)
{
    struct header head;
    ssize_t came;
    if (ready(bus->socket, POLLIN, deadline_ns - now_ns()) <= 0) {
        say(reason, size, "the host of channel %s does not answer", bus->channel);
        return false;
    }
    came = recv(bus->socket, bus->buffer, sizeof bus->buffer, 0);
    if (came <= 0) {
        say(reason, size, "the host of channel %s has just left", bus->channel);
        return false;
    }
    if (!is_sound(bus->buffer, (size_t)came, reason, size))
        return false;
    memcpy(&head, bus->buffer, sizeof head);
    if (head.kind != WELCOME) {
        say(reason, size, "%.*s", (int)head.count, (const char *)bus->buffer + sizeof head);
        return false;
    }
    bus->number = head.sender;
    return true;
}

struct rrins_bus *rrins_bus_attach(const char *channel, const char *name, unsigned wishes,
                                   int timeout_ms, char *reason, size_t size)
{
    char path[108];
    int64_t deadline_ns = now_ns() + (int64_t)timeout_ms * 1000000;
    struct rrins_bus *bus = calloc(1, sizeof *bus);
    if (bus == NULL) {
        say(reason, size, "no memory for a bus");
        return NULL;
    }
    bus->socket = -1;
    snprintf(bus->channel, sizeof bus->channel, "%s", channel);
    if (socket_path(channel, path, sizeof path, reason, size) != 0)
        goto failed;
    bus->socket = connect_until(path, deadline_ns, reason, size);
    if (bus->socket < 0)
        goto failed;
    if (send_hello(bus->socket, name, wishes) != 0) {
        say(reason, size, "cannot introduce '%s' to channel %s: %s", name, channel,
            strerror(errno));
        goto failed;
    }
    if (!is_welcome(bus, deadline_ns, reason, size))
        goto failed;
    return bus;
failed:
    if (bus->socket >= 0)
        close(bus->socket);
    free(bus);
    return NULL;
}

/* Take note of the end of the bus; returns -1. */
static int ended(struct rrins_bus *bus, const char *why)
{
    if (!bus->has_ended)
        say(bus->reason, sizeof bus->reason, "channel %s: %s", bus->channel, why);
    bus->has_ended = true;
    return -1;
}

/* Read a datagram into the buffer: its size, 0 if none is there now, -1 at the end. */
static ssize_t read_datagram(struct rrins_bus *bus, int flags)
{
    for (;;) {
        ssize_t came = recv(bus->socket, bus->buffer, sizeof bus->buffer, flags);
        if (came > 0)
            return came;
        if (came < 0 && (errno == EINTR || errno == ECONNRESET))
            continue; /* after a reset, what came before can still be read */
        if (came < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
            return 0;
        return ended(bus, "its host has disappeared");
    }
}

/* Take note of the host's last word; returns -1. */
static int dismissed(struct rrins_bus *bus, const uint8_t *bytes, size_t length)
{
    char why[TEXT_LIMIT + 1];
    if (length > TEXT_LIMIT)
        length = TEXT_LIMIT;
    memcpy(why, bytes + sizeof(struct header), length);
    why[length] = '\0';
    return ended(bus, why);
}

/* Turn a datagram into a batch: 1, 0 for one that is none, -1 at the end. */
static int take(struct rrins_bus *bus, const uint8_t *bytes, size_t size, struct rrins_batch *batch)
{
    struct header head;
    char fault[160];
    if (!is_sound(bytes, size, fault, sizeof fault))
        return ended(bus, fault);
    memcpy(&head, bytes, sizeof head);
    if (head.kind == BYE)
        return dismissed(bus, bytes, head.count);
    if (head.kind != FRAMES)
        return 0; /* FD frames, notes and counts are not for this client */
    batch->sender = head.sender;
    batch->epoch = head.epoch;
    batch->time_ns = head.time_ns;
    batch->closes_epoch = (head.flags & CLOSES_EPOCH) != 0;
    batch->count = head.count;
    memcpy(batch->frames, bytes + sizeof head, head.count * sizeof(struct rrins_frame));
    return 1;
}

int rrins_bus_receive(struct rrins_bus *bus, struct rrins_batch *batch, int64_t timeout_ns)
{
    int64_t deadline_ns = timeout_ns < 0 ? -1 : now_ns() + timeout_ns;
    for (;;) {
        int64_t left_ns;
        ssize_t came;
        int is_batch;
        if (bus->first != NULL) {
            struct kept *kept = bus->first;
            is_batch = take(bus, kept->bytes, kept->size, batch);
            bus->first = kept->next;
            bus->kept_bytes -= kept->size;
            free(kept);
        } else {
            if (bus->has_ended)
                return -1;
            came = read_datagram(bus, timeout_ns < 0 ? 0 : MSG_DONTWAIT);
            if (came < 0)
                return -1;
            if (came == 0) {
                left_ns = deadline_ns - now_ns();
                if (left_ns <= 0)
                    return 0;
                (void)ready(bus->socket, POLLIN, left_ns);
                continue;
            }
            is_batch = take(bus, bus->buffer, (size_t)came, batch);
        }
        if (is_batch != 0)
            return is_batch;
    }
}

/* Keep what arrives while there is no room to send: two nodes that only send would never get any. */
static void keep_arrivals(struct rrins_bus *bus)
{
    while (bus->kept_bytes < BACKLOG_LIMIT && !bus->has_ended) {
        ssize_t came = read_datagram(bus, MSG_DONTWAIT);
        struct kept *kept;
        if (came <= 0)
            return;
        if ((size_t)came >= sizeof(struct header) && bus->buffer[4] == BYE) {
            dismissed(bus, bus->buffer, (size_t)came - sizeof(struct header));
            return;
        }
        kept = malloc(sizeof *kept + (size_t)came);
        if (kept == NULL) {
            ended(bus, "no memory for what arrives");
            return;
        }
        kept->next = NULL;
        kept->size = (size_t)came;
        memcpy(kept->bytes, bus->buffer, kept->size);
        if (bus->first == NULL)
            bus->first = kept;
        else
            bus->last->next = kept;
        bus->last = kept;
        bus->kept_bytes += kept->size;
    }
}

int rrins_bus_send(struct rrins_bus *bus, const struct rrins_frame *frames, size_t count,
                   uint64_t epoch, int64_t time_ns, bool closes_epoch)
{
    static const struct rrins_frame NONE[1];
    struct header head = {.kind = FRAMES,
                          .flags = closes_epoch ? CLOSES_EPOCH : 0,
                          .count = (uint16_t)count,
                          .sender = bus->number,
                          .epoch = epoch,
                          .time_ns = time_ns};
    struct iovec parts[2] = {{&head, sizeof head}, {NULL, count * sizeof *frames}};
    struct msghdr message = {.msg_iov = parts, .msg_iovlen = 2};
    if (count > RRINS_BUS_MAX_FRAMES)
        return ended(bus, "more frames than a batch takes");
    parts[1].iov_base = (void *)(uintptr_t)(count > 0 ? frames : NONE);
    memcpy(head.magic, MAGIC, sizeof head.magic);
    while (!bus->has_ended) {
        if (sendmsg(bus->socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0)
            return 0;
        if (errno != EAGAIN && errno != EINTR) {
            keep_arrivals(bus); /* the host's last word may tell why */
            return ended(bus, "its host no longer accepts data from this end");
        }
        keep_arrivals(bus);
        (void)ready(bus->socket, POLLOUT | POLLIN, RETRY_NS);
    }
    return -1;
}

int rrins_bus_close_epoch(struct rrins_bus *bus, uint64_t epoch, int64_t time_ns)
{
    return rrins_bus_send(bus, NULL, 0, epoch, time_ns, true);
}

const char *rrins_bus_reason(const struct rrins_bus *bus)
{
    return bus->reason;
}

uint32_t rrins_bus_number(const struct rrins_bus *bus)
{
    return bus->number;
}

int rrins_bus_descriptor(const struct rrins_bus *bus)
{
    return bus->socket;
}

void rrins_bus_leave(struct rrins_bus *bus)
{
    struct header head = {.kind = BYE};
    if (bus == NULL)
        return;
    head.sender = bus->number;
    memcpy(head.magic, MAGIC, sizeof head.magic);
    (void)send(bus->socket, &head, sizeof head, MSG_DONTWAIT | MSG_NOSIGNAL);
    close(bus->socket);
    while (bus->first != NULL) {
        struct kept *kept = bus->first;
        bus->first = kept->next;
        free(kept);
    }
    free(bus);
}
