/* The firmware of the rig: docs/rig-protocol.md. Here frames are received and sent; all else happens in the control loop. */
#include <stddef.h>

#include "board.h"

static uint8_t frame[WIRE_LARGEST_FRAME];
static volatile uint8_t body; /* length of a good frame that waits for the control loop, or 0 */
static volatile uint8_t dropped, bad;

void control(bool overrun) {
    struct inputs in = {.dropped = dropped, .bad = bad, .overrun = overrun};
    struct outputs out;
    board_read(&in);
    if (body) {
        in.body = frame;
        in.length = body;
    }
    player_step(&in, &out);
    board_drive(&out);
    body = 0;
}

static void close_frame(uint8_t n, bool whole) {
    uint8_t length = whole ? wire_body(frame, n) : 0;
    if (length) {
        bad = 0;
        __asm__ __volatile__("" ::: "memory"); /* the frame is complete before the control loop may see it */
        body = length;
    } else {
        dropped++;
        if (bad < 255) bad++;
    }
}

int main(void) {
    uint8_t n = 0;
    bool whole = true;
    board_begin();
    for (;;) {
        int16_t byte = body ? -1 : board_byte();
        if (byte < 0) {
            board_send();
            board_wait();
        } else if (byte == 0) {
            if (n) close_frame(n, whole);
            n = 0;
            whole = true;
        } else if (n < sizeof frame) {
            frame[n++] = (uint8_t)byte;
        } else {
            whole = false;
        }
    }
}
