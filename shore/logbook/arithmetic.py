"""Floating-point environment of a run: what decides the last bits of its estimates, as a log names it.

Linear algebra (BLAS) sums in the order of its kernel, which it chooses by the processor, and the C library (libm) and
numpy choose their functions by it too. Equal names are expected to give equal bits.
"""

import ctypes
import math
import platform
from array import array
from hashlib import blake2b
from importlib import import_module
from importlib.metadata import version
from typing import Any, Final

Arithmetic = dict[str, str]

WORDS: Final = {
    "machine": "machine",
    "libm": "C library",
    "libm_results": "results of the C library",
    "python": "Python",
    "numpy": "numpy",
    "blas": "BLAS",
    "kernel": "BLAS kernel",
    "cpu": "CPU features",
}
"""Names of an arithmetic, and what a person calls each."""
VERSIONS: Final = ("python", "numpy")
"""Those that a session record holds among its `versions`."""
_OPENBLAS_NAMES: Final = ("scipy_openblas_{}64_", "openblas_{}64_", "scipy_openblas_{}", "openblas_{}")
"""Names of OpenBLAS's functions in numpy's wheels (64-bit integers) and in distributions."""
NOT_KNOWN: Final = "not known"


def arithmetic_here() -> Arithmetic:
    """Names of the arithmetic of this process; what cannot be found out is `not known`.

    kernel: what OpenBLAS uses now, the processor's or that of OPENBLAS_CORETYPE. cpu: what numpy was built for and
    found here, without NPY_DISABLE_CPU_FEATURES.
    """
    blas, kernel = _blas()
    libm = " ".join(platform.libc_ver()).strip() or f"{platform.system()} {platform.release()}"
    return {
        "machine": platform.machine(),
        "libm": libm,
        "libm_results": _libm_results(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "blas": blas,
        "kernel": kernel,
        "cpu": _cpu_features(),
    }


def arithmetic_of(start: dict[str, Any]) -> Arithmetic | None:
    """The arithmetic that a `start` of `/session` names; `None` when it names none (older logs)."""
    named, versions = start.get("arithmetic"), start.get("versions")
    if not isinstance(named, dict) or not isinstance(versions, dict):
        return None
    whole = {**named, **{name: versions.get(name) for name in VERSIONS}}
    return {name: str(whole.get(name, NOT_KNOWN)) for name in WORDS}


def unlike(recorded: Arithmetic | None, here: Arithmetic) -> str | None:
    """What is to be said of something made with `recorded`, without its subject; `None` when that is ours."""
    if recorded is None:
        return "does not name the arithmetic it was made with"
    words = [
        f"{word} {recorded[name]} (here {here[name]})" for name, word in WORDS.items() if recorded[name] != here[name]
    ]
    return f"was made with another arithmetic, {', '.join(words)}" if words else None


def _libm_results() -> str:
    """Digest of what the C library computes at fixed places (3 ms).

    It chooses its functions by the processor (glibc: with FMA or without) and says nowhere which; they differ in the
    last bit at one place in a thousand.
    """
    places = [place / 1000.0 for place in range(1, 10_000)]
    results = array("d", (function(place) for function in (math.sin, math.cos, math.exp, math.log) for place in places))
    return blake2b(results.tobytes(), digest_size=4).hexdigest()


def _blas() -> tuple[str, str]:
    """Version and kernel of the BLAS that numpy has loaded."""
    from numpy.linalg import _umath_linalg  # `wayfix log name` needs no numpy

    # The symbols of what numpy's own module was linked with are found through its handle, wherever that library lies.
    try:
        library = ctypes.CDLL(_umath_linalg.__file__)
    except OSError:  # no answer must not cost the run
        return _built_with(), NOT_KNOWN
    for name in _OPENBLAS_NAMES:
        try:
            config, kernel = library[name.format("get_config")], library[name.format("get_corename")]
        except AttributeError:
            continue
        config.restype = kernel.restype = ctypes.c_char_p
        return " ".join(config().decode().split()[:2]), kernel().decode()
    return _built_with(), NOT_KNOWN


def _built_with() -> str:
    """The BLAS that numpy was built with, where it is no OpenBLAS."""
    import numpy as np

    try:
        blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    except (TypeError, LookupError):  # numpy before 1.25 only prints
        return NOT_KNOWN
    return f"{blas.get('name')} {blas.get('version')}"


def _cpu_features() -> str:
    """The instruction sets that numpy's own functions use here."""
    try:
        core = import_module("numpy._core._multiarray_umath")
    except ImportError:  # numpy 1
        core = import_module("numpy.core._multiarray_umath")
    found = core.__cpu_features__
    return " ".join(name for name in (*core.__cpu_baseline__, *core.__cpu_dispatch__) if found.get(name))
