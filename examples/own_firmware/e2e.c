/* AUTOSAR E2E profile 1, variant 1A: CRC-8 with polynomial 0x1D, start value and final XOR 0. */
#include "firmware.h"

static uint8_t crc_of_byte(uint8_t crc, uint8_t byte)
{
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++)
        crc = (uint8_t)(crc & 0x80 ? (crc << 1) ^ 0x1D : crc << 1);
    return crc;
}

static uint8_t crc_of(const uint8_t *data, uint16_t data_id)
{
    uint8_t crc = crc_of_byte(crc_of_byte(0, (uint8_t)(data_id & 0xFF)), (uint8_t)(data_id >> 8));
    for (int k = 1; k < 8; k++)
        crc = crc_of_byte(crc, data[k]);
    return crc;
}

bool e2e_is_intact(const struct rrins_frame *frame, uint16_t data_id)
{
    return frame->length == 8 && frame->data[0] == crc_of(frame->data, data_id);
}

unsigned e2e_counter(const struct rrins_frame *frame)
{
    return frame->data[1] & 0xFu;
}

void e2e_protect(struct rrins_frame *frame, uint16_t data_id, uint64_t counter)
{
    frame->length = 8;
    frame->data[1] = (uint8_t)((frame->data[1] & 0xF0u) | (counter % E2E_MODULUS));
    frame->data[0] = crc_of(frame->data, data_id);
}
