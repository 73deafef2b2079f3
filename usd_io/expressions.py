"""Which prims of a stage a path expression matches, and which one that matches none may mean."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from pxr import Sdf, Tf, Usd

from usd_io.errors import SelectionError, one_line

# A traversal that visits instance proxies too.
EVERYWHERE = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)

# Lives on the session layer while an expression is evaluated.
_HELPER = "/__usd_io_selection"

# A name of a connected part, or what was meant as one: a second word would be a second prim.
_PART = re.compile(r"\s+parts?(?![a-z_])[^/]*", re.IGNORECASE)


def matching_paths(stage: Usd.Stage, expression: str, *, below: bool = False) -> set[Sdf.Path]:
    """Return the paths of all prims, instance proxies too, that an expression matches.

    A relative expression starts at the root: `hero//` is `/hero//`. below: what lies below a prim
    that a pattern matches is matched, too, so that `/hero - /hero/hat` is `/hero// - /hero/hat//`.

    Raises:
        SelectionError: the expression is ill-formed.
    """
    if not expression.isascii():
        raise SelectionError(
            f"prim expression {expression!r}: takes ASCII characters only; write * for the others, "
            f"such as {re.sub('[^ -~]+', '*', expression)!r}"
        )
    if named := _PART.search(expression):
        raise SelectionError(
            f"prim expression {expression!r}: expected prims, and {named[0].strip()!r} names none; "
            'a part of a mesh is written "/path/of/mesh part 3", for --attach and --detach only; '
            "for a layer its faces have primvars:dtrepair:layer"
        )
    try:
        parsed = Sdf.PathExpression(expression).MakeAbsolute(Sdf.Path.absoluteRootPath)
        if parsed.IsEmpty():
            raise SelectionError("the prim expression is empty; try '//{isa:Mesh}' or a prim path")
        if below:
            parsed = _with_descendants(parsed)
        session = stage.GetSessionLayer()
        with Usd.EditContext(stage, session):
            helper = stage.DefinePrim(_HELPER)
            try:
                collection = Usd.CollectionAPI.Apply(helper, "selection")
                collection.CreateMembershipExpressionAttr().Set(parsed)
                matches = Usd.CollectionAPI.ComputeIncludedObjects(
                    collection.ComputeMembershipQuery(), stage, EVERYWHERE
                )
                return {item.GetPath() for item in matches if item.GetPath() != Sdf.Path(_HELPER)}
            finally:
                stage.RemovePrim(_HELPER)
    except Tf.ErrorException as error:
        raise SelectionError(
            f"prim expression {expression!r}: {one_line(error)}; try '/path/of/prim//' or "
            "'//{isa:Mesh} - /hero//'"
        ) from None


def union_terms(expression: str) -> list[str]:
    """Return A, B, ... of "(A) + (B) + ...", what an option that is given several times makes.

    Nothing of any other expression, which is one term.
    """
    terms = expression.strip().removeprefix("(").removesuffix(")").split(") + (")
    whole = all(term.count("(") == term.count(")") for term in terms)
    return terms if whole and len(terms) > 1 else []


def meant(stage: Usd.Stage, expression: str, paths: Sequence[str]) -> str:
    """Return which of the paths a plain path that is not on the stage may mean, as a question.

    Or "": names differ by a letter or two, as many as parents.
    """
    typed = expression.strip().removesuffix("//")
    path = Sdf.Path(typed) if Sdf.Path.IsValidPathString(typed) else Sdf.Path()
    if not path.IsAbsolutePath() or stage.GetPrimAtPath(path):
        return ""
    depth = path.pathElementCount
    prefixes = dict.fromkeys(
        above for own in paths for above in Sdf.Path(own).GetPrefixes()[depth - 1 : depth]
    )
    names = str(path).split("/")[1:]
    for near in prefixes:
        pairs = zip(names, str(near).split("/")[1:], strict=True)
        if all(get_close_matches(one.lower(), [own.lower()], cutoff=0.75) for one, own in pairs):
            return f"; is {near}{'' if str(near) in paths else '//'} meant?"
    return ""


def _with_descendants(expression: Sdf.PathExpression) -> Sdf.PathExpression:
    """Return an expression each of whose patterns matches what lies below its prims, too."""
    make = Sdf.PathExpression
    operands: list[Sdf.PathExpression] = []

    def operator(operation: Sdf.PathExpression.Op, known: int) -> None:
        """Join the operands of an operation as soon as all of them are known."""
        if operation == make.Complement and known == 1:
            operands.append(make.MakeComplement(operands.pop()))
        elif known == 2:
            last = operands.pop()
            operands.append(make.MakeOp(operation, operands.pop(), last))

    def pattern(own: Sdf.PathPattern) -> None:
        operands.append(make.MakeAtom(own.AppendStretchIfPossible()))

    expression.Walk(operator, lambda reference: operands.append(make.MakeAtom(reference)), pattern)
    return operands.pop()
