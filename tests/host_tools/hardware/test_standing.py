"""The operator's zero velocity as the hardware sends it for him."""

from __future__ import annotations


def test_it_is_repeated_while_the_vehicle_stands_and_taken_back(tools):
    bench = tools.Bench(standing=((33, 92, 0.25),))
    said = {}
    for _ in range(200):
        epoch, sent = bench.epoch, bench.step()
        if "ZERO_VELOCITY" in sent:
            said[epoch] = sent["ZERO_VELOCITY"]
    assert list(said) == [33, 40, 60, 80, 93]
    assert [frame["standing"] for frame in said.values()] == [1, 1, 1, 1, 0]
    assert [frame["alive_counter"] for frame in said.values()] == [0, 1, 2, 3, 4]
    assert {frame["velocity_sigma"] for frame in said.values()} == {0.25, 0.0}


def test_of_two_times_the_later_counts(tools):
    bench = tools.Bench(standing=((0, 100, 0.1), (20, 59, 0.3)))
    found = [bench.step().get("ZERO_VELOCITY") for _ in range(100)]
    sigmas = {epoch: frame["velocity_sigma"] for epoch, frame in enumerate(found) if frame}
    assert sigmas == {0: 0.1, 20: 0.3, 40: 0.3, 60: 0.1, 80: 0.1}
