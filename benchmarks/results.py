"""Keeps what a benchmark printed, and makes results.md of all that was kept.

    python -m benchmarks.results run NAME [ARGUMENT ...] [--keep AS] [--title TITLE]
    python -m benchmarks.results render [--check]

`run` runs `python -m benchmarks.NAME ARGUMENT ...`, shows what it prints, and keeps its tables and
sentences in results/AS.json (default: NAME) with the date, the commit, the machine and the command.
`render` writes results.md from all files; with `--check` it writes nothing, and exits with 1 where
results.md is not what they give.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import subprocess
import sys
import textwrap
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

HERE = Path(__file__).parent
FOLDER, PAGE = HERE / "results", HERE / "results.md"
# Variables that change what a benchmark measures are part of its command.
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Block:
    """A paragraph, or a table if it has columns."""

    text: str = ""
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True)
class Result:
    """What one command measured."""

    title: str
    command: str
    date: str
    commit: str
    machine: str
    blocks: tuple[Block, ...]


def blocks_of(printed: str) -> tuple[Block, ...]:
    """Paragraphs and Markdown tables of what a benchmark printed, in order."""
    found: list[Block] = []
    for paragraph in printed.strip().split("\n\n"):
        lines = paragraph.splitlines()
        table = [line for line in lines if line.startswith("|")]
        text = " ".join(line.strip() for line in lines if not line.startswith("|"))
        if text:
            found.append(Block(text=text))
        if len(table) > 1:
            cells = [tuple(cell.strip() for cell in row.split("|")[1:-1]) for row in table]
            found.append(Block(columns=cells[0], rows=tuple(cells[2:])))
    return tuple(found)


def read_result(path: Path) -> Result:
    """The result in a file."""
    content = json.loads(path.read_text(encoding="utf-8"))
    blocks = [
        Block(
            text=block.get("text", ""),
            columns=tuple(block.get("columns", ())),
            rows=tuple(tuple(row) for row in block.get("rows", ())),
        )
        for block in content.pop("blocks")
    ]
    return Result(**content, blocks=tuple(blocks))


def write_result(path: Path, result: Result) -> None:
    """Write a result as JSON, a row of a table on a line."""
    head = {name: value for name, value in asdict(result).items() if name != "blocks"}
    parts = []
    for block in result.blocks:
        if block.columns:
            rows = ",\n".join(f"    {json.dumps(row, ensure_ascii=False)}" for row in block.rows)
            columns = json.dumps(block.columns, ensure_ascii=False)
            parts.append(f'  {{"columns": {columns}, "rows": [\n{rows}]}}')
        else:
            parts.append(f'  {{"text": {json.dumps(block.text, ensure_ascii=False)}}}')
    top = json.dumps(head, ensure_ascii=False, indent=1)[:-2]
    path.write_text(f'{top},\n "blocks": [\n' + ",\n".join(parts) + "]\n}\n", encoding="utf-8")


def page(results: dict[str, Result]) -> str:
    """The Markdown of results.md."""
    lines = [
        "# Results",
        "",
        "Made by `python -m benchmarks.results render` from `results/*.json`; do not edit. The",
        "date and the commit are those of the measurement.",
    ]
    for name, result in sorted(results.items()):
        lines += ["", f"## {name}: {result.title}", "", f"    {result.command}", ""]
        lines.append(f"{result.date}, commit {result.commit}; {result.machine}.")
        for block in result.blocks:
            lines += ["", *_markdown(block)]
    return "\n".join(lines) + "\n"


def _markdown(block: Block) -> list[str]:
    if not block.columns:
        return textwrap.wrap(block.text, 100, break_long_words=False, break_on_hyphens=False)
    rows = [block.columns, ("---",) * len(block.columns), *block.rows]
    return [f"| {' | '.join(row)} |" for row in rows]


def run(name: str, arguments: list[str], title: str | None) -> Result:
    """Run a benchmark; SystemExit with its code if it fails: 1 says that a bar is missed only."""
    command = [sys.executable, "-m", f"benchmarks.{name}", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        printed = []
        for line in process.stdout:
            print(line, end="", flush=True)
            printed.append(line)
    if process.returncode not in (0, 1):
        raise SystemExit(process.returncode)

    set_here = [
        f"{variable}={os.environ[variable]}" for variable in VARIABLES if variable in os.environ
    ]
    # Paths of this machine are not kept.
    named = ["DIR" if os.path.isabs(given) else shlex.quote(given) for given in arguments]
    shown = [*set_here, "python", "-m", f"benchmarks.{name}", *named]
    return Result(
        title=title or _first_line(name),
        command=" ".join(shown),
        date=datetime.now(UTC).date().isoformat(),
        commit=_commit(),
        machine=_machine(),
        blocks=blocks_of("".join(printed)),
    )


def _first_line(name: str) -> str:
    """The first line of a benchmark's text, without its full stop."""
    text = (HERE / f"{name}.py").read_text(encoding="utf-8")
    return text.split('"""')[1].splitlines()[0].rstrip(".")


def _commit() -> str:
    """The commit that is checked out, with a plus if files differ from it."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=HERE, capture_output=True, text=True, check=True
        ).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "..")
    return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")


def _machine() -> str:
    """The processor and how many there are."""
    name = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        models = [line for line in information.read_text().splitlines() if "model name" in line]
        name = models[0].partition(":")[2].strip() if models else name
    return f"{name}, {os.cpu_count()} processors, Python {platform.python_version()}"


def main() -> int:
    """Run a benchmark and keep its figures, or render the page; 1 where --check finds it old."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run", help="run a benchmark and keep what it prints")
    running.add_argument("--keep", metavar="AS", help="name of the file of figures")
    running.add_argument("--title", help="what was measured")
    running.add_argument("name")
    running.add_argument("arguments", nargs=argparse.REMAINDER)
    rendering = commands.add_parser("render", help="write results.md")
    rendering.add_argument("--check", action="store_true", help="only look whether it is new")
    given = parser.parse_args()
    if given.command == "run":
        found = run(given.name, given.arguments, given.title)
        FOLDER.mkdir(exist_ok=True)
        write_result(FOLDER / f"{given.keep or given.name}.json", found)
    new = page({path.stem: read_result(path) for path in sorted(FOLDER.glob("*.json"))})
    if given.command == "render" and given.check:
        return int(new != PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
