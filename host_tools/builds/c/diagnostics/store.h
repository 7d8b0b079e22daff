/*
 * Memory that survives power loss at any moment: two copies in a file, written alternately, as
 * `rrins.firmware_py.diagnostics.store` writes them.
 */
#ifndef STORE_H
#define STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum condition { MEMORY_BLANK, MEMORY_WHOLE, MEMORY_ONE_DAMAGED, MEMORY_LOST };

struct store;

/* An image being written. */
struct write_job {
    _Atomic bool is_done;
    bool has_failed; /* once done */
};

/* Open a file, made if it is not there; NULL with a reason if it cannot be used. */
struct store *store_open(const char *path, size_t capacity, char *reason, size_t size);

/* Read the valid copy into `image`; the condition. */
enum condition store_read(struct store *store, uint8_t *image, size_t *size, uint64_t *sequence);

/* Start storing an image, with a thread of its own if the loop is not to wait. */
struct write_job *store_write(struct store *store, const uint8_t *image, size_t size, bool waits);
bool write_job_is_done(const struct write_job *job);

/* Whether an image is still being written beside the loop. */
bool store_is_busy(const struct store *store);

/* Wait until everything is stored. */
void store_wait(struct store *store);

/* Of a computer without a store: done, and well. */
struct write_job *no_write_job(void);

#endif
