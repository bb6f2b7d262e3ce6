/* Frames on the serial line: the numbers of docs/rig-protocol.md, check sum and encoding. No registers: it also
   compiles on a computer. A test compares the #defines with those of twin/rig/wire.py. */
#ifndef WIRE_H
#define WIRE_H

#include <stdbool.h>
#include <stdint.h>

#define WIRE_VERSION 1
#define WIRE_BAUD 115200UL
#define WIRE_JOINTS 3
#define WIRE_RING 256
#define WIRE_LARGEST_PAYLOAD 56
#define WIRE_LARGEST_DUTY 1023
#define WIRE_SILENCE_MS 40
#define WIRE_STORM 8

#define WIRE_HELLO 0x01
#define WIRE_SETUP 0x02
#define WIRE_LEVELS 0x03
#define WIRE_ARM 0x04
#define WIRE_START 0x05
#define WIRE_STOP 0x06
#define WIRE_ALIVE 0x07
#define WIRE_IDENTITY 0x81
#define WIRE_DONE 0x82
#define WIRE_SAMPLE 0x83
#define WIRE_FAULT 0x84

#define STATE_OFF 0
#define STATE_ARMED 1
#define STATE_RUNNING 2
#define STATE_ENDED 3
#define STATE_FAULT 4

#define FAULT_STOPPED 1
#define FAULT_LINK 2
#define FAULT_STORM 3
#define FAULT_STALL 4
#define FAULT_SENSOR 5
#define FAULT_STRIKE 6
#define FAULT_DIRECTION 7
#define FAULT_SUPPLY 8
#define FAULT_STARVED 9
#define FAULT_OVERRUN 10

#define REFUSED_STATE 1
#define REFUSED_VALUE 2
#define REFUSED_SETUP 3
#define REFUSED_SENSOR 4
#define REFUSED_LEVELS 5
#define REFUSED_ROOM 6
#define REFUSED_GAP 7
#define REFUSED_KEY 8
#define REFUSED_SUPPLY 9

#define WIRE_LARGEST_BODY (WIRE_LARGEST_PAYLOAD + 4)
#define WIRE_LARGEST_FRAME (WIRE_LARGEST_BODY + 2)

/* CRC-16/CCITT-FALSE of n bytes. */
uint16_t wire_crc(const uint8_t *bytes, uint8_t n);

/* Writes type, sequence number, payload (n bytes) and check sum as a frame with its zero; returns its length. */
uint8_t wire_frame(uint8_t *frame, uint8_t type, uint8_t sequence, const uint8_t *payload, uint8_t n);

/* Decodes a frame of n bytes without its zero in place; returns the body's length without the check sum, and 0 if
   encoding, check sum, or the host's type or length is wrong. */
uint8_t wire_body(uint8_t *frame, uint8_t n);

static inline uint16_t wire_u16(const uint8_t *at) {
    return (uint16_t)(at[0] | (uint16_t)(at[1] << 8));
}

static inline uint8_t *wire_put16(uint8_t *at, uint16_t value) {
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
    return at + 2;
}

static inline uint8_t *wire_put32(uint8_t *at, uint32_t value) {
    return wire_put16(wire_put16(at, (uint16_t)value), (uint16_t)(value >> 16));
}

#endif
