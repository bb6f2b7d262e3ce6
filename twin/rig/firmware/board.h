/* The board: an Arduino Mega 2560 at 16 MHz, its pins and its clock. docs/rig.md draws the wiring.

   joint   potentiometer   PWM forward, backward   enable
   0       A0              D5  (OC3A), D2  (OC3B)  D22 (PA0)
   1       A1              D6  (OC4A), D7  (OC4B)  D23 (PA1)
   2       A2              D46 (OC5A), D45 (OC5B)  D24 (PA2)

   A3 is the supply behind a divider, D30 (PC7) the stop key: a normally closed contact to ground. A resistor of
   470 kOhm from each of A0 to A2 to ground lets a loose wiper be seen, one of 10 kOhm from each enable pin to ground
   keeps the drive off while the board starts. The UART is the board's USB port. */
#ifndef BOARD_H
#define BOARD_H

#include "player.h"

void board_begin(void);

/* Readings, supply and stop key as they are now. */
void board_read(struct inputs *in);

void board_drive(const struct outputs *out);

/* All drives off. */
void board_cut(void);

/* The next byte from the host, or -1. */
int16_t board_byte(void);

/* Puts what the control loop has to say on the line, as far as there is room. */
void board_send(void);

/* Waits for the next interrupt, and tells the watchdog of the processor that the main loop goes on. */
void board_wait(void);

/* Supplied by main.c: a millisecond of the control loop; with interrupts enabled, and never within itself. */
void control(bool overrun);

#endif
