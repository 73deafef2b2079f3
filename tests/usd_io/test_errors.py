from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Sdf, Tf

import usd_io
from usd_io.errors import FrameError, UsdIoError, one_line, time_text


def test_every_error_is_ours_and_has_an_exit_code() -> None:
    codes = {
        "StageError": 3,
        "UsageError": 2,
        "FrameSpecError": 2,
        "SelectionError": 2,
        "FrameError": 4,
        "OutputError": 5,
    }
    for name, code in codes.items():
        error = getattr(usd_io, name)
        assert issubclass(error, UsdIoError) and error.exit_code == code


def test_frame_errors_name_mesh_and_time() -> None:
    assert str(FrameError("/A", 12.5, "bad")) == "/A at frame 12.5: bad"
    assert str(FrameError("/A", float("nan"), "bad")) == "/A at the default time: bad"
    assert time_text(1 / 3) == "frame 0.333333333333333"


def test_messages_of_pxr_become_one_line() -> None:
    with pytest.raises(Tf.ErrorException) as caught:
        Sdf.PathExpression("{bad")
    text = one_line(caught.value)
    assert re.match("Ill-formed|.*parse error", text)
    assert "\n" not in text and "pxrInternal" not in text
    assert len(one_line(ValueError("x" * 1000))) == 300
    assert one_line(ValueError()) == "ValueError"
    mangled = "in pxrInternal_v0_26_11__pxrReserved__::Sdf_Parser::Value"
    assert one_line(ValueError(mangled)) == "in Sdf_Parser::Value"


def test_public_names_exist_and_load_pxr_late() -> None:
    for name in usd_io.__all__:
        assert getattr(usd_io, name) is not None
    assert set(usd_io.__all__) <= set(dir(usd_io))
    assert usd_io.__all__ == sorted(usd_io.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = usd_io.nothing
    code = """
import sys, usd_io
assert "pxr" not in sys.modules and "numpy" not in sys.modules
for name in usd_io.__all__: getattr(usd_io, name)
assert "pxr" in sys.modules
wrong = {name.partition(".")[0] for name in sys.modules} & {"torch", "dtrepair", "warp", "scipy"}
assert not wrong, wrong
"""
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
