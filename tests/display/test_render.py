"""Pictures: nearest surface wins, red where triangles intersect, blue behind, right way up."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.render import View, best_view, make_view, render, save_pictures

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)


def straight(*poses: NDArray[np.float64], **options: Any) -> View:
    return make_view(poses, azimuth=0, elevation=0, **options)


def kinds(image: NDArray[np.uint8]) -> dict[str, float]:
    """Split pixels into surface, red, blue and background, as fractions."""
    pixels = image.reshape(-1, 3).astype(int)
    back = (pixels == (250, 250, 252)).all(axis=1)
    red = (pixels[:, 0] > 2 * pixels[:, 1]) & ~back
    blue = (pixels[:, 2] > pixels[:, 0] + 40) & ~back
    return {
        "background": back.mean(),
        "red": red.mean(),
        "blue": blue.mean(),
        "surface": (~back & ~red & ~blue).mean(),
    }


def test_area_of_a_square_is_exact() -> None:
    image = render(SQUARE, FACES, view=straight(SQUARE), size=106)
    assert image.shape == (106, 106, 3) and image.dtype == np.uint8
    # The view leaves 3 % of the half size free: the square covers 1 / 1.06 of the width.
    assert kinds(image)["surface"] == pytest.approx(1 / 1.06**2, abs=0.002)


def test_intersecting_triangles_are_red() -> None:
    image = render(
        SQUARE, FACES, view=straight(SQUARE), size=106, intersecting=np.array([True, False])
    )
    found = kinds(image)
    assert found["red"] == pytest.approx(found["surface"], rel=0.05)
    # (0, 1, 2) is the lower right one.
    assert kinds(image[90:91, 90:91])["red"] == 1
    assert kinds(image[15:16, 15:16])["red"] == 0


def test_modelled_contacts_are_paler_than_faults() -> None:
    view, one, both = straight(SQUARE), np.array([True, False]), np.array([True, True])
    found = kinds(render(SQUARE, FACES, view=view, size=106, intersecting=one, modelled=both))
    plain = render(SQUARE, FACES, view=view, size=106)
    image = render(SQUARE, FACES, view=view, size=106, modelled=both)
    # What counts is red even so; the rest is bluer than a surface.
    assert found["red"] == pytest.approx(found["surface"], rel=0.05)
    assert image[53, 53, 2] > plain[53, 53, 2] and image[53, 53, 2] > image[53, 53, 0]


def test_back_faces_are_blue() -> None:
    image = render(SQUARE, FACES[:, ::-1], view=straight(SQUARE), size=64)
    assert kinds(image)["blue"] > 0.8 and kinds(image)["surface"] < 0.05


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearest_surface_hides_the_other(order: int) -> None:
    points = np.concatenate([SQUARE, SQUARE * 0.5 + (0, 0, 1)])
    faces = np.concatenate([FACES, FACES + 4])[::order]
    mask = faces.min(axis=1) >= 4
    image = render(points, faces, view=straight(points), size=106, intersecting=mask)
    assert kinds(image)["red"] == pytest.approx(0.25 / 1.06**2, abs=0.01)


def test_a_hidden_surface_is_not_drawn() -> None:
    points = np.concatenate([SQUARE, SQUARE * 0.5 - (0, 0, 1)])
    faces = np.concatenate([FACES, FACES + 4])
    mask = faces.min(axis=1) >= 4
    image = render(points, faces, view=straight(points), size=64, intersecting=mask)
    assert kinds(image)["red"] == 0


@pytest.mark.parametrize(("up", "front"), [((0, 1, 0), (0, 0, 1)), ((0, 0, 1), (0, -1, 0))])
def test_up_is_up_and_the_front_faces_the_viewer(up: Any, front: Any) -> None:
    view = straight(SQUARE, up=up)
    assert np.allclose(view.rotation @ up, [0, 1, 0])
    assert np.allclose(view.rotation @ front, [0, 0, 1])
    turned = make_view([SQUARE], up=up, azimuth=37, elevation=20).rotation
    assert np.allclose(turned @ turned.T, np.eye(3))
    assert np.linalg.det(turned) == pytest.approx(1)


def test_best_view_looks_at_the_intersection() -> None:
    # Two squares back to back: the marked one looks away from the usual view.
    points = np.concatenate([SQUARE, SQUARE - (0, 0, 0.1)])
    faces = np.concatenate([FACES, FACES[:, ::-1] + 4]).astype(np.int32)
    marked = np.array([False, False, True, True])
    view = best_view(points, faces, marked)
    assert view.rotation[2, 2] < 0
    assert kinds(render(points, faces, view=view, size=64, intersecting=marked))["red"] > 0.1
    nothing = np.zeros(4, dtype=bool)
    assert np.array_equal(best_view(points, faces, nothing).rotation, make_view([points]).rotation)


def test_degenerate_and_distant_triangles_do_not_disturb() -> None:
    points = np.concatenate([SQUARE, SQUARE[:1], [[50, 50, 0]]])
    faces = np.concatenate([FACES, [[0, 0, 1], [0, 4, 1]]]).astype(np.int32)
    with_them = render(points, faces, view=straight(SQUARE), size=64)
    assert np.array_equal(with_them, render(SQUARE, FACES, view=straight(SQUARE), size=64))


def test_saved_file_holds_all_pictures_and_captions(tmp_path: Path) -> None:
    from PIL import Image

    image = render(SQUARE, FACES, view=straight(SQUARE), size=100)
    save_pictures(tmp_path / "a.png", [image, image], captions=["before: 7", "after: 0"])
    with Image.open(tmp_path / "a.png") as read:
        pixels = np.asarray(read.convert("RGB"))
    assert pixels.shape == (126, 200, 3)
    assert np.array_equal(pixels[:100, :100], image)
    assert pixels[100:].min() < 120  # something is written there
    save_pictures(tmp_path / "b.png", [image] * 4, columns=2)
    with Image.open(tmp_path / "b.png") as read:
        assert read.size == (200, 200)


def test_without_pillow_the_error_names_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    image = render(SQUARE, FACES, view=straight(SQUARE), size=16)
    with pytest.raises(ImportError, match="pip install pillow"):
        save_pictures(tmp_path / "a.png", [image])
    assert not (tmp_path / "a.png").exists()


def test_long_captions_are_written_smaller(tmp_path: Path) -> None:
    from PIL import Image

    images = [np.full((200, 200, 3), 250, dtype=np.uint8)]
    for length in (10, 30):
        save_pictures(tmp_path / "p.png", images, captions=["M" * length])
        with Image.open(tmp_path / "p.png") as sheet:
            band = np.asarray(sheet.convert("L"))[200:]
        columns = np.flatnonzero((band < 200).any(axis=0))
        assert columns[0] > 1 and columns[-1] < 198
