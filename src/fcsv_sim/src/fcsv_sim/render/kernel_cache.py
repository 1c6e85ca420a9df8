# SPDX-License-Identifier: Apache-2.0
"""Keeps numba's on-disk cache honest: it watches only a kernel's own file, not the modules that it inlines."""

from pathlib import Path


def drop_stale(module_file: str, *inlined: str) -> None:
    """Forget the compiled kernels of a module where a module beside it, inlined in it, is newer."""
    here = Path(module_file)
    newest = max((here.parent / f"{name}.py").stat().st_mtime for name in inlined)
    cache = list((here.parent / "__pycache__").glob(f"{here.stem}.*.nb[ic]"))
    if cache and min(p.stat().st_mtime for p in cache) < newest:
        for path in cache:
            path.unlink(missing_ok=True)
