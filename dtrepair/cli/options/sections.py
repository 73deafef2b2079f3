"""The headings under which the help of a command lists its options."""

from __future__ import annotations

from itertools import takewhile

import click

# Heading: names of parameters, in the order in which they are listed.
SECTIONS = {
    "Selection": "frames prim exclude target_prim samples_only include_invisible include_purposes "
    "skip_varying uninstance strict strict_references",
    "Rest and objects": "rest collider rigid ignore attach detach layer inner_mobility pin "
    "direction mode rest_contacts",
    "Motion": "poses markers match correspondence save_correspondence source_up target_up align "
    "root_scale ground repair",
    "Keys and in-betweens": "samples interpolation extra keep_keys verify_only",
    "Quality": "alone clearance maximum_displacement diffusion tighten at_any_cost effort "
    "skip method",
    "Output": "output before report_paths find_worn count picture screenshot registration "
    "shapes delta normals only_frames skip_existing dry_run",
    "Running": "frame_count chunk distributed resume device jobs config quiet verbose help",
    "Published method (--method paper)": "iterations regularization optimizer energy laplacian "
    "kernel_exponent kernel_power learning_rate brake_band brake_mask",
}
# What no heading names; no option of a command should be there.
OTHER = "Other"
_HEADINGS = {name: heading for heading, names in SECTIONS.items() for name in names.split()}
_PLACES = {name: place for place, name in enumerate(_HEADINGS)}


def heading_of(parameter: click.Parameter) -> str:
    """Return the heading of a parameter."""
    # Its name is another in each version of click.
    return _HEADINGS.get("help" if "--help" in parameter.opts else parameter.name or "", OTHER)


class Command(click.Command):
    """A command whose help lists its options under headings; a long one needs both dashes."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Refuse a long option with one dash: it would be read as short ones, -o nly-frames."""
        known = {name for own in self.get_params(context) for name in own.opts}
        for given in takewhile(lambda own: own != "--", args):
            name = given.partition("=")[0]
            if len(name) > 2 and f"-{name}" in known:
                context.fail(f"No such option: {name} (did you mean -{name}?)")
        return super().parse_args(context, args)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each heading that has options."""
        listed: dict[str, list[tuple[str, str]]] = {}
        options = [own for own in self.get_params(context) if isinstance(own, click.Option)]
        for option in sorted(options, key=lambda own: _PLACES.get(own.name or "", len(_PLACES))):
            if record := option.get_help_record(context):
                listed.setdefault(heading_of(option), []).append(record)
        for heading, records in listed.items():
            with formatter.section(heading):
                formatter.write_dl(records)
