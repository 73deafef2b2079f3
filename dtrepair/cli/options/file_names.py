"""Values that name files, for the completion of shells."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem


class FileName(click.types.StringParamType):
    """Text as it is, which a shell completes to the name of a file."""

    def shell_complete(
        self, context: click.Context, parameter: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Leave the completion to the shell, which knows the files."""
        return [CompletionItem(incomplete, type="file")]


FILE = FileName()
