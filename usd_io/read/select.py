"""Which meshes of a stage take part: prim expressions, visibility, purpose, instances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from pxr import Sdf, Usd, UsdGeom

from usd_io.errors import SelectionError, StageError
from usd_io.expressions import EVERYWHERE, matching_paths, meant, union_terms

# What renders as a surface and is no mesh.
_SHAPES = {
    *("Sphere", "Cube", "Cone", "Cylinder", "Cylinder_1", "Capsule", "Capsule_1", "Plane"),
    *("NurbsPatch", "TetMesh"),
}


@dataclass(frozen=True)
class Candidate:
    """A mesh prim to read.

    Attributes:
        prim: the prim.
        explicit: the user named exactly this path.
        uninstanced: instances that were expanded to reach it.
    """

    prim: Usd.Prim
    explicit: bool
    uninstanced: tuple[str, ...]


def select_prims(
    stage: Usd.Stage,
    *,
    prim: str | None,
    exclude: str | None,
    include_invisible: bool,
    include_purposes: bool,
    uninstance: bool,
    instances: bool = False,
) -> tuple[list[Candidate], list[str]]:
    """Return mesh prims in the order of traversal, and warnings about the skipped ones.

    See `usd_io.read_meshes` for the arguments and errors.
    """
    expanded: list[str] = []
    matched = _matching_meshes(stage, prim, exclude)
    while uninstance and any(mesh.IsInstanceProxy() for mesh in matched):
        expanded.extend(_expand(stage, matched))
        matched = _matching_meshes(stage, prim, exclude)
    if not matched:
        raise _no_match(stage, prim, exclude)
    for term in union_terms(prim or ""):
        if not _matching_meshes(stage, term, None):
            raise _no_match(stage, term, None)
    prototypes = _prototype_roots(stage)
    warnings = _idle_excludes(stage, exclude, matched)
    candidates = []
    for mesh in matched:
        reason = _skip_reason(mesh, prototypes, include_invisible, include_purposes)
        if reason:
            warnings.append(f"{mesh.GetPath()}: {reason}; skipped")
            continue
        path = str(mesh.GetPath())
        above = tuple(root for root in expanded if path.startswith(f"{root}/"))
        candidates.append(Candidate(mesh, prim is not None and prim.strip() == path, above))
    if not candidates:
        error = StageError if prim is None else SelectionError
        raise error(f"no usable mesh: {'; '.join(warnings)}")
    locked = [own.prim for own in candidates if own.prim.IsInstanceProxy()]
    if locked and not instances:
        raise StageError(
            f"{_locked(locked[0])}; take it with --uninstance, or leave it out with --exclude"
        )
    if locked:
        others = len(locked) - 1
        more = f" (and {others} more {'mesh' if others == 1 else 'meshes'})" if others else ""
        warnings.append(
            f"{_locked(locked[0])}{more}; it is left as it is; --uninstance lets it change"
        )
    return candidates, warnings


def select_shapes(
    stage: Usd.Stage,
    *,
    prim: str | None,
    exclude: str | None,
    include_invisible: bool,
    include_purposes: bool,
) -> list[str]:
    """Return spheres, cubes and the like that would be selected if they were meshes.

    Each as its path and type, such as "/Set/Ball (Sphere)", in the order of traversal. See
    `usd_io.read_meshes` for the arguments.
    """
    found = _matching(stage, prim, exclude, _is_shape)
    prototypes = _prototype_roots(stage) if found else []
    return [
        _named(item)
        for item in found
        if not _skip_reason(item, prototypes, include_invisible, include_purposes)
    ]


def _matching_meshes(stage: Usd.Stage, prim: str | None, exclude: str | None) -> list[Usd.Prim]:
    """Return the mesh prims that an expression matches and another does not exclude."""
    return _matching(stage, prim, exclude, _is_mesh)


def _idle_excludes(stage: Usd.Stage, exclude: str | None, meshes: Sequence[Usd.Prim]) -> list[str]:
    """Return a warning for each term of an exclusion that leaves out no mesh of the stage."""
    if exclude is None:
        return []
    paths = [str(mesh.GetPath()) for mesh in meshes]
    surfaces = {prim.GetPath() for prim in stage.Traverse(EVERYWHERE) if _is_surface(prim)}
    warnings = []
    for term in union_terms(exclude) or [exclude.strip()]:
        matched = matching_paths(stage, term, below=True)
        if not matched:
            reason = "matches no prim, and leaves nothing out" + meant(stage, term, paths)
        elif matched.isdisjoint(surfaces):
            first = stage.GetPrimAtPath(min(matched).GetPrimPath())
            reason = f"matches {_named(first)}, where no mesh is, and leaves nothing out"
        else:
            continue
        warnings.append(f"exclude {term}: {reason}")
    return warnings


def _is_surface(prim: Usd.Prim) -> bool:
    return _is_mesh(prim) or _is_shape(prim)


def _is_mesh(prim: Usd.Prim) -> bool:
    return bool(prim.IsA(UsdGeom.Mesh))


def _is_shape(prim: Usd.Prim) -> bool:
    return prim.GetTypeName() in _SHAPES


def _named(prim: Usd.Prim) -> str:
    return f"{prim.GetPath()} ({prim.GetTypeName() or 'untyped'})"


def _matching(
    stage: Usd.Stage, prim: str | None, exclude: str | None, kind: Callable[[Usd.Prim], bool]
) -> list[Usd.Prim]:
    """Return the prims of a kind that an expression matches and another does not exclude."""
    # Of a stage that has none no expression needs to be evaluated.
    items = [item for item in stage.Traverse(EVERYWHERE) if kind(item)]
    if not items:
        return []
    included = None if prim is None else matching_paths(stage, prim)
    excluded = set() if exclude is None else matching_paths(stage, exclude, below=True)
    return [
        item
        for item in items
        if (included is None or item.GetPath() in included) and item.GetPath() not in excluded
    ]


def _no_match(stage: Usd.Stage, prim: str | None, exclude: str | None) -> Exception:
    """Return the error for an expression that matches no mesh."""
    if prim is None:
        broken = stage.GetCompositionErrors()
        shapes = _matching(stage, None, exclude, _is_shape)
        return StageError(
            "the stage has no active, defined and loaded mesh"
            + ("" if exclude is None else f" besides those excluded by {exclude!r}")
            + (f"; convert {_named(shapes[0])} to one" if shapes else "")
            + (f"; mend its broken reference: {' '.join(str(broken[0]).split())}" if broken else "")
        )
    matched = sorted(matching_paths(stage, prim))
    if matched and exclude is None:
        first = stage.GetPrimAtPath(matched[0])
        cure = f"try '{matched[0]}//' for the meshes below it"
        if first.GetTypeName() in _SHAPES:
            cure = "convert it to a mesh"
        return SelectionError(
            f"prim expression {prim!r}: no match among meshes; {matched[0]} is "
            f"{first.GetTypeName() or 'untyped'}; {cure}"
        )
    return SelectionError(
        f"prim expression {prim!r}: no match among the active, defined and loaded meshes"
        + ("" if exclude is None else f" that {exclude!r} does not exclude")
        + _examples(meshes := _matching_meshes(stage, None, exclude))
        + meant(stage, prim, [str(mesh.GetPath()) for mesh in meshes])
    )


def _examples(meshes: Sequence[Usd.Prim], named: int = 3) -> str:
    """Say which meshes there are, the first of them by name."""
    if not meshes:
        return "; the stage has none"
    more = f" and {len(meshes) - named} more" if len(meshes) > named else ""
    return f"; the stage has {', '.join(str(mesh.GetPath()) for mesh in meshes[:named])}{more}"


def _instance_of(prim: Usd.Prim) -> Usd.Prim:
    """Return the outermost instance above an instance proxy."""
    while prim.IsInstanceProxy():
        prim = prim.GetParent()
    return prim


def _locked(mesh: Usd.Prim) -> str:
    """Say that a mesh cannot be changed."""
    instance = _instance_of(mesh).GetPath()
    return f"{mesh.GetPath()}: lies in the instance {instance}, where changes have no effect"


def _expand(stage: Usd.Stage, meshes: Iterable[Usd.Prim]) -> list[str]:
    """Make the instances above the given proxies plain prims, on the session layer."""
    roots = {str(_instance_of(mesh).GetPath()) for mesh in meshes if mesh.IsInstanceProxy()}
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for root in roots:
            stage.GetPrimAtPath(root).SetInstanceable(False)
    return sorted(roots)


def _prototype_roots(stage: Usd.Stage) -> list[Sdf.Path]:
    """Return the point instancers and the roots of their prototypes."""
    roots = []
    for prim in stage.Traverse(EVERYWHERE):
        if prim.IsA(UsdGeom.PointInstancer):
            roots.append(prim.GetPath())
            roots.extend(UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets())
    return roots


def _skip_reason(
    mesh: Usd.Prim,
    prototypes: list[Sdf.Path],
    include_invisible: bool,
    include_purposes: bool,
) -> str:
    """Return why a mesh takes no part; "" if it does."""
    if any(mesh.GetPath().HasPrefix(root) for root in prototypes):
        return "prototype of a point instancer"
    if not include_invisible and not _ever_visible(mesh):
        return "invisible (--include-invisible takes it)"
    purpose = UsdGeom.Imageable(mesh).ComputePurpose()
    if not include_purposes and purpose not in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render):
        return f"purpose {purpose} (--include-purposes takes it)"
    return ""


def visibility_times(prim: Usd.Prim) -> set[float]:
    """Return the time codes of samples of the visibility of a prim and those above it."""
    times: set[float] = set()
    while prim and not prim.IsPseudoRoot():
        imageable = UsdGeom.Imageable(prim)
        if imageable:
            times.update(imageable.GetVisibilityAttr().GetTimeSamples())
        prim = prim.GetParent()
    return times


def _ever_visible(mesh: Usd.Prim) -> bool:
    """Return whether the mesh is visible at any sample of the visibility on its chain."""
    codes = [Usd.TimeCode(time) for time in sorted(visibility_times(mesh))] or [
        Usd.TimeCode.Default()
    ]
    return any(
        UsdGeom.Imageable(mesh).ComputeVisibility(code) != UsdGeom.Tokens.invisible
        for code in codes
    )
