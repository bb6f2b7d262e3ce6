#include "safety.h"

#define FINE ((int32_t)256) /* of a count */

bool limits_complete(struct limits *l) {
    l->jump = (uint16_t)(l->strike / 250 + FULL_READING / 64); /* at four times the limit of speed, and noise */
    l->quarter = l->stall / 4 < COAST_MS ? (uint16_t)(l->stall / 4 + 2) : COAST_MS;
    l->delay = l->stall / 60 < DELAY_MS ? l->stall / 60 : DELAY_MS;
    l->decay = (uint16_t)(65536UL / l->quarter);
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
    bool near = size((int16_t)(reading - j->reading)) <= j->limits.jump;
    j->past[j->next] = j->reading;
    j->next = (uint8_t)((j->next + 1) % SPEED_MS);
    j->reading = reading;
    j->smooth += (reading * FINE - j->smooth) / 4;
    j->slow += (reading * FINE - j->slow) / 16;
    return near;
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

static void turn(struct joint *j, int8_t drive) {
    int32_t speed = (j->slow - j->smooth) * drive / (15 - 3); /* a ramp is 3 ms ahead of the one and 15 of the other */
    j->drive = drive;
    j->turned = 0;
    j->ahead = j->smooth;
    j->pace = speed <= 0 ? 0 : speed < UINT16_MAX ? (uint16_t)speed : UINT16_MAX;
}

static bool goes_against(struct joint *j) {
    j->ahead -= (int32_t)j->pace * j->drive;
    if (j->pace && j->turned >= j->limits.delay)
        j->pace = (uint16_t)(j->pace - 1U - (uint16_t)((uint32_t)j->pace * j->limits.decay >> 16));
    if ((j->smooth - j->ahead) * j->drive > 0) j->ahead = j->smooth;
    return (j->ahead - j->smooth) * j->drive >= j->limits.motion * FINE;
}

static void begin_part(struct joint *j) {
    j->parts[j->part].lowest = j->parts[j->part].highest = j->smooth;
    j->spent = 0;
}

void joint_rest(struct joint *j) {
    j->duty = 0;
    j->drive = 0;
    j->part = j->whole = 0;
    begin_part(j);
}

static bool is_stuck(struct joint *j) {
    int32_t lowest = j->smooth, highest = j->smooth;
    if (j->smooth < j->parts[j->part].lowest) j->parts[j->part].lowest = j->smooth;
    if (j->smooth > j->parts[j->part].highest) j->parts[j->part].highest = j->smooth;
    /* About a turn even a free joint hardly moves. */
    if (j->drive && !at_limit(j)) j->spent += j->turned < j->limits.quarter ? 1 : PARTS;
    if (j->spent < j->limits.stall) return false;
    if (j->whole < PARTS) j->whole++;
    for (uint8_t p = 0; p < PARTS; p++) {
        if (j->parts[p].lowest < lowest) lowest = j->parts[p].lowest;
        if (j->parts[p].highest > highest) highest = j->parts[p].highest;
    }
    j->part = (uint8_t)((j->part + 1) % PARTS);
    begin_part(j);
    return j->whole == PARTS && highest - lowest < j->limits.motion * FINE;
}

uint8_t joint_fault(struct joint *j) {
    if (!reading_valid(j->reading)) return FAULT_SENSOR;
    if (size((int16_t)(j->reading - j->past[j->next])) * (1000UL / SPEED_MS) > j->limits.strike) return FAULT_STRIKE;
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
