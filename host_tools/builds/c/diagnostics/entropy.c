#include <stdlib.h>
#include <sys/random.h>

#include "uds.h"

void random_bytes(uint8_t *at, size_t size)
{
    while (size > 0) {
        ssize_t came = getrandom(at, size, 0);
        if (came <= 0)
            abort(); /* without a seed nobody may be let in */
        at += came;
        size -= (size_t)came;
    }
}
