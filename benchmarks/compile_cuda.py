"""Compiles all Warp kernels for a GPU ahead of time; needs neither a GPU nor a driver.

    python benchmarks/compile_cuda.py [--arch 90]

Exit code 1 when a kernel does not compile.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import tempfile
import time
from pathlib import Path

import dtrepair
from dtrepair.device import start_warp

PACKAGE = Path(dtrepair.__path__[0])


def kernel_modules() -> list[str]:
    """Names of the modules that hold kernels: those in files named `*kernels.py`."""
    return [
        ".".join(("dtrepair", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in sorted(PACKAGE.rglob("*kernels.py"))
    ]


def compile_module(name: str, arch: int, folder: Path) -> list[Path]:
    """Compile one module to machine code of compute capability `arch`; the files written."""
    warp = start_warp()
    files: list[Path] = warp.compile_aot_module(
        importlib.import_module(name), arch=arch, module_dir=folder, use_ptx=False
    )
    return files


def main() -> int:
    """Compile every module and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arch", type=int, default=90, help="compute capability, 90 is H100/H200")
    arch = parser.parse_args().arch
    failed = 0
    for name in kernel_modules():
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            try:
                files = compile_module(name, arch, Path(folder))
                size = sum(path.stat().st_size for path in files)
                outcome = f"{size} bytes in {time.perf_counter() - start:.1f} s"
            except Exception as error:  # the compiler raises plain exceptions
                failed += 1
                outcome = f"FAILED: {error}"
        print(f"{name}, sm_{arch}: {outcome}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
