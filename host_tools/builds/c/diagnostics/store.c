#define _GNU_SOURCE
#include "store.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "uds.h"

enum { PATH_SIZE = 4096 };
enum { AT_VERSION = 4, AT_SEQUENCE = 8, AT_LENGTH = 16, AT_CRC = 20, AT_HEAD_CRC = 24 };

static const char magic[] = STORE_MAGIC;

struct store {
    char path[PATH_SIZE];
    int file;
    size_t capacity, slot_size;
    uint8_t *slot, *image; /* scratch; what is being written */
    size_t image_size;
    struct write_job job;
    pthread_t thread;
    bool has_thread;
};

static size_t read_at(const struct store *store, uint8_t *at, size_t size, size_t start)
{
    size_t done = 0;
    while (done < size) {
        ssize_t came = pread(store->file, at + done, size - done, (off_t)(start + done));
        if (came < 0 && errno == EINTR)
            continue;
        if (came <= 0)
            break;
        done += (size_t)came;
    }
    return done;
}

/* Whether it was never written: what cannot be read is damaged. */
static bool is_blank(const struct store *store)
{
    struct stat status;
    return fstat(store->file, &status) == 0 && status.st_size == 0;
}

/* Replace bytes; true once they are safely stored. */
static bool write_at(int file, const uint8_t *at, size_t size, size_t start)
{
    size_t done = 0;
    while (done < size) {
        ssize_t went = pwrite(file, at + done, size - done, (off_t)(start + done));
        if (went < 0 && errno == EINTR)
            continue;
        if (went <= 0)
            return false;
        done += (size_t)went;
    }
    return fsync(file) == 0;
}

static uint32_t crc_at(const uint8_t *at)
{
    return (uint32_t)number_at(at, 4);
}

/* Read a copy into the scratch; whether it is sound. */
static bool read_copy(struct store *store, int slot, size_t *size, uint64_t *sequence)
{
    uint8_t *at = store->slot;
    size_t came = read_at(store, at, STORE_HEAD + store->capacity, (size_t)slot * store->slot_size);
    if (came < STORE_HEAD || memcmp(at, magic, sizeof magic) != 0 ||
        number_at(at + AT_VERSION, 2) != STORE_VERSION ||
        crc_at(at + AT_HEAD_CRC) != crc32_of(at, AT_HEAD_CRC))
        return false;
    *size = (size_t)number_at(at + AT_LENGTH, 4);
    *sequence = number_at(at + AT_SEQUENCE, 8);
    return *size <= came - STORE_HEAD && crc_at(at + AT_CRC) == crc32_of(at + STORE_HEAD, *size);
}

enum condition store_read(struct store *store, uint8_t *image, size_t *size, uint64_t *sequence)
{
    int sound = 0;
    *size = 0, *sequence = 0;
    if (is_blank(store))
        return MEMORY_BLANK;
    for (int slot = 0; slot < 2; slot++) {
        size_t own_size;
        uint64_t own_sequence;
        if (!read_copy(store, slot, &own_size, &own_sequence))
            continue;
        if (sound++ == 0 || own_sequence > *sequence) {
            *size = own_size, *sequence = own_sequence;
            memcpy(image, store->slot + STORE_HEAD, own_size);
        }
    }
    return sound == 2 ? MEMORY_WHOLE : sound == 1 ? MEMORY_ONE_DAMAGED : MEMORY_LOST;
}

/* Fill the scratch with a copy. */
static void fill_slot(struct store *store, uint64_t sequence)
{
    struct out head = {.size = 0};
    memset(store->slot, 0, store->slot_size);
    put(&head, magic, sizeof magic);
    put_number(&head, STORE_VERSION, 2);
    put_number(&head, 0, 2);
    put_number(&head, sequence, 8);
    put_number(&head, store->image_size, 4);
    put_number(&head, crc32_of(store->image, store->image_size), 4);
    put_number(&head, crc32_of(head.at, AT_HEAD_CRC), 4);
    memcpy(store->slot, head.at, STORE_HEAD);
    memcpy(store->slot + STORE_HEAD, store->image, store->image_size);
}

/* The hidden file beside a path that replaces it. */
static void aside_of(const char *path, char aside[PATH_SIZE + 32])
{
    const char *slash = strrchr(path, '/');
    int folder = slash == NULL ? 0 : (int)(slash - path) + 1;
    snprintf(aside, PATH_SIZE + 32, "%.*s.%s.%ld", folder, path, path + folder, (long)getpid());
}

static void folder_of(const char *path, char folder[PATH_SIZE])
{
    const char *slash = strrchr(path, '/');
    snprintf(folder, PATH_SIZE, "%.*s", slash == NULL ? 1 : (int)(slash - path) + 1,
             slash == NULL ? "." : path);
}

/* Store the first two copies: both or nothing. */
static bool create(struct store *store)
{
    char aside[PATH_SIZE + 32], folder[PATH_SIZE];
    int file, directory;
    bool is_well;
    aside_of(store->path, aside);
    unlink(aside); /* of a process of this number that was killed */
    file = open(aside, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file < 0)
        return false;
    is_well = flock(file, LOCK_EX | LOCK_NB) == 0; /* before anyone can open it */
    for (size_t slot = 0; slot < 2 && is_well; slot++) {
        fill_slot(store, 1 + (uint64_t)slot);
        is_well = write_at(file, store->slot, store->slot_size, slot * store->slot_size);
    }
    if (!is_well || rename(aside, store->path) != 0) {
        close(file);
        unlink(aside);
        return false;
    }
    folder_of(store->path, folder);
    directory = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    is_well = directory >= 0 && fsync(directory) == 0;
    if (directory >= 0)
        close(directory);
    close(store->file);
    store->file = file;
    return is_well;
}

/* Store the image; whether it is valid and safely stored. */
static bool write_image(struct store *store)
{
    uint64_t sequences[2] = {0, 0}, next;
    bool sound[2];
    size_t size;
    int slot;
    if (is_blank(store))
        return create(store);
    for (int k = 0; k < 2; k++)
        sound[k] = read_copy(store, k, &size, &sequences[k]);
    for (int k = 0; k < 2; k++)
        sequences[k] = sound[k] ? sequences[k] : 0;
    next = (sequences[0] > sequences[1] ? sequences[0] : sequences[1]) + 1;
    slot = !sound[0] ? 0 : !sound[1] ? 1 : sequences[1] < sequences[0]; /* damaged or older */
    fill_slot(store, next);
    if (!write_at(store->file, store->slot, STORE_HEAD + store->image_size,
                  (size_t)slot * store->slot_size))
        return false;
    return read_copy(store, slot, &size, &sequences[0]) && sequences[0] == next &&
           size == store->image_size && memcmp(store->slot + STORE_HEAD, store->image, size) == 0;
}

static void work(struct store *store)
{
    store->job.has_failed = !write_image(store);
    atomic_store(&store->job.is_done, true);
}

static void *work_beside(void *given)
{
    const struct sched_param usual = {.sched_priority = 0};
    /* Not at the priority of the loop, which began it; by the kernel's call, as in main.c. */
    (void)syscall(SYS_sched_setscheduler, 0, SCHED_OTHER, &usual);
    work(given);
    return NULL;
}

void store_wait(struct store *store)
{
    if (store != NULL && store->has_thread) {
        pthread_join(store->thread, NULL);
        store->has_thread = false;
    }
}

struct write_job *store_write(struct store *store, const uint8_t *image, size_t size, bool waits)
{
    store_wait(store);
    atomic_store(&store->job.is_done, false);
    memcpy(store->image, image, size);
    store->image_size = size;
    if (!waits && pthread_create(&store->thread, NULL, work_beside, store) == 0)
        store->has_thread = true;
    else
        work(store);
    return &store->job;
}

bool store_is_busy(const struct store *store)
{
    return store != NULL && store->has_thread && !atomic_load(&store->job.is_done);
}

bool write_job_is_done(const struct write_job *job)
{
    return atomic_load(&job->is_done);
}

struct write_job *no_write_job(void)
{
    static struct write_job job = {true, false};
    return &job;
}

/* Whether a file that is not empty is a memory of this kind. */
static bool is_ours(const struct store *store)
{
    uint8_t head[2][sizeof magic];
    struct stat status;
    if (fstat(store->file, &status) != 0 || status.st_size == 0 ||
        (size_t)status.st_size == 2 * store->slot_size)
        return true;
    memset(head, 0, sizeof head);
    read_at(store, head[0], sizeof magic, 0);
    read_at(store, head[1], sizeof magic, store->slot_size);
    return memcmp(head[0], magic, sizeof magic) == 0 || memcmp(head[1], magic, sizeof magic) == 0;
}

static bool open_file(struct store *store, char *reason, size_t size)
{
    struct stat opened, named;
    if (stat(store->path, &named) == 0 && !S_ISREG(named.st_mode)) {
        snprintf(reason, size, "is not a file"); /* a device would be read and replaced */
        return false;
    }
    store->file = open(store->path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (store->file < 0) {
        snprintf(reason, size, "cannot be opened: %s", strerror(errno));
        return false;
    }
    if (flock(store->file, LOCK_EX | LOCK_NB) != 0 || fstat(store->file, &opened) != 0 ||
        stat(store->path, &named) != 0 || opened.st_ino != named.st_ino ||
        opened.st_dev != named.st_dev) {
        snprintf(reason, size, "in use by another firmware process");
        return false;
    }
    if (!is_ours(store)) {
        snprintf(reason, size, "not a memory of this kind; left unchanged");
        return false;
    }
    return true;
}

struct store *store_open(const char *path, size_t capacity, char *reason, size_t size)
{
    struct store *store = calloc(1, sizeof *store);
    if (store == NULL)
        return NULL;
    store->capacity = capacity;
    store->slot_size = (STORE_HEAD + capacity + STORE_PAGE - 1) / STORE_PAGE * STORE_PAGE;
    store->slot = malloc(store->slot_size);
    store->image = malloc(capacity);
    store->file = -1;
    if (strlen(path) < PATH_SIZE && store->slot != NULL && store->image != NULL) {
        strcpy(store->path, path);
        if (open_file(store, reason, size))
            return store;
    } else {
        snprintf(reason, size, "no memory left, or too long a path");
    }
    if (store->file >= 0)
        close(store->file);
    free(store->slot);
    free(store->image);
    free(store);
    return NULL;
}
