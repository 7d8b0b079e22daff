/* CRC-32 (ISO-HDLC), SHA-256 (FIPS 180-4) and its HMAC (RFC 2104). */
#include <string.h>

#include "digest.h"
#include "uds.h"

uint32_t crc32_of(const uint8_t *at, size_t size)
{
    static const uint32_t nibbles[16] = {
        0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
        0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
        0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C,
    };
    uint32_t crc = 0xFFFFFFFF;
    for (size_t k = 0; k < size; k++) {
        crc = crc >> 4 ^ nibbles[(crc ^ at[k]) & 15];
        crc = crc >> 4 ^ nibbles[(crc ^ at[k] >> 4) & 15];
    }
    return ~crc;
}

enum { HMAC_MESSAGE = 1 + SEED_SIZE };

static const uint32_t constants[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2,
};

static uint32_t turned(uint32_t word, int bits)
{
    return word >> bits | word << (32 - bits);
}

static void add_block(uint32_t state[8], const uint8_t *at)
{
    uint32_t w[64], s[8];
    for (int k = 0; k < 16; k++)
        w[k] = (uint32_t)number_at(at + 4 * k, 4);
    for (int k = 16; k < 64; k++) {
        uint32_t low = turned(w[k - 15], 7) ^ turned(w[k - 15], 18) ^ w[k - 15] >> 3;
        uint32_t high = turned(w[k - 2], 17) ^ turned(w[k - 2], 19) ^ w[k - 2] >> 10;
        w[k] = w[k - 16] + low + w[k - 7] + high;
    }
    memcpy(s, state, sizeof s);
    for (unsigned k = 0; k < 64; k++) { /* a to h are s[-k] to s[7 - k], of eight in a ring */
        uint32_t a = s[-k & 7], b = s[(1 - k) & 7], c = s[(2 - k) & 7];
        uint32_t e = s[(4 - k) & 7], f = s[(5 - k) & 7], g = s[(6 - k) & 7];
        uint32_t high = turned(e, 6) ^ turned(e, 11) ^ turned(e, 25);
        uint32_t low = turned(a, 2) ^ turned(a, 13) ^ turned(a, 22);
        uint32_t first = s[(7 - k) & 7] + high + ((e & f) ^ (~e & g)) + constants[k] + w[k];
        s[(3 - k) & 7] += first;
        s[(7 - k) & 7] = first + low + ((a & b) ^ (a & c) ^ (b & c));
    }
    for (int k = 0; k < 8; k++)
        state[k] += s[k];
}

void sha256_begin(struct sha256 *sum)
{
    *sum = (struct sha256){{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                            0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19}, 0, {0}};
}

void sha256_add(struct sha256 *sum, const void *data, size_t size)
{
    const uint8_t *from = data;
    while (size > 0) {
        size_t at = sum->size % SHA256_BLOCK, room = SHA256_BLOCK - at;
        size_t part = size < room ? size : room;
        memcpy(sum->block + at, from, part);
        sum->size += part;
        from += part;
        size -= part;
        if (part == room)
            add_block(sum->state, sum->block);
    }
}

void sha256_end(struct sha256 *sum, uint8_t digest[SHA256_SIZE])
{
    uint64_t bits = 8 * sum->size;
    uint8_t last[8];
    for (int k = 0; k < 8; k++)
        last[k] = (uint8_t)(bits >> 8 * (7 - k));
    sha256_add(sum, "\x80", 1);
    while (sum->size % SHA256_BLOCK != SHA256_BLOCK - sizeof last)
        sha256_add(sum, "", 1);
    sha256_add(sum, last, sizeof last);
    for (int k = 0; k < SHA256_SIZE; k++)
        digest[k] = (uint8_t)(sum->state[k / 4] >> 8 * (3 - k % 4));
}

/* SHA-256 of a block and a message behind it. */
static void sha256(const uint8_t first[SHA256_BLOCK], const uint8_t *message, size_t size,
                   uint8_t digest[SHA256_SIZE])
{
    struct sha256 sum;
    sha256_begin(&sum);
    sha256_add(&sum, first, SHA256_BLOCK);
    sha256_add(&sum, message, size);
    sha256_end(&sum, digest);
}

void key_of(const uint8_t seed[SEED_SIZE], uint8_t key[KEY_SIZE])
{
    static const uint8_t secret[] = SECRET;
    uint8_t inner[SHA256_BLOCK], outer[SHA256_BLOCK], message[HMAC_MESSAGE];
    uint8_t digest[SHA256_SIZE], whole[SHA256_SIZE];
    for (size_t k = 0; k < SHA256_BLOCK; k++) {
        uint8_t byte = k < sizeof secret ? secret[k] : 0;
        inner[k] = byte ^ 0x36;
        outer[k] = byte ^ 0x5C;
    }
    message[0] = 0x01;
    memcpy(message + 1, seed, SEED_SIZE);
    sha256(inner, message, sizeof message, digest);
    sha256(outer, digest, sizeof digest, whole);
    memcpy(key, whole, KEY_SIZE);
}
