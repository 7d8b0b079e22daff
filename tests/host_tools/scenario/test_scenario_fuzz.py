"""Any scenario file is read, or refused in one line.

``RRINS_FUZZ`` scales these tests: texts, 2000 by default. They print their figures: ``pytest -s``.
"""

from __future__ import annotations

import os
import random

import pytest

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario import scenario as scenarios

CASES = int(os.environ.get("RRINS_FUZZ", "2000"))

pytestmark = pytest.mark.timeout(120 + CASES // 100)

VALUES = (
    "0", "-1", "1e308", "-1e308", "1e-320", "inf", "nan", "9223372036854775808", "0x10", "1_0",
    "true", '""', '"é\\u0000"', "[]", "[[]]", "[0, 0]", "[[90, 0]]", "{}", '{axis = "inner"}',
    "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", '"rotating"', '"custom"', '"12-position"',
    "[1.0, 2.0, 3.0, 4.0]", '[{axis = "inner", angle_deg = 90}]', "9" * 4301, "[" * 200,
)  # fmt: skip
NAMES = (
    "title", "mode", "duration_s", "rate_hz", "seed", "navigate_at_s", "site", "body", "rimu",
    "gyros", "accelerometers", "turntable", "firmware", "operator", "paper", "inner", "outer",
    "bias_dph", "scheme", "geometry", "gyro_axes_deg", "gyro_weights", "at_s", "request", "x",
)  # fmt: skip


def bytes_changed(rng: random.Random, text: bytes) -> bytes:
    """Return a text with a few bytes changed."""
    out = bytearray(text)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        way, at = rng.randrange(6), rng.randrange(len(out) + 1)
        if way == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif way == 1 and at < len(out):
            out[at] = rng.choice(b"[]{}=\"'#.,\n\r\t \\0-+eE_")
        elif way == 2:
            del out[at : at + rng.choice((1, 1, 5, 50))]
        elif way == 3:
            out[at:at] = rng.randbytes(rng.choice((1, 4)))
        elif way == 4:
            end = rng.randrange(len(out) + 1)
            out[at:at] = out[min(at, end) : max(at, end)]
        else:
            out[at:at] = rng.choice(VALUES).encode()
    return bytes(out)


def structure_changed(rng: random.Random, text: bytes) -> bytes:
    """Return a text with a few lines, keys, values or tables changed."""
    lines = text.decode().splitlines()
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        way, at = rng.randrange(8), rng.randrange(len(lines))
        key, equals, _ = lines[at].partition("=")
        if way < 3 and equals:
            lines[at] = f"{key}= {rng.choice(VALUES)}"
        elif way == 3:
            lines.insert(at, f"{rng.choice(NAMES)} = {rng.choice(VALUES)}")
        elif way == 4:
            table = ".".join(rng.choices(NAMES, k=rng.choice((1, 1, 2, 3))))
            lines.insert(at, rng.choice(("[{}]", "[[{}]]")).format(table))
        elif way == 5:
            lines.insert(at, lines[rng.randrange(len(lines))])
        elif way == 6 and len(lines) > 1:
            del lines[at]
        else:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines).encode()


@pytest.mark.slow
@pytest.mark.parametrize("change", [bytes_changed, structure_changed])
def test_a_changed_scenario_loads_or_ends_in_one_line(change, tmp_path):
    rng = random.Random(change.__name__)
    texts = [scenarios.text_of(name).encode() for name in scenarios.names()]
    path = tmp_path / "changed.toml"
    loaded = 0
    for _ in range(CASES // 2):
        text = change(rng, rng.choice(texts))
        path.write_bytes(text)
        try:
            scenarios.load(str(path))
            loaded += 1
        except ScenarioError as error:
            assert str(error).startswith(f"scenario {path}: "), text  # noqa: PT017 - if there is one
            assert "\n" not in str(error), text  # noqa: PT017 - if there is one
        except Exception as error:
            raise AssertionError(f"{type(error).__name__} for {text!r}") from error
    print(f"\n{CASES // 2} texts, {loaded} of them good")
    assert 0 < loaded < CASES // 2


@pytest.mark.parametrize(
    "text",
    [
        b"duration_s = 1\nsite = " + b"[" * 100_000,
        b"duration_s = 1\nsite = " + b"{a = " * 100_000,
        b"duration_s = " + b"9" * 100_000,
        b"duration_s = 1\nseed = " + b"9" * 100_000,
        b"[" + b".".join([b"a"] * 10_000) + b"]",
        b"a = 1\n" * 100_000,
        b"".join(b"a%d = 1\n" % k for k in range(20_000)),
        b"\0" * 100_000,
        b"\xff\xfe" * 1000,
        b"",
    ],
    ids=range(10),
)
@pytest.mark.timeout(60)  # some seconds would be enough
def test_an_absurd_scenario_ends_in_one_line(text, tmp_path):
    path = tmp_path / "absurd.toml"
    path.write_bytes(text)
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["", ".", "/", "a" * 5000, "a\0b", "/dev/null/x", "\udcff"])
def test_an_absurd_name_ends_in_one_line(name):
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(name)
    assert "\n" not in str(caught.value)
