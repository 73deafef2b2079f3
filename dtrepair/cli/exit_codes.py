"""What the exit codes mean: one table, of which each command shows its own."""

from __future__ import annotations

import signal

from dtrepair.pipeline import errors

# Exit code: what it means for any command.
MEANINGS = {
    errors.CLEAN: "done, and clean",
    errors.REMAINING: "intersections remain (or were found, by check), or frames are strained",
    errors.USAGE: "the command line makes no sense",
    errors.INPUT: "input unusable",
    errors.FRAMES: "some frames failed, the rest is written",
    errors.OUTPUT: "output cannot be written",
    errors.ALONE: "frames could not be repaired together, each is written as repaired alone",
    errors.WORKERS: "workers were lost, nothing is written",
    errors.INTERNAL: "internal error",
    128 + signal.SIGINT: "interrupted by Ctrl-C, an older output is intact",
    128 + signal.SIGTERM: "interrupted by SIGTERM, in the same way",
}
# What any command may end with.
_ALWAYS = {errors.USAGE, errors.INTERNAL, 128 + signal.SIGINT, 128 + signal.SIGTERM}


def exit_codes(*codes: int, **words: str) -> str:
    """Return a paragraph about some codes, and those that any command may end with.

    words: what a command says of CLEAN, REMAINING and so on, by these names in lower case.
    """
    own = {getattr(errors, name.upper()): text for name, text in words.items()}
    shown = sorted({*codes, *own, *_ALWAYS})
    listed = "; ".join(f"{code} {own.get(code, MEANINGS[code])}" for code in shown)
    return f"Exit codes: {listed}."
