/* The firmware on a simulated board: simavr executes its .elf, in lock step with a program that simulates the rest.

   simulated FIRMWARE.elf SEED NOISE        (Debian: libsimavr-dev, libelf-dev; simavr is under the GPL)

   Standard input: `struct step` and its bytes from the host; standard output: `struct shown`, the cycles at which
   conversions began (u64: 16 x cycle + channel), and the bytes to the host. See twin/rig/avr.py. Bytes go in at the
   baud rate; a conversion reads the pin with NOISE [counts of 10 bits, RMS]. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define JOINTS 3
#define BYTE_CYCLES 1389 /* ten bits at 115200 baud of 16 MHz */
#define LOOK_CYCLES 1000 /* how often the outputs are read: near the period of the PWM */
#define AVCC (1023 * 32) /* 32 units of voltage a count, so that a count is met in its middle */

struct step {
    uint32_t cycles;
    float readings[JOINTS + 1]; /* shares of a full reading; the last is the supply */
    uint8_t key, padding;
    uint16_t bytes;
};

struct shown {
    uint64_t cycle, last_on; /* the cycle until which this step ran, and the last at which any output was on */
    float duty[JOINTS];      /* mean over the step, -1 to 1 */
    uint8_t enabled, stopped; /* bits of joints; whether the processor does not run any more */
    uint16_t conversions, bytes, padding;
    uint32_t busy; /* cycles in which the processor did not sleep */
};

static const struct bridge { /* registers of the ATmega2560's datasheet, in the data space */
    uint16_t control, forward, backward, direction, port;
    uint8_t pins[2];
} BRIDGES[JOINTS] = {
    {0x90, 0x98, 0x9A, 0x2D, 0x2E, {3, 4}},
    {0xA0, 0xA8, 0xAA, 0x101, 0x102, {3, 4}},
    {0x120, 0x128, 0x12A, 0x10A, 0x10B, {3, 4}},
};
#define DDRA 0x21
#define PORTA 0x22

static avr_t *avr;
static avr_irq_t *adc, *uart;
static struct step step;
static uint8_t to_board[1 << 16], to_host[1 << 16];
static uint32_t first, last; /* of to_board */
static uint16_t told, conversions;
static uint64_t begun[256], last_on;
static double sum[JOINTS];
static unsigned looks;
static uint64_t asleep;
static double noise;
static uint64_t state;

static double uniform(void) {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL; /* Knuth's MMIX */
    return (double)(state >> 11) / 9007199254740992.0;
}

static double normal(void) {
    return sqrt(-2 * log(1 - uniform())) * cos(6.283185307179586 * uniform());
}

static void convert(avr_irq_t *irq, uint32_t value, void *param) {
    union {
        avr_adc_mux_t mux;
        uint32_t v;
    } e = {.v = value};
    (void)irq, (void)param;
    if (conversions < 256) begun[conversions++] = avr->cycle << 4 | (e.mux.src & 15);
    if (e.mux.src > JOINTS) return;
    double count = floor(step.readings[e.mux.src] * 1024 + noise * normal());
    count = count < 0 ? 0 : count > 1023 ? 1023 : count;
    avr_raise_irq(adc + ADC_IRQ_ADC0 + e.mux.src, (uint32_t)count * 32 + 16);
}

static void tell(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)param;
    to_host[told++] = (uint8_t)value;
}

static avr_cycle_count_t deliver(avr_t *a, avr_cycle_count_t when, void *param) {
    (void)param;
    if (first == last) return 0;
    avr_raise_irq(uart + UART_IRQ_INPUT, to_board[first++ % sizeof to_board]);
    return (when > a->cycle ? when : a->cycle) + BYTE_CYCLES;
}

static double pin_duty(const struct bridge *b, int side) {
    uint16_t compare = side ? b->backward : b->forward, top = b->control + 6;
    if (!(avr->data[b->direction] >> b->pins[side] & 1)) return 0;
    if (!(avr->data[b->control] >> (side ? 5 : 7) & 1)) return avr->data[b->port] >> b->pins[side] & 1;
    return ((avr->data[compare] | avr->data[compare + 1] << 8) + 1.0) / ((avr->data[top] | avr->data[top + 1] << 8) + 1.0);
}

/* The outputs are told by their registers: the PWM's own events, and polls of pins that interrupt nothing, only cost. */
static void stop_events(const struct bridge *b) {
    for (int k = 0; k < 16; k++) avr->io[AVR_DATA_TO_IO(b->control + k)].w.c = NULL;
}

static uint8_t enabled(void) {
    return avr->data[PORTA] & avr->data[DDRA] & 7;
}

static avr_cycle_count_t look(avr_t *a, avr_cycle_count_t when, void *param) {
    (void)param;
    looks++;
    for (int j = 0; j < JOINTS; j++) {
        double up = pin_duty(&BRIDGES[j], 0), down = pin_duty(&BRIDGES[j], 1);
        if (up != 0 || down != 0 || enabled() >> j & 1) last_on = a->cycle;
        if (enabled() >> j & 1) sum[j] += up - down;
    }
    return when + LOOK_CYCLES;
}

static void no_wait(avr_t *a, avr_cycle_count_t cycles) {
    (void)a;
    asleep += cycles + 1;
}

static void silent(avr_t *a, const int level, const char *format, va_list list) {
    (void)a;
    if (level <= LOG_ERROR) vfprintf(stderr, format, list);
}

static int whole(int in, void *at, size_t n) {
    for (uint8_t *p = at; n;) {
        ssize_t got = read(in, p, n);
        if (got <= 0) return 0;
        p += got;
        n -= (size_t)got;
    }
    return 1;
}

static void put(FILE *out, const void *at, size_t n) {
    if (fwrite(at, 1, n, out) != n) exit(1);
}

int main(int n, char **words) {
    if (n != 4) return 2;
    FILE *out = fdopen(dup(1), "wb"); /* simavr prints to standard output */
    if (!out || !freopen("/dev/null", "w", stdout)) return 1;
    state = strtoull(words[2], NULL, 10);
    noise = strtod(words[3], NULL);
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(silent);
    if (elf_read_firmware(words[1], &firmware) != 0) return 1;
    avr = avr_make_mcu_by_name("atmega2560");
    if (!avr || avr_init(avr) != 0) return 1;
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = AVCC;
    avr->sleep = no_wait;
    avr_load_firmware(avr, &firmware);
    adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(adc + ADC_IRQ_OUT_TRIGGER, convert, NULL);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, tell, NULL);
    avr_cycle_timer_register(avr, LOOK_CYCLES, look, NULL);
    for (int j = 0; j < JOINTS; j++) stop_events(&BRIDGES[j]);
    for (uint8_t k = 0; k < EXTINT_COUNT; k++) avr_extint_set_strict_lvl_trig(avr, k, 0);
    uint64_t until = 0;
    struct shown shown;
    memset(&shown, 0, sizeof shown);
    while (whole(0, &step, sizeof step)) {
        for (int i = 0; i < step.bytes; i++)
            if (!whole(0, &to_board[last++ % sizeof to_board], 1)) return 0;
        if (first != last && !avr_cycle_timer_status(avr, deliver, NULL))
            avr_cycle_timer_register(avr, BYTE_CYCLES, deliver, NULL);
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), 7), step.key);
        memset(sum, 0, sizeof sum);
        looks = told = conversions = 0;
        until += step.cycles;
        int run = cpu_Running;
        uint64_t begin = avr->cycle;
        asleep = 0;
        while (avr->cycle < until && run != cpu_Done && run != cpu_Crashed) run = avr_run(avr);
        shown.busy = (uint32_t)(avr->cycle - begin - asleep);
        shown.cycle = avr->cycle;
        shown.last_on = last_on;
        shown.enabled = enabled();
        shown.stopped = run == cpu_Done || run == cpu_Crashed;
        shown.conversions = conversions;
        shown.bytes = told;
        for (int j = 0; j < JOINTS; j++) shown.duty[j] = looks ? (float)(sum[j] / looks) : 0;
        put(out, &shown, sizeof shown);
        put(out, begun, conversions * sizeof *begun);
        put(out, to_host, told);
        fflush(out);
    }
    return 0;
}
