"""How the poses between keys are looked at and mended."""

from __future__ import annotations

from dataclasses import dataclass

INTERPOLATIONS = ("linear", "cubic")


@dataclass(frozen=True, kw_only=True)
class KeyOptions:
    """How in-betweens are looked at and mended.

    Args:
        samples: in-betweens that are looked at between two keys, evenly spread; frames of the
            input between them are looked at as well.
        extra: most keys added between two given ones.
        keep_keys: given keys are not moved for the sake of an in-between.
        interpolation: "linear" as USD interpolates, or "cubic", a Catmull-Rom spline.
    """

    samples: int = 4
    extra: int = 8
    keep_keys: bool = False
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        """Check the choices."""
        for name, least in (("samples", 1), ("extra", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} should be at least {least}, got {getattr(self, name)}")
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation should be one of {', '.join(INTERPOLATIONS)}, "
                f"got {self.interpolation!r}"
            )
