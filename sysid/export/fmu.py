"""A fitted chain as a functional mock-up unit: FMI 3.0 or 2.0, co-simulation and model exchange, with its source.

The model is NAME.c of `sysid.export.c`; `fmu.c` and `fmi3.c` or `fmi2.c` beside this file put the standard's functions
around it. Their declarations are written out there, so that the source compiles without the standard's headers.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, readable
from sysid.base.files import atomic_file, versions
from sysid.block.writing import number
from sysid.export.c import Source, written_source
from sysid.export.c_structs import Value, in_comment
from sysid.export.program import AnyFit, Offset, channel_counts

VERSIONS = ("3.0", "2.0")
_HERE = Path(__file__).parent
_SYSTEMS = {
    "linux": ("linux", "linux", ".so"),
    "darwin": ("darwin", "darwin", ".dylib"),
    "win32": ("windows", "win", ".dll"),
}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}
# Names of `fmu.c` in FMI 2.0
_OLDER = (("fmi3", "fmi2"), ("FMI3", "FMI2"), ("FMUState", "FMUstate"), ("Deserialize", "DeSerialize"))
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")  # no contraction: the numbers of every machine
_SECONDS = 120.0  # for the compiler
_DEFAULT_SAMPLES = 100  # of the default experiment


@dataclass(frozen=True)
class Unit:
    """The file, and the platform that it has a compiled binary for; empty where there was no compiler."""

    path: Path
    platform: str


@checked
def write(
    fit: AnyFit, path: str | os.PathLike, version: str = "3.0", u_offset: Offset = None, y_offset: Offset = None
) -> Unit:
    """Write NAME.fmu, the file's name being NAME: the fit's free run from rest, on the levels of raw records.

    Co-simulation takes steps of Ts or a multiple; the output is that of the present sample and the present input, so
    that a model whose output does not hang on the input of the same sample gives exactly the samples of
    `Fit.simulate`; where it does, set the input and ask for the output before the step. In model exchange every sample
    is a time event, since a sampled model has no derivatives. Raises InputError for a block without a formula, another
    version, or a compiler that fails.
    """
    if version not in VERSIONS:
        raise InputError(f"FMI {version!r} is not written; choose one of {', '.join(VERSIONS)}")
    file = Path(path)
    name = file.stem
    source = written_source(fit, name, False, u_offset, y_offset)
    one = channel_counts(fit) == (1, 1)
    resting = ", ".join(number(v) for v in _resting(source))
    step = f"y[0] = {name}_step(s, &run->p, run->u[0]);" if one else f"{name}_step(s, &run->p, run->u, y);"
    common, own = ((_HERE / part).read_text(encoding="utf-8") for part in ("fmu.c", f"fmi{version[0]}.c"))
    if version == "2.0":
        for newer, older in _OLDER:
            common = common.replace(newer, older)
    wrapper = common + own
    wrapper = wrapper.replace("RESTING", f"{{{resting}}}").replace("STEP\n", f"{step}\n").replace("NAME_", f"{name}_")
    wrapper = wrapper.replace("NAME.h", f"{name}.h")
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, version + source.header + source.text + wrapper)}}}"
    wrapper = f'#define TOKEN "{token}"\n{wrapper}'
    names = [f"{name}.c", f"{name}_fmu.c"]
    description = _Description(fit, name, version, token, source, names)
    files = {
        "modelDescription.xml": description.text().encode(),
        f"sources/{name}.h": source.header.encode(),
        f"sources/{names[0]}": source.text.encode(),
        f"sources/{names[1]}": wrapper.encode(),
    }
    if version == "3.0":
        files["sources/buildDescription.xml"] = _build_description(name, names).encode()
    where, suffix = _place(version)
    binary = _compiled({k.removeprefix("sources/"): v for k, v in files.items() if k[-2:] in (".h", ".c")})
    if binary is not None:
        files[f"binaries/{where}/{name}{suffix}"] = binary
    with atomic_file(file) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, content in files.items():
            archive.writestr(zipfile.ZipInfo(each, (2000, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    return Unit(file, where if binary is not None else "")


def _resting(source: Source) -> list[float]:
    """The inputs of a model at rest: their offsets."""
    return [v.start for v in source.parameters if v.name.startswith("u_offset")]


def _place(version: str) -> tuple[str, str]:
    """The folder of this machine's binary, and the suffix of a shared library."""
    system, short, suffix = _SYSTEMS.get(sys.platform, _SYSTEMS["linux"])
    machine = _MACHINES.get(platform.machine().lower(), platform.machine().lower())
    bits = 64 if sys.maxsize > 2**32 else 32
    return (f"{machine}-{system}" if version == "3.0" else f"{short}{bits}"), suffix


def _compiled(files: dict[str, bytes]) -> bytes | None:
    """The shared library of the sources; None where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        sources = [name for name in files if name.endswith(".c")]
        command = [compiler, *_FLAGS, *sources, "-o", "out", "-lm"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            raise InputError(f"{compiler} did not end within {_SECONDS:g} s; try again, or another compiler") from None
        if done.returncode:
            said = next((line for line in done.stderr.splitlines() if "error" in line), "no reason given")
            raise InputError(f"{compiler} did not compile the model ({said}); try another compiler as cc")
        return Path(folder, "out").read_bytes()


def _build_description(name: str, sources: list[str]) -> str:
    files = "".join(f'\n      <SourceFile name="{each}"/>' for each in sources)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{name}">
    <SourceFileSet language="C99">{files}
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


@dataclass(frozen=True)
class _Variable:
    name: str
    causality: str
    variability: str
    initial: str
    value: Value
    description: str = ""

    @property
    def starts(self) -> bool:
        return self.causality in ("input", "parameter")


@dataclass(frozen=True)
class _Description:
    """The text of modelDescription.xml; the place of a variable in `variables` is its reference."""

    fit: AnyFit
    name: str
    version: str
    token: str
    source: Source
    sources: list[str]

    @property
    def variables(self) -> list[_Variable]:
        origin = self.fit.origin
        n_in, n_out = channel_counts(self.fit)
        found = [_Variable("time", "independent", "continuous", "", Value("time", 0.0, "s"))]
        for letter, n, causality in (("u", n_in, "input"), ("y", n_out, "output")):
            unit = in_comment(origin.si_units["uy".index(letter)]) if origin else ""
            said = readable(getattr(origin, f"{letter}_name")) if origin else ""
            levels = _resting(self.source) if letter == "u" else [0.0] * n
            for i in range(n):
                value = Value(letter if n == 1 else f"{letter}{i + 1}", levels[i], unit)
                initial = "calculated" if letter == "y" else ""
                found.append(_Variable(value.name, causality, "discrete", initial, value, said))
        for value in self.source.parameters:
            variability = "fixed" if value.initial else "tunable"
            found.append(_Variable(value.name, "parameter", variability, "exact", value))
        found += [_Variable(value.name, "local", "discrete", "calculated", value) for value in self.source.states]
        return found

    def text(self) -> str:
        """The whole file."""
        newer, made = self.version == "3.0", quoteattr(f"QPAL {versions()['qpal']}")
        saves = "FMUState" if newer else "FMUstate"
        can = f'canGetAndSet{saves}="true" canSerialize{saves}="true"'
        listed = (
            "" if newer else "<SourceFiles>" + "".join(f'<File name="{f}"/>' for f in self.sources) + "</SourceFiles>"
        )
        step, stop = number(self.fit.Ts), number(_DEFAULT_SAMPLES * self.fit.Ts)
        fixed = f' fixedInternalStepSize="{step}"' if newer else ""
        kinds = [
            ("ModelExchange", can),
            ("CoSimulation", f'canHandleVariableCommunicationStepSize="false"{fixed} {can}'),
        ]
        token = "instantiationToken" if newer else "guid"
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="{self.version}" modelName="{self.name}" {token}="{self.token}"',
            f"    description={quoteattr(f'{self.fit.model.structure}, one sample every {self.fit.Ts:g} s')}",
            f'    generationTool={made} variableNamingConvention="flat"{"" if newer else _NO_INDICATORS}>',
            *(f'  <{k} modelIdentifier="{self.name}" {v}>{listed}</{k}>' for k, v in kinds),
            *_indented("UnitDefinitions", (f"<Unit name={quoteattr(u)}/>" for u in self._units())),
            *_indented("LogCategories", (f'<Category name="logStatus{each}"/>' for each in ("Error", "Discard"))),
            f'  <DefaultExperiment startTime="0" stopTime="{stop}" stepSize="{step}"/>',
            *_indented("ModelVariables", (self._variable(k, v, newer) for k, v in enumerate(self.variables))),
            *_indented("ModelStructure", self._structure(newer)),
            "</fmiModelDescription>",
        ]
        return "\n".join(lines) + "\n"

    def _units(self) -> list[str]:
        return sorted({v.value.unit for v in self.variables} - {""})

    def _variable(self, reference: int, v: _Variable, newer: bool) -> str:
        value = v.value
        bounds = [(key, bound) for key, bound in (("min", value.lower), ("max", value.upper)) if np.isfinite(bound)]
        numbers = "".join(f' {key}="{number(bound)}"' for key, bound in bounds)
        numbers += f' start="{number(value.start)}"' if v.starts else ""
        unit = f" unit={quoteattr(value.unit)}" if value.unit else ""
        said = f" description={quoteattr(v.description)}" if v.description else ""
        initial = f' initial="{v.initial}"' if v.initial else ""
        head = f'name={quoteattr(v.name)} valueReference="{reference}" causality="{v.causality}"'
        head += f' variability="{v.variability}"{initial}{said}'
        if newer:
            return f"<Float64 {head}{unit}{numbers}/>"
        return f"<ScalarVariable {head}><Real{unit}{numbers}/></ScalarVariable>"

    def _structure(self, newer: bool) -> Iterator[str]:
        """Outputs, at once and at the start, with the inputs that they hang on."""
        places = [k for k, v in enumerate(self.variables) if v.causality == "output"]
        inputs = [k for k, v in enumerate(self.variables) if v.causality == "input"]
        shift = 0 if newer else 1  # FMI 2.0 counts variables from 1
        on = "" if self.source.feeds else ' dependencies=""'
        if self.source.feeds:
            on = f' dependencies="{" ".join(str(k + shift) for k in inputs)}"'
        if newer:
            yield from (f'<Output valueReference="{k}"{on}/>' for k in places)
            yield from (f'<InitialUnknown valueReference="{k}"/>' for k in places)
            return
        unknowns = "".join(f'<Unknown index="{k + shift}"{on}/>' for k in places)
        first = "".join(f'<Unknown index="{k + shift}"/>' for k in places)
        yield f"<Outputs>{unknowns}</Outputs>"
        yield f"<InitialUnknowns>{first}</InitialUnknowns>"


_NO_INDICATORS = ' numberOfEventIndicators="0"'


def _indented(name: str, lines: Iterator[str]) -> list[str]:
    inside = [f"    {line}" for line in lines]
    return [f"  <{name}>", *inside, f"  </{name}>"] if inside else []
