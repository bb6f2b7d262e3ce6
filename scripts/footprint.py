"""Size and time of exported C on two microcontrollers: the table of docs/export.md.

    python scripts/footprint.py

It needs gcc-avr, avr-libc, simavr, gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm. simavr counts
cycles; qemu counts instructions, of which a Cortex-M4 takes 1 to 1.5 cycles each. The largest of 300 samples is given,
less what a loop without the model takes.
"""

import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import sysid
from sysid.export import c as export_c

SAMPLES = 300
AVR = [
    "avr-gcc",
    "-mmcu=atmega2560",
    "-DF_CPU=16000000UL",
    "-std=gnu99",
    "-Os",
    "-ffunction-sections",
    "-Wl,--gc-sections",
]
ARM = ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-std=gnu99", "-O2"]
ARM += ["-ffunction-sections", "-Wl,--gc-sections"]
AVR_MAIN = """
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/interrupt.h>
static void put(char c) { while (!(UCSR0A & (1 << UDRE0))) {} UDR0 = (unsigned char)c; }
static unsigned long clock_now(void) { return TCNT1 * 8UL; }
static void clock_start(void) { TCCR1B = 2; TCNT1 = 0; UCSR0B = 1 << TXEN0; }
static void over(void) { cli(); sleep_enable(); sleep_cpu(); }
"""
ARM_MAIN = """
#include <stdint.h>
#define R(a) (*(volatile uint32_t *)(a))
static long call(int what, const void *with)
{
    register long r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}
static void put(char c) { call(3, &c); }
static unsigned long clock_now(void) { return (0xffffffUL - R(0xe000e018)) * 40UL; } /* 25 MHz, 1 ns an instruction */
static void clock_start(void) { R(0xe000e014) = 0xffffff; R(0xe000e018) = 0; R(0xe000e010) = 5; }
static void over(void) { call(0x18, (const void *)0x20026); }
int main(void);
extern uint32_t _etext, _data, _edata, _bss, _ebss;
void reset(void)
{
    R(0xe000ed88) |= 0xf00000; /* the floating-point unit */
    for (uint32_t *from = &_etext, *to = &_data; to < &_edata;) *to++ = *from++;
    for (uint32_t *to = &_bss; to < &_ebss;) *to++ = 0;
    main();
}
__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {(void *)0x20010000, (void *)reset};
"""
ARM_LINK = """
ENTRY(reset)
SECTIONS {
  .text 0 : { KEEP(*(.vectors)) *(.text*) *(.rodata*) *(.ARM*) . = ALIGN(8); _etext = .; }
  .data 0x20000000 : AT(_etext) { _data = .; *(.data*) . = ALIGN(8); _edata = .; }
  .bss : { _bss = .; *(.bss*) *(COMMON) . = ALIGN(8); _ebss = .; }
}
"""
MAIN = """
#include "NAME.h"
static const REAL u[] = {INPUTS};
static NAME_state s;
static NAME_params p;
volatile REAL y;
static void say(unsigned long n)
{
    char text[12];
    int k = 0;
    do { text[k++] = (char)('0' + n % 10); n /= 10; } while (n);
    while (k) put(text[--k]);
    put(10);
}
int main(void)
{
    unsigned long most = 0;
    clock_start();
    p = NAME_fit;
    NAME_init(&s, &p);
    for (int t = 0; t < (int)(sizeof u / sizeof u[0]); ++t) {
        clock_start();
        const unsigned long before = clock_now();
        STEP
        const unsigned long took = clock_now() - before;
        if (took > most) most = took;
    }
    say(most);
    over();
    return 0;
}
"""
STEPS = 20  # of a sample that are timed together on the coarse clock of the second machine


def models() -> dict[str, sysid.Fit]:
    """What the table has: fitted to a drawn record, so that the numbers of the maps are no round ones."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-6.0, 6.0, 80), 10)
    y = np.clip(np.cumsum(np.where(np.abs(u) > 2.0, 0.01 * u, 0.0)), -0.4, 0.4) + 0.002 * rng.standard_normal(len(u))
    data, few = sysid.IOData(u, y, 0.1), sysid.Options(max_iterations=5)
    named = sysid.structures
    chains = {
        "output_error": named.output_error(2, 2, 1),
        "hammerstein_wiener": named.hammerstein_wiener(2, 2, 1, input="saturation", output="piecewise_linear"),
        "actuated_joint": named.actuated_joint(),
    }
    return {name: sysid.fit(chain, data, starts=1, options=few) for name, chain in chains.items()}


def main() -> None:
    """Print the table."""
    print("| model | machine | precision | code [B] | with libm [B] | parameters, state [B] | a step |")
    print("| :-- | :-- | :-- | --: | --: | --: | --: |")
    u = np.repeat(np.random.default_rng(1).uniform(-6.0, 6.0, SAMPLES // 10), 10)
    for name, fit in models().items():
        for machine, single in (("ATmega2560", True), ("Cortex-M4F", True), ("Cortex-M4F", False)):
            with tempfile.TemporaryDirectory() as folder:
                row = _measured(fit, name, machine, single, u, Path(folder))
            print(f"| `{name}` | {machine} | {'single' if single else 'double'} | {row} |")


def _measured(fit: sysid.Fit, name: str, machine: str, single: bool, u: np.ndarray, folder: Path) -> str:
    avr, build = machine.startswith("AT"), AVR if machine.startswith("AT") else ARM
    export_c.write(fit, folder / f"{name}.c", single)
    source = export_c.written_source(fit, name, single)
    _run([*build, "-c", f"{name}.c", "-o", "model.o"], folder)
    size = 4 if single else 8
    code = sum(_size(f"{build[0][:-3]}size", "model.o", folder))
    took, linked = {}, {}
    for what, step in (("full", f"y = {name}_step(&s, &p, u[t]);"), ("empty", "y = u[t];")):
        text = MAIN.replace(
            "STEP", step if avr else f"NAME_state kept = s; for (int k = 0; k < {STEPS}; ++k) {{ s = kept; {step} }}"
        )
        text = text.replace("REAL", "float" if single else "double").replace("INPUTS", ", ".join(f"{v:.3f}" for v in u))
        (folder / "main.c").write_text((AVR_MAIN if avr else ARM_MAIN) + text.replace("NAME", name))
        (folder / "link.ld").write_text(ARM_LINK)
        link = [] if avr else ["-nostartfiles", "-T", "link.ld", "--specs=nosys.specs"]
        files = ["main.c", f"{name}.c"] if what == "full" else ["main.c", "-DNAME_init(s,p)", f"{name}.c"]
        _run([*build, *files, *link, "-o", f"{what}.elf", "-lm"], folder)
        linked[what] = sum(_size(f"{build[0][:-3]}size", f"{what}.elf", folder)[:2])
        run = ["simavr", "-m", "atmega2560", "-f", "16000000", f"{what}.elf"]
        if not avr:
            run = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-icount", "shift=0", "-kernel", f"{what}.elf"]
            run += ["-semihosting-config", "enable=on,target=native"]
        said = re.sub("\x1b\\[[0-9;]*m", "", _run(run, folder))
        took[what] = int(re.findall(r"(?m)^(\d+)\W*$", said)[-1])  # the last line that is a number
    step = took["full"] - took["empty"]
    step = step if avr else step / STEPS
    unit = f"cycles, {step / 16000:.2f} ms at 16 MHz" if avr else "instructions"
    memory = f"{size * len(source.parameters)}, {size * len(source.states)}"
    return f"{code:,} | {linked['full'] - linked['empty']:,} | {memory} | {step:,.0f} {unit}"


def _size(program: str, file: str, folder: Path) -> list[int]:
    return [int(n) for n in _run([program, file], folder).splitlines()[1].split()[:3]]


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}:\n{done.stderr}")
    return done.stdout + done.stderr


if __name__ == "__main__":
    main()
