#include "bench.h"

#include <string.h>

uint16_t crc16(const uint8_t *data, size_t length) {
    static uint16_t table[256];
    if (!table[1]) {
        for (unsigned byte = 0; byte < 256; byte++) {
            uint16_t value = (uint16_t)byte;
            for (int bit = 0; bit < 8; bit++) value = (uint16_t)(value & 1 ? value >> 1 ^ 0xA001 : value >> 1);
            table[byte] = value;
        }
    }
    uint16_t crc = 0xFFFF;
    while (length--) crc = (uint16_t)(crc >> 8 ^ table[(crc ^ *data++) & 0xFF]);
    return crc;
}

size_t encode_frame(enum framing framing, uint16_t transaction, uint8_t unit, const uint8_t *pdu, size_t length,
                    uint8_t *adu) {
    if (framing == MBAP) {
        put16(adu, transaction);
        put16(adu + 2, 0);
        put16(adu + 4, (unsigned)length + 1);
        adu[6] = unit;
        memcpy(adu + MBAP_HEADER, pdu, length);
        return MBAP_HEADER + length;
    }
    adu[0] = unit;
    memcpy(adu + 1, pdu, length);
    uint16_t crc = crc16(adu, length + 1);
    adu[length + 1] = (uint8_t)crc; /* the low byte goes first: Modbus over serial line V1.02, 2.5.1.2 */
    adu[length + 2] = (uint8_t)(crc >> 8);
    return length + 3;
}

/* Length of the PDU that begins with these bytes; 0: more bytes are needed; -1: not a function code of ours. */
static int pdu_length(enum frame_kind kind, const uint8_t *pdu, size_t length) {
    if (length < 1) return 0;
    if (pdu[0] & 0x80) return kind == REPLY ? 2 : -1;
    switch (pdu[0]) {
    case 3:
        if (kind == REQUEST) return 5;
        return length < 2 ? 0 : 2 + pdu[1];
    case 6:
        return 5;
    case 16:
        if (kind == REPLY) return 5;
        return length < 6 ? 0 : 6 + pdu[5];
    default:
        return -1;
    }
}

static enum frame_state decode_mbap(const uint8_t *data, size_t length, struct frame *frame) {
    if (length < MBAP_HEADER + 1) return FRAME_PARTIAL;
    size_t rest = get16(data + 4);
    if (get16(data + 2) || rest < 2 || rest > MAX_PDU + 1) return FRAME_BAD;
    if (length < 6 + rest) return FRAME_PARTIAL;
    *frame = (struct frame){6 + rest, get16(data), data[6], data + MBAP_HEADER, rest - 1};
    return FRAME_WHOLE;
}

enum frame_state decode_frame(enum framing framing, enum frame_kind kind, const uint8_t *data, size_t length,
                              struct frame *frame) {
    if (framing == MBAP) return decode_mbap(data, length, frame);
    if (length < 2) return FRAME_PARTIAL;
    int pdu = pdu_length(kind, data + 1, length - 1);
    if (pdu < 0 || pdu > MAX_PDU) return FRAME_BAD;
    if (!pdu || length < (size_t)pdu + 3) return FRAME_PARTIAL;
    size_t body = (size_t)pdu + 1;
    if (crc16(data, body) != (data[body] | data[body + 1] << 8)) return FRAME_BAD;
    *frame = (struct frame){body + 2, 0, data[0], data + 1, (size_t)pdu};
    return FRAME_WHOLE;
}
