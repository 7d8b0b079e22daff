/* Trouble codes: 0x14, 0x19, operation cycles and what is stored of them (ISO 14229-1, annex D). */
#include <string.h>

#include "uds.h"

enum { FIRST_SNAPSHOT = 1, LATEST_SNAPSHOT = 2, ALL_RECORDS = 0xFF, EXTENDED_RECORD = 1 };
enum { NUMBER_SIZE = 3, HEAD_SIZE = 8 };

_Static_assert(sizeof(struct rrins_firmware_trouble_memory) + HEAD_SIZE == FAULT_CAPACITY,
               "the trouble codes of every variant are whole");

int trouble_of(uint64_t number)
{
    for (int k = 0; k < TROUBLES; k++)
        if (troubles[k].number == number && troubles[k].supported)
            return k;
    return -1;
}

int detection_counter(const struct computer *computer, int index)
{
    int64_t counter = computer->ram->diagnostics.counter[index];
    return (int)(counter < 0 ? -((-counter + COUNTER_ONE - 1) / COUNTER_ONE)
                             : counter / COUNTER_ONE);
}

static void forget(struct rrins_firmware_ram *ram, int index)
{
    int row = troubles[index].parity_row;
    ram->diagnostics.troubles.occurrences[index] = 0;
    ram->diagnostics.troubles.aging[index] = 0;
    memset(ram->diagnostics.troubles.snapshots[index], 0,
           sizeof ram->diagnostics.troubles.snapshots[index]);
    if (row >= 0)
        memset(ram->diagnostics.troubles.parities[row], 0,
               sizeof ram->diagnostics.troubles.parities[row]);
}

void faults_clear(struct computer *computer, int only)
{
    struct rrins_firmware_ram *ram = computer->ram;
    for (int k = 0; k < TROUBLES; k++) {
        if (!troubles[k].supported || (only >= 0 && only != k))
            continue;
        forget(ram, k);
        ram->diagnostics.troubles.status[k] = CLEARED_STATUS;
        ram->diagnostics.counter[k] = 0;
        ram->diagnostics.unsettled[troubles[k].kind] |= INT64_C(1) << troubles[k].bit;
    }
    computer->are_faults_new = true;
}

void faults_begin_test(struct computer *computer)
{
    uint8_t *status = computer->ram->diagnostics.troubles.status;
    for (int k = 0; k < TROUBLES; k++)
        status[k] &= (uint8_t)~STATUS_TEST_FAILED;
}

void faults_begin_cycle(struct computer *computer)
{
    struct rrins_firmware_ram *ram = computer->ram;
    uint8_t *status = ram->diagnostics.troubles.status;
    computer->operation_cycles++;
    for (int k = 0; k < TROUBLES; k++) {
        if ((status[k] & (STATUS_TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE |
                          STATUS_TEST_FAILED_THIS_OPERATION_CYCLE)) == 0) {
            status[k] &= (uint8_t)~STATUS_PENDING;
            if ((status[k] & STATUS_CONFIRMED) != 0 &&
                ++ram->diagnostics.troubles.aging[k] >= AGING_CYCLES) {
                forget(ram, k);
                status[k] &= (uint8_t)~STATUS_CONFIRMED;
            }
        }
        status[k] &= (uint8_t)~STATUS_TEST_FAILED_THIS_OPERATION_CYCLE;
        status[k] |= STATUS_TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE;
    }
    faults_begin_test(computer);
}

void faults_image(const struct computer *computer, uint8_t image[FAULT_CAPACITY])
{
    const uint8_t *own = (const uint8_t *)&computer->ram->diagnostics.troubles;
    struct out head = {.size = 0};
    put_number(&head, FAULT_LAYOUT, 4);
    put_number(&head, computer->operation_cycles, 4);
    memcpy(image, head.at, HEAD_SIZE);
    memcpy(image + HEAD_SIZE, own, FAULT_CAPACITY - HEAD_SIZE);
}

void faults_recall(struct computer *computer, const uint8_t *image, size_t size)
{
    uint8_t *own = (uint8_t *)&computer->ram->diagnostics.troubles;
    if (size != FAULT_CAPACITY || number_at(image, 4) != FAULT_LAYOUT)
        return; /* of another version */
    computer->operation_cycles = (uint32_t)number_at(image + 4, 4);
    memcpy(own, image + HEAD_SIZE, FAULT_CAPACITY - HEAD_SIZE);
}

int clear_troubles(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    uint64_t number = number_at(data, NUMBER_SIZE);
    int index = -1;
    (void)out;
    if (size != NUMBER_SIZE)
        return INCORRECT_MESSAGE_LENGTH;
    if (number != ALL_GROUPS && (index = trouble_of(number)) < 0)
        return REQUEST_OUT_OF_RANGE;
    faults_clear(&server->computer, index);
    return DONE;
}

static void put_trouble(struct out *out, int index, uint8_t byte)
{
    put_number(out, troubles[index].number, NUMBER_SIZE);
    put_number(out, byte, 1);
}

/* 0x01, 0x02, 0x03, 0x0A and 0x14: lists. */
static void list_troubles(const struct computer *computer, int report, uint8_t mask,
                          struct out *out)
{
    const struct rrins_firmware_ram *ram = computer->ram;
    uint64_t count = 0;
    if (report == 0x01 || report == 0x02 || report == 0x0A)
        put_number(out, STATUS_AVAILABILITY, 1);
    for (int k = 0; k < TROUBLES; k++) {
        uint8_t status = ram->diagnostics.troubles.status[k];
        bool is_masked = (status & mask & STATUS_AVAILABILITY) != 0;
        int counter = detection_counter(computer, k);
        if (!troubles[k].supported)
            continue;
        count += is_masked;
        if ((report == 0x02 && is_masked) || report == 0x0A)
            put_trouble(out, k, status);
        else if (report == 0x14 && counter > 0 && counter < COUNTER_FAILED)
            put_trouble(out, k, (uint8_t)counter);
        else if (report == 0x03 && ram->diagnostics.troubles.occurrences[k] != 0) {
            put_trouble(out, k, FIRST_SNAPSHOT);
            put_trouble(out, k, LATEST_SNAPSHOT);
        }
    }
    if (report == 0x01) {
        put_number(out, FORMAT_IDENTIFIER, 1);
        put_number(out, count, 2);
    }
}

static void put_snapshot(const struct computer *computer, int index, int record, struct out *out)
{
    int row = troubles[index].parity_row;
    put_number(out, (uint64_t)record, 1);
    put_number(out, SNAPSHOT_IDENTIFIERS + (row >= 0), 1);
    for (size_t k = 0; k < SNAPSHOT_IDENTIFIERS; k++) {
        put_number(out, snapshot_identifiers[k]->number, 2);
        put_layout(out, &snapshot_layouts[k],
                   &computer->ram->diagnostics.troubles.snapshots[index][record - 1], NULL);
    }
    if (row >= 0) {
        int kind = troubles[index].parity_kind;
        put_number(out, parity_identifiers[kind]->number, 2);
        put_layout(out, &parity_layouts[kind],
                   &computer->ram->diagnostics.troubles.parities[row][record - 1], NULL);
    }
}

static void put_extended(const struct computer *computer, int index, struct out *out)
{
    int64_t occurrences = computer->ram->diagnostics.troubles.occurrences[index];
    int64_t aging = computer->ram->diagnostics.troubles.aging[index];
    put_number(out, EXTENDED_RECORD, 1);
    put_number(out, (uint64_t)(occurrences < 0xFFFF ? occurrences : 0xFFFF), 2);
    put_number(out, (uint64_t)(aging < 0xFF ? aging : 0xFF), 1);
    put_number(out, (uint8_t)detection_counter(computer, index), 1);
}

/* 0x04 and 0x06: of one trouble code. */
static int read_one(const struct computer *computer, int report, const uint8_t *data,
                    struct out *out)
{
    int index = trouble_of(number_at(data, NUMBER_SIZE)), wanted = data[NUMBER_SIZE];
    int last = report == 0x04 ? LATEST_SNAPSHOT : EXTENDED_RECORD;
    if (index < 0 || (wanted != ALL_RECORDS && (wanted < 1 || wanted > last)))
        return REQUEST_OUT_OF_RANGE;
    put_trouble(out, index, computer->ram->diagnostics.troubles.status[index]);
    if (report == 0x06) {
        put_extended(computer, index, out);
        return DONE;
    }
    for (int record = FIRST_SNAPSHOT; record <= LATEST_SNAPSHOT; record++)
        if ((wanted == record || wanted == ALL_RECORDS) &&
            computer->ram->diagnostics.troubles.occurrences[index] != 0)
            put_snapshot(computer, index, record, out);
    return DONE;
}

int read_troubles(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    int report = data[0];
    bool is_of_one = report == 0x04 || report == 0x06;
    size_t length = is_of_one ? 4 : report == 0x01 || report == 0x02;
    if (size != 1 + length)
        return INCORRECT_MESSAGE_LENGTH;
    put(out, data, 1);
    if (is_of_one)
        return read_one(&server->computer, report, data + 1, out);
    list_troubles(&server->computer, report, length > 0 ? data[1] : 0, out);
    return DONE;
}
