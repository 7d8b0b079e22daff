"""A rehearsal beside programs that do the bus no good: the same navigation, and they are named."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import rrins
from tests.processes import Fork

CHANNEL = "beset"
DURATION_S = 20  # long enough for strangers to do harm on a busy machine


@pytest.fixture
def strangers() -> Iterator[Callable[..., None]]:
    """Start programs of `strangers.py`; they wait for the channel."""
    processes: list[subprocess.Popen[str]] = []

    def start(*roles: str) -> None:
        script = Path(__file__).with_name("strangers.py")
        options: dict[str, Any] = {"stdout": subprocess.PIPE, "text": True}
        started = [Fork([script, role, CHANNEL], **options) for role in roles]
        processes.extend(started)
        for process in started:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def alone() -> str:
    """Return the navigation of the scenario when nobody disturbs."""
    return str(rrins.simulate("ideal", duration_s=DURATION_S).summary["navigation_sha256"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "roles",
    [("forger", "closer", "spoiler"), ("asker",), ("babbler",), ("caller",)],
    ids=lambda roles: roles[0],
)
def test_a_rehearsal_at_full_speed_navigates_as_if_alone(
    run_beside: Callable[..., Any], alone: str, roles: tuple[str, ...]
) -> None:
    for _ in range(5):  # a machine that stalls may keep them from their work
        summary, said = run_beside(roles)
        assert summary["completed"]
        assert summary["navigation_sha256"] == alone
        assert summary["frames_lost"] == 0
        assert not any(summary["firmware"]["faults"].values())
        bus = summary["hardware"]["bus"]
        if "forger" not in roles or (bus["refused_frames"] > 100 and bus["cut_off"] >= 20):
            break
    if "forger" in roles:
        assert bus["refused_frames"] > 100
        assert next(iter(bus["senders"])).startswith("observer 'forger' (process ")
        assert bus["cut_off"] >= 20
        assert any("is cut off: it sent" in line for line in said)
    elif "caller" not in roles:
        assert bus["refused_frames"] == 0
        assert bus["held_back"][0].startswith(f"observer '{roles[0]}' (process ")
        assert any("sends more than 16 frames an epoch" in line for line in said)


@pytest.fixture
def run_beside(
    start: Callable[..., Any], strangers: Callable[..., None]
) -> Callable[[tuple[str, ...]], tuple[dict[str, Any], list[str]]]:
    """Return a function that runs the rehearsal beside strangers."""

    def run(roles: tuple[str, ...]) -> tuple[dict[str, Any], list[str]]:
        strangers(*roles)
        rehearsal = start(
            *("rehearse", "ideal", "--duration", DURATION_S, "--channel", CHANNEL, "--json"),
            *("--out", "out"),
        )
        status, out = rehearsal.finish(240)
        assert status == 0, rehearsal.said
        return json.loads(out), rehearsal.said

    return run


@pytest.mark.slow
def test_a_test_may_ask_a_rehearsal_to_let_them_through(
    start: Callable[..., Any], strangers: Callable[..., None], alone: str
) -> None:
    strangers("forger")
    rehearsal = start(
        *("rehearse", "ideal", "--duration", DURATION_S, "--channel", CHANNEL, "--json"),
        *("--foreign-senders", "--out", "out"),
    )
    status, out = rehearsal.finish(240)
    summary = json.loads(out)
    assert status in (0, 8)
    assert summary["hardware"]["bus"]["refused_frames"] == 0
    assert summary["firmware"]["faults"]["counter_errors"] > 0
    assert summary["navigation_sha256"] != alone or summary["firmware"]["fault"] != "NONE"
