"""What builds the documentation finds what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.making import check_links, run_pages, stages
from docs.making.pictures import DRAWINGS, FOLDER, cropped, differ
from dtrepair.pipeline import repair_stage


def test_broken_links_of_a_site_are_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = '<a href="other.html#here">x</a> <a href="https://a.b/c">x</a> <a href="#top">x</a>'
    (tmp_path / "index.html").write_text(f'<h1 id="top">x</h1> {good}')
    (tmp_path / "other.html").write_text('<h1 id="here">x</h1> <a href="index.html">x</a>')
    with pytest.raises(SystemExit, match="0"):
        check_links.main(tmp_path)
    bad = '<a href="none.html">x</a> <img src="none.png"> <a href="other.html#there">x</a>'
    (tmp_path / "third.html").write_text(bad)
    with pytest.raises(SystemExit, match="1"):
        check_links.main(tmp_path)
    shown = capsys.readouterr().out
    assert "third.html: none.html, none.png, other.html#there" in shown
    assert shown.endswith("3 pages, 3 broken links\n")


def test_an_empty_site_is_not_fine(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="1"):
        check_links.main(tmp_path)


PAGE = """# Page

```sh
dtrepair check --help   # as a word
python examples/shapes.py
```

```bash
dtrepair never run
```

```python
print("x")
```
"""


def test_blocks_of_a_page_are_run_in_their_order(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    check, example, code = run_pages.commands(page)
    assert check[1:] == ["-m", "dtrepair", "check", "--help"]
    assert example[1:] == ["examples/shapes.py"]
    assert code[1:] == ["-c", 'print("x")\n']


@pytest.mark.parametrize(
    ("block", "fine"),
    [
        ("```python\nopen('made', 'w').close()\n```\n```python\nopen('made')\n```\n", True),
        ("```python\nraise SystemExit(1)\n```\n", False),
        ("```sh\ndtrepair nonsense\n```\n", False),
    ],
)
def test_a_page_that_does_not_run_is_told(tmp_path: Path, block: str, fine: bool) -> None:
    (tmp_path / "page.md").write_text(block)
    assert run_pages.run(tmp_path / "page.md") is fine


def test_every_picture_is_drawn_and_there() -> None:
    assert {f"{name}.png" for name in DRAWINGS} == {path.name for path in FOLDER.iterdir()}


def test_the_avatar_comes_clean_and_its_joints_hold(tmp_path: Path) -> None:
    """What its picture says of the default."""
    report = repair_stage(stages.avatar(tmp_path), tmp_path / "b.usda")
    (frame,) = report.frames
    assert frame.status == "clean" and frame.before is not None and frame.after is not None
    assert frame.before.pairs > 100 and frame.after.modelled_pairs >= frame.before.modelled_pairs
    paths = [(pair.first.path, pair.second.path) for pair in report.attached.listed]
    assert paths.count(("/Hero/Body", "/Hero/Body")) == 9


def test_pictures_that_show_something_else_differ(tmp_path: Path) -> None:
    paths = [tmp_path / f"{name}.png" for name in ("one", "noise", "other", "wide")]
    image = np.full((40, 60, 3), 200, dtype=np.uint8)
    noise, other = image.copy(), image.copy()
    noise[::4, ::4] += 5
    other[10:30, 10:30] = 50
    for path, pixels in zip(paths, (image, noise, other, image[:, :50]), strict=True):
        Image.fromarray(pixels).save(path)
    assert [differ(paths[0], path) for path in paths] == [False, False, True, True]


def test_pictures_are_cropped_alike() -> None:
    images = [np.zeros((100, 50, 3), dtype=np.uint8) for _ in range(2)]
    images[0][40, 10], images[1][60, 20] = 255, 255
    first, second = cropped(images, margin=5)
    assert first.shape == second.shape == (30, 50, 3)
    assert first[5, 10, 0] == 255 and second[25, 20, 0] == 255
