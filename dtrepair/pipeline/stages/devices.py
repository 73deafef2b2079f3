"""Where a run computes."""

from __future__ import annotations

from dtrepair.pipeline.errors import UsageError


def use_device(name: str) -> str:
    """Return the device that a --device option names; a usage error if it is not there."""
    from dtrepair.device import resolve_device

    try:
        return resolve_device(name)
    except ValueError as error:
        raise UsageError(f"--device: {error}") from None


def device_of_method(name: str, method: str) -> tuple[str, list[str]]:
    """Return where a method runs for the name of a device, and warnings."""
    if method != "full":
        return use_device(name), []
    if name == "auto" or use_device(name) == "cpu":
        return "cpu", []
    # Only counting there would cost the processes that the frames are shared out to.
    return "cpu", [
        f"--device {name}: the default method runs on the CPU (--method paper runs on the GPU)"
    ]
