/* What keeps one joint safe: limits of its drive, and faults that its readings show. No registers, no clock: the
   control loop calls it once a millisecond, on the board or on a computer. */
#ifndef SAFETY_H
#define SAFETY_H

#include "wire.h"

#define FULL_READING 4092 /* [counts]: the sum of four conversions of 10 bits */
#define EDGE 41           /* [counts]: 1 % of a full reading; a wiper that hangs loose is pulled there by its resistor */
#define SPEED_MS 8        /* [ms] over which a speed is taken: one count is then 125 counts/s */

struct limits {
    uint16_t low, high; /* [counts] */
    uint16_t strike;    /* [counts/s] */
    uint16_t duty;
    uint16_t slew;      /* [duty/ms] */
    uint16_t stall;     /* [ms] */
    uint16_t motion;    /* [counts] */
    bool reversed, used;
};

struct joint {
    struct limits limits;
    int16_t reading, past[SPEED_MS]; /* [counts] */
    uint8_t next;                    /* the oldest of `past` */
    int16_t duty;                    /* played, after limits and slew */
    int8_t drive;                    /* sign of the duty while the joint is driven, else 0 */
    int16_t ahead;                   /* [counts]: furthest with the drive */
    uint16_t turned;                 /* [ms] since the drive turned */
    int16_t coast;                   /* [counts in SPEED_MS]: speed at which it still went against the drive, or 0 */
    uint8_t rests;                   /* [ms] for which it does not any more */
    int16_t mark;                    /* [counts]: where it last moved by the least motion */
    uint32_t still;                  /* [ms / 4] driven since then */
};

bool limits_valid(const struct limits *limits);

bool reading_valid(int16_t reading);

/* A new reading [counts]; returns false if it is further from the last than the joint can move. */
bool joint_read(struct joint *joint, int16_t reading);

/* Forgets what the joint did in an earlier run. */
void joint_rest(struct joint *joint);

/* The fault that the joint shows under the duty of the last millisecond, or 0. */
uint8_t joint_fault(struct joint *joint);

/* The duty of the next millisecond for the level that is wanted; returns 1 where the low limit cuts it, 2: the high. */
uint8_t joint_drive(struct joint *joint, int16_t level);

#endif
