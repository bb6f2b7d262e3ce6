#include "board.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <string.h>

#define CHANNELS 4
#define CONVERSIONS (4 * CHANNELS) /* of 52 us, in turn, within a millisecond */
#define PWM (1 << WGM31)
#define MESSAGES 8
#define LARGEST_ANSWER 32 /* bytes of a payload; IDENTITY has 29 */
#define ENABLES ((1 << PA0) | (1 << PA1) | (1 << PA2))

static volatile uint8_t received[256], heard, read; /* rings whose places run over by themselves */
static volatile uint8_t queued[256], last, sent;
static struct message {
    uint8_t type, sequence, length, payload[LARGEST_ANSWER];
} messages[MESSAGES]; /* a ring too: from the control loop to the main loop */
static volatile uint8_t written, encoded;
static volatile uint8_t conversion;
static uint16_t sums[CHANNELS], scan[CHANNELS];
static volatile bool alive, busy, overran;

void board_begin(void) {
    MCUSR = 0; /* after a reset by the watchdog it would go on at its shortest time */
    wdt_enable(WDTO_30MS);
    DDRA = ENABLES;
    PORTC = 1 << PC7;
    DDRE = (1 << PE3) | (1 << PE4);
    DDRH = (1 << PH3) | (1 << PH4);
    DDRL = (1 << PL3) | (1 << PL4);
    ICR3 = ICR4 = ICR5 = WIRE_LARGEST_DUTY - 1; /* fast PWM of 1023 cycles, 15.6 kHz */
    TCCR3A = TCCR4A = TCCR5A = PWM;
    TCCR3B = TCCR4B = TCCR5B = (1 << WGM33) | (1 << WGM32) | (1 << CS30);
    UCSR0A = 1 << U2X0; /* first: simavr takes the baud rate from it when UBRR0 is written */
    UBRR0 = 16;         /* 117647 baud, 2.1 % more than 115200, as the board's own core has it */
    UCSR0C = (1 << UCSZ01) | (1 << UCSZ00);
    UCSR0B = (1 << RXCIE0) | (1 << RXEN0) | (1 << TXEN0);
    DIDR0 = 0x0f;
    ADCSRA = (1 << ADEN) | (1 << ADIE) | (1 << ADPS2) | (1 << ADPS1); /* 250 kHz */
    conversion = CONVERSIONS;
    OCR1A = F_CPU / 8 / 1000 - 1;
    TCCR1B = (1 << WGM12) | (1 << CS11);
    TIMSK1 = 1 << OCIE1A;
    sei();
}

static void convert(uint8_t channel) {
    ADMUX = (uint8_t)((1 << REFS0) | channel); /* against AVCC, which also feeds the potentiometers */
    ADCSRA |= 1 << ADSC;
}

ISR(ADC_vect) {
    uint8_t channel = conversion % CHANNELS;
    uint16_t value = ADC;
    if (++conversion < CONVERSIONS) convert(conversion % CHANNELS);
    sums[channel] = (uint16_t)(sums[channel] + value);
}

/* Readings are taken from here: the first conversion begins at the same cycle of each millisecond. */
ISR(TIMER1_COMPA_vect) {
    if (conversion < CONVERSIONS) {
        overran = true;
    } else {
        conversion = 0;
        convert(0);
        for (uint8_t c = 0; c < CHANNELS; c++) {
            scan[c] = sums[c];
            sums[c] = 0;
        }
    }
    if (busy) {
        overran = true;
        board_cut();
        return;
    }
    busy = true;
    if (alive) wdt_reset();
    alive = false;
    bool late = overran;
    overran = false;
    sei();
    control(late);
    cli();
    busy = false;
}

void board_read(struct inputs *in) {
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) in->readings[j] = (int16_t)scan[j];
    in->supply = (int16_t)scan[3];
    in->key = (PINC & (1 << PC7)) != 0;
}

void board_cut(void) {
    PORTA &= (uint8_t)~ENABLES;
    TCCR3A = TCCR4A = TCCR5A = PWM;
}

/* High for |duty| of 1023 cycles at one output, low at the other; a compare of 0 would still give one cycle. */
static void drive(volatile uint8_t *control, volatile uint16_t *forward, volatile uint16_t *backward, int16_t duty) {
    uint8_t pin = duty > 0 ? 1 << COM3A1 : duty < 0 ? 1 << COM3B1 : 0;
    if (duty > 0) *forward = (uint16_t)(duty - 1);
    if (duty < 0) *backward = (uint16_t)(-duty - 1);
    *control = PWM | pin;
}

void board_drive(const struct outputs *out) {
    uint8_t enables = 0;
    for (uint8_t j = 0; j < WIRE_JOINTS; j++) enables = (uint8_t)(enables | (out->on[j] << j));
    drive(&TCCR3A, &OCR3A, &OCR3B, out->on[0] ? out->duty[0] : 0);
    drive(&TCCR4A, &OCR4A, &OCR4B, out->on[1] ? out->duty[1] : 0);
    drive(&TCCR5A, &OCR5A, &OCR5B, out->on[2] ? out->duty[2] : 0);
    PORTA = enables;
}

ISR(USART0_RX_vect) {
    uint8_t byte = UDR0;
    if ((uint8_t)(heard + 1) == read) return; /* full: the frame's check sum will tell */
    received[heard] = byte;
    heard++;
}

int16_t board_byte(void) {
    if (read == heard) return -1;
    return received[read++];
}

ISR(USART0_UDRE_vect) {
    if (sent == last) {
        UCSR0B &= (uint8_t)~(1 << UDRIE0);
        return;
    }
    UDR0 = queued[sent];
    sent++;
}

/* Called from the control loop, which has no time for check sums. */
void link_send(uint8_t type, const uint8_t *payload, uint8_t n) {
    static uint8_t sequence;
    uint8_t number = sequence++; /* a frame for which there is no room leaves a gap that the host sees */
    if ((uint8_t)(written - encoded) == MESSAGES) return;
    struct message *m = &messages[written % MESSAGES];
    m->sequence = number;
    m->type = type;
    m->length = n;
    memcpy(m->payload, payload, n);
    written++;
}

void board_send(void) {
    uint8_t frame[WIRE_LARGEST_FRAME];
    while (encoded != written) {
        const struct message *m = &messages[encoded % MESSAGES];
        uint8_t length = wire_frame(frame, m->type, m->sequence, m->payload, m->length);
        if ((uint8_t)(sent - last - 1) < length) return;
        for (uint8_t i = 0; i < length; i++) queued[(uint8_t)(last + i)] = frame[i];
        last = (uint8_t)(last + length);
        encoded++;
        cli();
        UCSR0B |= 1 << UDRIE0;
        sei();
    }
}

void board_wait(void) {
    alive = true;
    sleep_mode();
}
