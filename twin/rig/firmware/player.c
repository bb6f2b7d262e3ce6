#include "player.h"

#include <stddef.h>
#include <string.h>

#define NOBODY 255
#define IDLE_MS 50    /* period of SAMPLE while nothing runs, and of a repeated FAULT */
#define LISTENER_MS 500
#define LOST_SUPPLY_MS 5
#define BYTE_US 90    /* [us] of a byte on the line, a little more than it takes */

static const uint8_t NAME[16] = "qpal-mega2560";
static const uint8_t RELEASE[3] = {0, 1, 0};

static struct joint joints[WIRE_JOINTS];
static uint8_t state, reason, culprit;
static uint32_t now, fault_at;    /* [ms] */
static uint8_t fault_repeats, silence, weak, idle_phase;
static uint16_t listener;         /* [ms] that a host still listens to samples of a rig at rest */
static uint16_t idle_number;

static int16_t ring[WIRE_RING][WIRE_JOINTS];
static uint16_t received, taken;  /* levels of this run */

static uint16_t period, samples, hold; /* period in [ms] */
static uint16_t number, phase, armed_supply;
static int16_t level[WIRE_JOINTS];
static struct { /* the sample whose period is running */
    uint32_t clock;
    int16_t readings[WIRE_JOINTS], supply;
    int32_t sum[WIRE_JOINTS];
    uint8_t cuts;
} sample;

static bool active(void) {
    return state == STATE_ARMED || state == STATE_RUNNING;
}

static uint8_t used(void) {
    uint8_t n = 0;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) n = (uint8_t)(n + joints[j].limits.used);
    return n;
}

static void rest(uint8_t next) {
    state = next;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) joint_rest(&joints[j]);
}

static void send_fault(void) {
    uint8_t payload[6] = {reason, culprit};
    wire_put32(payload + 2, fault_at * 1000);
    link_send(WIRE_FAULT, payload, sizeof payload);
    fault_repeats--;
}

static void fail(uint8_t why, uint8_t joint) {
    rest(STATE_FAULT);
    reason = why;
    culprit = joint;
    fault_at = now;
    fault_repeats = 3;
    idle_phase = 0;
    send_fault();
}

static void send_identity(void) {
    uint8_t payload[29] = {WIRE_VERSION, RELEASE[0], RELEASE[1], RELEASE[2], WIRE_JOINTS};
    uint8_t *end = wire_put16(payload + 5, WIRE_RING);
    end = wire_put32(wire_put16(end, FULL_READING), F_CPU);
    memcpy(end, NAME, sizeof NAME);
    link_send(WIRE_IDENTITY, payload, sizeof payload);
}

/* `shown` joints are told: those that are used in a run, all of them at rest. */
static void send_sample(uint16_t index, bool all, uint8_t dropped) {
    uint8_t payload[2 + 4 + 4 * WIRE_JOINTS + 7];
    uint8_t *end = wire_put32(wire_put16(payload, index), sample.clock);
    int32_t half = phase / 2;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) {
        if (!all && !joints[j].limits.used) continue;
        int32_t sum = sample.sum[j];
        int32_t mean = phase ? (sum + (sum < 0 ? -half : half)) / phase : 0;
        end = wire_put16(wire_put16(end, (uint16_t)sample.readings[j]), (uint16_t)mean);
    }
    end = wire_put16(end, (uint16_t)sample.supply);
    *end++ = state;
    *end++ = sample.cuts;
    end = wire_put16(end, (uint16_t)(WIRE_RING - (received - taken)));
    *end++ = dropped;
    link_send(WIRE_SAMPLE, payload, (uint8_t)(end - payload));
}

static uint8_t do_setup(const uint8_t *p) {
    if (active()) return REFUSED_STATE;
    if (p[0] >= WIRE_JOINTS) return REFUSED_VALUE;
    struct limits l = {wire_u16(p + 1),  wire_u16(p + 3),  wire_u16(p + 5),  wire_u16(p + 7), wire_u16(p + 9),
                       wire_u16(p + 11), wire_u16(p + 13), (p[15] & 1) != 0, (p[15] & 2) != 0, 0, 0, 0, 0};
    if (!limits_complete(&l) && l.used) return REFUSED_VALUE;
    if (l.used != joints[p[0]].limits.used) received = taken = 0;
    joints[p[0]].limits = l;
    return 0;
}

static uint8_t do_levels(const uint8_t *p, uint8_t n) {
    uint16_t index = wire_u16(p);
    uint8_t count = p[2], width = used();
    if (width == 0 || n != 3 + count * 2 * width) return REFUSED_SETUP;
    if (index == 0 && !active()) received = taken = 0;
    if (index > received) return REFUSED_GAP;
    uint16_t known = (uint16_t)(received - index);
    if (known >= count) return 0;
    for (uint8_t i = 3; i < n; i = (uint8_t)(i + 2)) {
        int16_t value = (int16_t)wire_u16(p + i);
        if (value > WIRE_LARGEST_DUTY || value < -WIRE_LARGEST_DUTY) return REFUSED_VALUE;
    }
    if (count - known > WIRE_RING - (received - taken)) return REFUSED_ROOM;
    for (p += 3 + known * 2 * width; known < count; known++, received++) {
        for (uint8_t j = 0; j < WIRE_JOINTS; j++) {
            if (!joints[j].limits.used) continue;
            ring[received % WIRE_RING][j] = (int16_t)wire_u16(p);
            p += 2;
        }
    }
    return 0;
}

static uint8_t do_arm(const uint8_t *p, const struct inputs *in) {
    uint16_t half_ms = wire_u16(p), total = wire_u16(p + 2), held = wire_u16(p + 4);
    uint8_t width = used();
    if (state == STATE_RUNNING) return REFUSED_STATE;
    if (half_ms % 2 || half_ms * 500UL < (19UL + 4UL * width) * BYTE_US || !total || !held) return REFUSED_VALUE;
    if (!width) return REFUSED_SETUP;
    if (in->key) return REFUSED_KEY;
    if (in->supply < FULL_READING / 10) return REFUSED_SUPPLY;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++)
        if (joints[j].limits.used && !reading_valid(in->readings[j])) return REFUSED_SENSOR;
    uint16_t needed = (uint16_t)((total - 1) / held + 1);
    if (taken || received < (needed < WIRE_RING ? needed : WIRE_RING)) return REFUSED_LEVELS;
    period = half_ms / 2;
    samples = total;
    hold = held;
    armed_supply = (uint16_t)in->supply;
    weak = 0;
    fault_repeats = 0;
    rest(STATE_ARMED);
    return 0;
}

static uint8_t do_start(void) {
    if (state != STATE_ARMED) return REFUSED_STATE;
    rest(STATE_RUNNING);
    number = phase = 0;
    return 0;
}

static void answer(const struct inputs *in) {
    const uint8_t *payload = in->body + 2;
    uint8_t done[3] = {in->body[0], in->body[1], 0};
    switch (in->body[0]) {
    case WIRE_HELLO: send_identity(); return;
    case WIRE_ALIVE: listener = LISTENER_MS; return;
    case WIRE_SETUP: done[2] = do_setup(payload); break;
    case WIRE_LEVELS: done[2] = do_levels(payload, (uint8_t)(in->length - 2)); break;
    case WIRE_ARM: done[2] = do_arm(payload, in); break;
    case WIRE_START: done[2] = do_start(); break;
    default: /* STOP */
        if (active()) fail(FAULT_STOPPED, NOBODY);
    }
    link_send(WIRE_DONE, done, sizeof done);
}

/* The faults of the rig, and of no single joint. */
static uint8_t common_fault(const struct inputs *in) {
    if (in->key) return FAULT_STOPPED;
    if (silence >= WIRE_SILENCE_MS) return FAULT_LINK;
    if (in->bad >= WIRE_STORM) return FAULT_STORM;
    if (in->overrun) return FAULT_OVERRUN;
    weak = in->supply * 5L < armed_supply * 3L ? (uint8_t)(weak + 1) : 0;
    return weak >= LOST_SUPPLY_MS ? FAULT_SUPPLY : 0;
}

static void watch(const struct inputs *in) {
    uint8_t jumped = 0;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++)
        if (!joint_read(&joints[j], in->readings[j])) jumped = (uint8_t)(jumped | (1 << j));
    if (!active()) return;
    uint8_t why = common_fault(in);
    if (why) fail(why, NOBODY);
    for (uint8_t j = 0; j < WIRE_JOINTS && active(); j++) {
        if (!joints[j].limits.used) continue;
        why = jumped & (1 << j) ? FAULT_SENSOR : joint_fault(&joints[j]);
        if (why) fail(why, j);
    }
}

static void begin_sample(const struct inputs *in) {
    memset(&sample, 0, sizeof sample);
    sample.clock = now * 1000;
    sample.supply = in->supply;
    memcpy(sample.readings, in->readings, sizeof sample.readings);
}

static void play(const struct inputs *in) {
    if (phase == period || number == 0) {
        if (number == samples) rest(STATE_ENDED);
        if (number) send_sample((uint16_t)(number - 1), false, in->dropped);
        if (state != STATE_RUNNING) return;
        if (number % hold == 0) {
            if (taken == received) {
                fail(FAULT_STARVED, NOBODY);
                return;
            }
            memcpy(level, ring[taken++ % WIRE_RING], sizeof level);
        }
        begin_sample(in);
        phase = 0;
        number++;
    }
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) {
        if (!joints[j].limits.used) continue;
        sample.cuts = (uint8_t)(sample.cuts | (joint_drive(&joints[j], level[j]) << (2 * j)));
        sample.sum[j] += joints[j].duty;
    }
    phase++;
}

static void idle(const struct inputs *in) {
    if (++idle_phase >= IDLE_MS) {
        idle_phase = 0;
        if (fault_repeats) send_fault();
        if (listener) {
            begin_sample(in);
            phase = 0;
            send_sample(idle_number++, true, in->dropped);
        }
    }
}

void player_step(const struct inputs *in, struct outputs *out) {
    now++;
    if (silence < 255) silence++;
    if (listener) listener--;
    if (in->body) silence = 0;
    watch(in);
    if (in->body) answer(in);
    if (state == STATE_RUNNING) play(in);
    if (!active()) idle(in);
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) {
        out->on[j] = state == STATE_RUNNING && joints[j].limits.used;
        out->duty[j] = joints[j].limits.reversed ? (int16_t)-joints[j].duty : joints[j].duty;
    }
}
