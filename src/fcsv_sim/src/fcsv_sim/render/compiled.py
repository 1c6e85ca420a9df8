# SPDX-License-Identifier: Apache-2.0
"""How the renderer's functions are compiled, and when their cache is renewed: numba watches only a
kernel's own file, not the modules that it inlines."""

from pathlib import Path

from numba import njit

#: Division as the processor does it: checking each for zero costs a fifth of a kernel's time.
#: Fast arithmetic, except that NaN (no depth) and infinity (no hit) keep their meaning.
_OPTIONS = {"fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}, "error_model": "numpy"}
function = njit(**_OPTIONS)
inlined = njit(inline="always", **_OPTIONS)
kernel = njit(nogil=True, cache=True, **_OPTIONS)


def drop_stale(module_file: str, *inlined: str) -> None:
    """Forget the compiled kernels of a module where a module beside it, inlined in it, is newer."""
    here = Path(module_file)
    newest = max((here.parent / f"{name}.py").stat().st_mtime for name in inlined)
    cache = list((here.parent / "__pycache__").glob(f"{here.stem}.*.nb[ic]"))
    if cache and min(p.stat().st_mtime for p in cache) < newest:
        for path in cache:
            path.unlink(missing_ok=True)
