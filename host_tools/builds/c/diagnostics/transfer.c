/* Upload and download of the calibration file: 0x34 to 0x37. */
#include <string.h>

#include "uds.h"

enum { CRC_SIZE = 4, BLOCK = BLOCK_LENGTH - 2 };

static int range_of(const uint8_t *data, size_t size, uint32_t *address, uint32_t *wanted)
{
    if (size < 4)
        return INCORRECT_MESSAGE_LENGTH;
    if (data[0] != 0) /* neither compressed nor encrypted */
        return REQUEST_OUT_OF_RANGE;
    return address_and_size(data + 1, size - 1, address, wanted);
}

static int begin(struct transfer *transfer, bool is_download, size_t size, struct out *out)
{
    if (transfer->is_active)
        return CONDITIONS_NOT_CORRECT;
    *transfer = (struct transfer){.is_active = true, .is_download = is_download, .size = size};
    put_number(out, 0x20, 1);
    put_number(out, BLOCK_LENGTH, 2);
    return DONE;
}

int request_download(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    uint32_t address, wanted;
    int said = range_of(data, size, &address, &wanted);
    if (said != DONE)
        return said;
    if (address != CALIBRATION_ADDRESS || wanted == 0 || wanted > CALIBRATION_CAPACITY)
        return REQUEST_OUT_OF_RANGE;
    return begin(&server->transfer, true, wanted, out);
}

int request_upload(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    static uint8_t file[CALIBRATION_CAPACITY];
    uint32_t address, wanted;
    size_t length;
    int said = range_of(data, size, &address, &wanted);
    if (said != DONE)
        return said;
    if (address != CALIBRATION_ADDRESS || wanted == 0)
        return REQUEST_OUT_OF_RANGE;
    length = calibration_file(&server->computer.memory, file);
    said = begin(&server->transfer, false, wanted < length ? wanted : length, out);
    if (said == DONE)
        memcpy(server->transfer.data, file, server->transfer.size);
    return said;
}

/* Answer a repeated block, whose response was lost. */
static int again(const struct transfer *transfer, const uint8_t *block, size_t size,
                 struct out *out)
{
    bool is_same = size == transfer->block_size && memcmp(block, transfer->block, size) == 0;
    if (transfer->is_download && !is_same)
        return WRONG_BLOCK_SEQUENCE_COUNTER;
    put(out, &transfer->counter, 1);
    if (!transfer->is_download)
        put(out, transfer->block, transfer->block_size);
    return DONE;
}

int transfer_data(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    struct transfer *transfer = &server->transfer;
    size_t block_size = size - 1, left;
    if (size < 1)
        return INCORRECT_MESSAGE_LENGTH;
    if (!transfer->is_active)
        return REQUEST_SEQUENCE_ERROR;
    if (transfer->is_download ? block_size == 0 || block_size > BLOCK : block_size > 0)
        return INCORRECT_MESSAGE_LENGTH;
    if (data[0] == transfer->counter && transfer->done > 0)
        return again(transfer, data + 1, block_size, out);
    if (transfer->done == transfer->size)
        return REQUEST_SEQUENCE_ERROR;
    if (data[0] != (uint8_t)(transfer->counter + 1))
        return WRONG_BLOCK_SEQUENCE_COUNTER;
    left = transfer->size - transfer->done;
    if (transfer->is_download) {
        if (block_size > left)
            return TRANSFER_DATA_SUSPENDED;
        memcpy(transfer->data + transfer->done, data + 1, block_size);
    } else {
        block_size = left < BLOCK ? left : BLOCK;
    }
    memcpy(transfer->block, transfer->data + transfer->done, block_size);
    transfer->block_size = block_size;
    transfer->done += block_size;
    transfer->counter = data[0];
    put(out, data, 1);
    if (!transfer->is_download)
        put(out, transfer->block, block_size);
    return DONE;
}

static int poll_exit(struct server *server, struct out *out)
{
    if (!write_job_is_done(server->job))
        return LATER;
    if (!parameters_finish(&server->computer.memory, server->job))
        return GENERAL_PROGRAMMING_FAILURE;
    put_number(out, crc32_of(server->transfer.data, server->transfer.size), CRC_SIZE);
    return DONE;
}

int exit_transfer(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    static struct stored read;
    struct transfer *transfer = &server->transfer;
    uint32_t crc;
    if (size != 0 && size != CRC_SIZE)
        return INCORRECT_MESSAGE_LENGTH;
    if (!transfer->is_active || transfer->done != transfer->size)
        return REQUEST_SEQUENCE_ERROR;
    if (transfer->is_download && size != CRC_SIZE)
        return INCORRECT_MESSAGE_LENGTH;
    if (transfer->is_download && store_is_busy(server->computer.memory.store))
        return BUSY_REPEAT_REQUEST; /* what wrote it before is not done */
    transfer->is_active = false;
    crc = crc32_of(transfer->data, transfer->size);
    if (size == CRC_SIZE && number_at(data, CRC_SIZE) != crc)
        return GENERAL_PROGRAMMING_FAILURE;
    if (!transfer->is_download) {
        put_number(out, crc, CRC_SIZE);
        return DONE;
    }
    if (!parameters_read(&read, transfer->data, transfer->size) || !can_be_set_up(&read))
        return GENERAL_PROGRAMMING_FAILURE;
    server->job = parameters_replace(&server->computer.memory, &read);
    server->poll = poll_exit;
    return LATER;
}
