/* What keeps one joint safe: limits of its drive, and faults that its readings show. No registers, no clock: the
   control loop calls it once a millisecond, on the board or on a computer. */
#ifndef SAFETY_H
#define SAFETY_H

#include "wire.h"

#define FULL_READING 4092 /* [counts]: the sum of four conversions of 10 bits */
#define EDGE 41           /* [counts]: 1 % of a full reading; a wiper that hangs loose is pulled there by its resistor */
#define SPEED_MS 8        /* [ms] over which the speed of a strike is taken: one count is then 125 counts/s */
#define PARTS 4           /* of the stall time, after each of which it is asked whether the joint moved */
#define COAST_MS 125      /* [ms]: no joint of a leg keeps its speed for longer, */
#define DELAY_MS 50       /* [ms]: and none heeds its drive later */

struct limits {
    uint16_t low, high; /* [counts] */
    uint16_t strike;    /* [counts/s] */
    uint16_t duty;
    uint16_t slew;      /* [duty/ms] */
    uint16_t stall;     /* [ms] */
    uint16_t motion;    /* [counts] */
    bool reversed, used;
    /* What follows from them, since a division is slow here: */
    uint16_t jump;    /* [counts]: further than the joint can move in 1 ms */
    uint16_t quarter; /* [ms]: of the stall time, at most COAST_MS: the longest time constant with which a joint coasts */
    uint16_t delay;   /* [ms]: a sixtieth of the stall time, at most DELAY_MS, in which a joint does not heed a turn yet */
    uint16_t decay;   /* [1/65536]: share of its speed that such a joint loses in 1 ms */
};

struct joint {
    struct limits limits;
    int16_t reading, past[SPEED_MS]; /* [counts] */
    uint8_t next;                    /* place of the oldest of `past`, one for each millisecond */
    int32_t smooth, slow;            /* [counts / 256]: the reading after lags of 4 and 16 ms, which take out its noise */
    int16_t duty;                    /* played, after limits and slew */
    int8_t drive;                    /* sign of the duty while the joint is driven, else 0 */
    uint16_t turned;                 /* [ms] since the drive turned */
    int32_t ahead;                   /* [counts / 256]: furthest with the drive, less what it may coast against it */
    uint16_t pace;                   /* [counts / 256 / ms] at which it may still coast */
    struct {
        int32_t lowest, highest;     /* [counts / 256]: where it was */
    } parts[PARTS];                  /* of the stall time, the last ones; time that is not driven does not count */
    uint8_t part, whole;             /* the present part, and how many before it are complete */
    uint32_t spent;                  /* [ms / PARTS] driven in the present part */
};

/* Completes limits that the host has sent; returns false if they are none. */
bool limits_complete(struct limits *limits);

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
