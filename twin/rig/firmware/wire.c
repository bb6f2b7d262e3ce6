#include "wire.h"

/* The usual way to do a byte of the polynomial 0x1021 without a table: four shifts in place of eight. */
uint16_t wire_crc(const uint8_t *bytes, uint8_t n) {
    uint16_t crc = 0xffff;
    while (n--) {
        crc = (uint16_t)((crc >> 8) | (crc << 8));
        crc ^= *bytes++;
        crc ^= (uint16_t)((crc & 0xff) >> 4);
        crc ^= (uint16_t)(crc << 12);
        crc ^= (uint16_t)((crc & 0xff) << 5);
    }
    return crc;
}

uint8_t wire_frame(uint8_t *frame, uint8_t type, uint8_t sequence, const uint8_t *payload, uint8_t n) {
    uint8_t body[WIRE_LARGEST_BODY];
    body[0] = type;
    body[1] = sequence;
    for (uint8_t i = 0; i < n; i++) body[2 + i] = payload[i];
    uint8_t length = (uint8_t)(n + 2);
    wire_put16(body + length, wire_crc(body, length));
    length = (uint8_t)(length + 2);
    uint8_t mark = 0, end = 1; /* where the distance to the next zero goes: a body is shorter than 254 bytes */
    for (uint8_t i = 0; i < length; i++) {
        if (body[i] == 0) {
            frame[mark] = (uint8_t)(end - mark);
            mark = end++;
        } else {
            frame[end++] = body[i];
        }
    }
    frame[mark] = (uint8_t)(end - mark);
    frame[end++] = 0;
    return end;
}

static bool is_command(uint8_t type, uint8_t payload) {
    switch (type) {
    case WIRE_HELLO: return payload == 1;
    case WIRE_SETUP: return payload == 16;
    case WIRE_LEVELS: return payload >= 3;
    case WIRE_ARM: return payload == 6;
    case WIRE_START:
    case WIRE_STOP:
    case WIRE_ALIVE: return payload == 0;
    default: return false;
    }
}

uint8_t wire_body(uint8_t *frame, uint8_t n) {
    uint8_t next = 0, end = 0;
    while (next < n) {
        uint8_t code = frame[next++];
        if (code == 0 || code - 1 > n - next) return 0;
        for (uint8_t i = 1; i < code; i++) frame[end++] = frame[next++];
        if (next < n) frame[end++] = 0;
    }
    if (end < 4 || end > WIRE_LARGEST_BODY) return 0;
    end = (uint8_t)(end - 2);
    if (wire_crc(frame, end) != wire_u16(frame + end) || !is_command(frame[0], (uint8_t)(end - 2))) return 0;
    return end;
}
