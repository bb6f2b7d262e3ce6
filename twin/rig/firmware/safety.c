#include "safety.h"

#define NOISE 4 /* [counts] by which two readings of a joint at rest differ, as a rule */
#define REST_MS 3

bool limits_valid(const struct limits *l) {
    return l->low < l->high && l->high < FULL_READING && l->strike && l->duty && l->duty <= WIRE_LARGEST_DUTY &&
           l->slew && l->stall && l->motion && l->motion < FULL_READING;
}

bool reading_valid(int16_t reading) {
    return reading >= EDGE && reading <= FULL_READING - EDGE;
}

static uint16_t size(int16_t value) {
    return (uint16_t)(value < 0 ? -value : value);
}

bool joint_read(struct joint *j, int16_t reading) {
    /* Four times the limit of speed in 1 ms, and 1/64 of the range for noise. */
    bool near = size((int16_t)(reading - j->reading)) <= j->limits.strike / 250 + FULL_READING / 64;
    j->past[j->next] = j->reading;
    j->next = (uint8_t)((j->next + 1) % SPEED_MS);
    j->reading = reading;
    return near;
}

/* [counts] in SPEED_MS, positive upward. */
static int16_t travel(const struct joint *j) {
    return (int16_t)(j->reading - j->past[j->next]);
}

void joint_rest(struct joint *j) {
    j->duty = 0;
    j->drive = 0;
    j->mark = j->reading;
    j->still = 0;
}

/* A small duty may leave a joint at rest by friction, or let its load move it: a quarter of the limit drives. */
static int8_t drive_of(const struct joint *j) {
    if (size(j->duty) * 4UL < j->limits.duty) return 0;
    return j->duty < 0 ? -1 : 1;
}

static bool at_limit(const struct joint *j) {
    int16_t motion = (int16_t)j->limits.motion;
    return j->drive > 0 ? j->reading + motion >= (int16_t)j->limits.high : j->reading - motion <= (int16_t)j->limits.low;
}

/* Inertia may carry a joint on for some time after its drive has turned. */
static uint16_t quarter(const struct joint *j) {
    return (uint16_t)(j->limits.stall / 4 + 1);
}

static void turn(struct joint *j, int8_t drive) {
    int16_t against = (int16_t)(-travel(j) * drive);
    j->drive = drive;
    j->coast = against > 0 ? against : 0;
    j->turned = 0;
    j->rests = 0;
    j->ahead = j->reading;
}

static bool goes_against(struct joint *j) {
    if (j->coast) {
        int16_t against = (int16_t)(-travel(j) * j->drive);
        j->ahead = j->reading;
        j->rests = against > 0 ? 0 : (uint8_t)(j->rests + 1);
        if (j->rests >= REST_MS) j->coast = 0;
        if (against > j->coast + 2 * NOISE) return true; /* faster than before */
        if (j->turned && j->turned % quarter(j) == 0) {
            if (2 * against > j->coast + 2 * NOISE) return true; /* its speed has not halved */
            if (j->coast) j->coast = against > 0 ? against : 1;
        }
    }
    if ((j->reading - j->ahead) * j->drive > 0) j->ahead = j->reading;
    return (j->ahead - j->reading) * j->drive >= (int16_t)j->limits.motion;
}

static bool is_stuck(struct joint *j) {
    if (size((int16_t)(j->reading - j->mark)) >= j->limits.motion) {
        j->mark = j->reading;
        j->still = 0;
    } else if (j->drive && !at_limit(j)) {
        j->still += j->turned < quarter(j) ? 1 : 4; /* about a reversal even a free joint hardly moves */
    }
    return j->still >= 4UL * j->limits.stall;
}

uint8_t joint_fault(struct joint *j) {
    if (!reading_valid(j->reading)) return FAULT_SENSOR;
    if (size(travel(j)) * (1000UL / SPEED_MS) > j->limits.strike) return FAULT_STRIKE;
    int8_t drive = drive_of(j);
    if (j->turned < UINT16_MAX) j->turned++;
    if (drive != j->drive) turn(j, drive);
    if (drive && goes_against(j)) return FAULT_DIRECTION;
    return is_stuck(j) ? FAULT_STALL : 0;
}

uint8_t joint_drive(struct joint *j, int16_t level) {
    int32_t limit = j->limits.duty, slew = j->limits.slew;
    int32_t wanted = level > limit ? limit : level < -limit ? -limit : level;
    int32_t change = wanted - j->duty;
    j->duty = (int16_t)(j->duty + (change > slew ? slew : change < -slew ? -slew : change));
    if (j->duty < 0 && j->reading <= (int16_t)j->limits.low) {
        j->duty = 0;
        return 1;
    }
    if (j->duty > 0 && j->reading >= (int16_t)j->limits.high) {
        j->duty = 0;
        return 2;
    }
    return 0;
}
