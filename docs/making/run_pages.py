"""Runs what the guide tells people to type, page by page, each in a new folder.

    python -m docs.making.run_pages [PAGE ...]

Blocks marked `sh` and `python` are run in their order; `bash` marks what needs a cluster, a display
or the reader's own files. A command may end with 1: something is left, or was found.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "guide"


def commands(page: Path) -> list[list[str]]:
    """What a page runs, in its order: commands as words."""
    found: list[list[str]] = []
    text = page.read_text(encoding="utf-8")
    for kind, block in re.findall(r"^```(sh|python)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if kind == "python":
            found.append([sys.executable, "-c", block])
            continue
        for line in block.splitlines():
            name, *arguments = shlex.split(line, comments=True)
            words = ["-m", name] if name == "dtrepair" else []
            found.append([sys.executable, *words, *arguments])
    return found


def run(page: Path) -> bool:
    """Run a page in a folder that holds the examples; tell what ended otherwise than it should."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "examples", Path(folder) / "examples")
        for command in commands(page):
            environment = {**os.environ, "PYTHONPATH": str(ROOT)}
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True
            )
            shown = shlex.join(command[1:])[:100].split("\n")[0]
            print(f"  {done.returncode}  {shown}", flush=True)
            if done.returncode not in ((0, 1) if "-m" in command else (0,)):
                print(done.stdout[-2000:], done.stderr[-2000:])
                return False
    return True


def main() -> None:
    """Run the pages that are named, or all of them."""
    failed = []
    for page in [Path(name) for name in sys.argv[1:]] or sorted(GUIDE.glob("*.md")):
        print(page.name, flush=True)
        failed += [] if run(page) else [page.name]
    raise SystemExit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
