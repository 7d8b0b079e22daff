"""The error counters of a node: Bosch, CAN Specification 2.0, 1991, part A, 7."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.host_tools.wire import confinement
from rrins.host_tools.wire.confinement import Confinement, NodeState


@pytest.fixture
def nodes():
    return np.zeros(1, dtype=Confinement.dtype)


def state(nodes):
    return NodeState(int(confinement.state_of(nodes[0])))


def test_a_node_begins_error_active(nodes):
    assert state(nodes) is NodeState.ERROR_ACTIVE


def test_sixteen_transmit_errors_make_a_node_passive_and_one_frame_active_again(nodes):
    for _ in range(15):
        confinement.transmit_error(nodes[0])
    assert nodes["tec"][0] == 120
    assert state(nodes) is NodeState.ERROR_ACTIVE
    confinement.transmit_error(nodes[0])
    assert nodes["tec"][0] == 128
    assert state(nodes) is NodeState.ERROR_PASSIVE
    confinement.transmitted(nodes[0])
    assert nodes["tec"][0] == 127
    assert state(nodes) is NodeState.ERROR_ACTIVE


def test_thirty_two_transmit_errors_take_a_node_off_the_bus(nodes):
    off = [int(confinement.transmit_error(nodes[0])) for _ in range(32)]
    assert off == [0] * 31 + [1]
    assert nodes["tec"][0] == 256
    assert state(nodes) is NodeState.BUS_OFF


def test_a_lone_node_never_goes_off_the_bus(nodes):
    for _ in range(1000):
        assert not confinement.acknowledge_error(nodes[0], False)
    assert nodes["tec"][0] == 128
    assert state(nodes) is NodeState.ERROR_PASSIVE


def test_somebody_elses_flag_counts_even_for_a_passive_node(nodes):
    nodes["tec"] = 128
    confinement.acknowledge_error(nodes[0], True)
    assert nodes["tec"][0] == 136


@pytest.mark.parametrize(("before", "after"), [(0, 0), (1, 0), (127, 126), (128, 127), (255, 127)])
def test_a_frame_received(nodes, before, after):
    nodes["rec"] = before
    confinement.received(nodes[0])
    assert nodes["rec"][0] == after


def test_receive_errors_make_a_node_passive_and_no_more(nodes):
    for _ in range(127):
        confinement.receive_error(nodes[0])
    assert state(nodes) is NodeState.ERROR_ACTIVE
    for _ in range(1000):
        confinement.receive_error(nodes[0])
    assert state(nodes) is NodeState.ERROR_PASSIVE
    assert nodes["rec"][0] == 255


def test_128_sequences_bring_a_node_back(nodes):
    nodes["rec"] = 50
    for _ in range(32):
        confinement.transmit_error(nodes[0])
    assert not confinement.recessive(nodes[0], 127)
    assert state(nodes) is NodeState.BUS_OFF
    assert confinement.recessive(nodes[0], 1)
    assert nodes[0].tolist() == (0, 0, 0, 0)
    assert state(nodes) is NodeState.ERROR_ACTIVE


@given(st.lists(st.sampled_from(["transmitted", "received", "receive_error", "transmit_error"])))
def test_the_counters_stay_in_their_range(events):
    nodes = np.zeros(1, dtype=Confinement.dtype)
    for event in events:
        if state(nodes) is NodeState.BUS_OFF:
            break
        getattr(confinement, event)(nodes[0])
    assert 0 <= nodes["tec"][0] <= 263
    assert 0 <= nodes["rec"][0] <= 255
    assert (nodes["tec"][0] > 255) == (state(nodes) is NodeState.BUS_OFF)
