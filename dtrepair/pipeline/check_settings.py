"""What a check counts: its choices as one object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypedDict

from dtrepair.intersect import MODES
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import (
    PrimTable,
    Selection,
    object_of,
    recorded_tables,
    refuse_unknown,
)

# What a check may do with contacts that were modelled: count them apart, or like all others.
COUNTED_APART = ("auto", "repair")


@dataclass(frozen=True, kw_only=True)
class CheckSettings:
    """What the result of a check depends on, besides its input.

    Args:
        selection: which meshes and frames take part.
        mode: pairs within a mesh ("self"), between meshes ("inter") or both.
        ignore: pairs "A,B" of path expressions whose contacts do not count.
        attach, detach: pairs "A,B" of path expressions whose parts are attached or are not, as
            `ObjectOptions` has them.
        tables: settings of single meshes, of which a check takes what they are attached to.
        rest_contacts: "auto" counts contacts that were modelled apart, "repair" all as one; None:
            "repair" where the selection is strict, else "auto".
        find_worn: look for what a repair would take as worn, too: seconds for many parts; frames
            then list 200 pairs of parts that are modelled instead of 20.

    Raises:
        UsageError: an unknown mode or way to count.
    """

    selection: Selection = field(default_factory=Selection)
    mode: str = "both"
    ignore: tuple[str, ...] = ()
    attach: tuple[str, ...] = ()
    detach: tuple[str, ...] = ()
    tables: tuple[PrimTable, ...] = ()
    rest_contacts: str | None = None
    find_worn: bool = False

    def __post_init__(self) -> None:
        """Refuse an unknown mode or way to count."""
        if self.rest_contacts not in (None, *COUNTED_APART):
            raise UsageError(
                f"--rest-contacts: expected one of {', '.join(COUNTED_APART)}, got "
                f"{self.rest_contacts!r}"
            )
        if self.mode not in MODES:
            raise UsageError(f"--mode: expected one of {', '.join(MODES)}, got {self.mode!r}")

    @property
    def counting(self) -> str:
        """Return one of `COUNTED_APART`: what was chosen, else what the selection asks for."""
        return self.rest_contacts or ("repair" if self.selection.strict else "auto")

    @classmethod
    def from_report(cls, settings: Mapping[str, Any]) -> CheckSettings:
        """Return the settings of a run whose report has these `settings`.

        Raises UsageError for a name that no setting has.
        """
        refuse_unknown(settings, (Selection, CheckSettings), ("objects",))
        own = {name: value for name, value in settings.items() if name != "selection"}
        return replace(
            object_of(cls, own),
            selection=object_of(Selection, settings),
            tables=recorded_tables(settings),
        )


class CheckChoices(TypedDict, total=False):
    """The fields of `CheckSettings`, each of which may be given by name."""

    selection: Selection
    mode: str
    ignore: tuple[str, ...]
    attach: tuple[str, ...]
    detach: tuple[str, ...]
    tables: tuple[PrimTable, ...]
    rest_contacts: str | None
    find_worn: bool
