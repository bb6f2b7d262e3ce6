/* The rig's state: what frames do, and what one millisecond of the control loop does. No registers. */
#ifndef PLAYER_H
#define PLAYER_H

#include "safety.h"

struct inputs {
    int16_t readings[WIRE_JOINTS]; /* [counts] */
    int16_t supply;                /* [counts] */
    bool key;                      /* the stop key is pressed */
    uint8_t dropped;               /* frames that were dropped, modulo 256 */
    uint8_t bad;                   /* bad frames since the last good one */
    bool overrun;                  /* the last millisecond's work did not end within it */
    const uint8_t *body;           /* a good frame: type, sequence number, payload; or NULL */
    uint8_t length;                /* bytes of the body */
};

struct outputs {
    bool on[WIRE_JOINTS];      /* enable pins */
    int16_t duty[WIRE_JOINTS]; /* of the motor: the sign of a reversed one is changed */
};

/* One millisecond; the readings are those of the millisecond before it. */
void player_step(const struct inputs *in, struct outputs *out);

/* Sends a frame to the host, or drops all of it where there is no room; what compiles player.c supplies it. */
void link_send(uint8_t type, const uint8_t *payload, uint8_t n);

#endif
