#include <errno.h>
#include <sys/random.h>

#include "uds.h"

bool random_bytes(uint8_t *at, size_t size)
{
    while (size > 0) {
        ssize_t came = getrandom(at, size, GRND_NONBLOCK); /* the loop cannot wait for it */
        if (came < 0 && errno == EINTR)
            continue;
        if (came <= 0)
            return false;
        at += came;
        size -= (size_t)came;
    }
    return true;
}
