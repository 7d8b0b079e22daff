"""The operator's zero velocity: ZERO_VELOCITY, for as long as he says that the vehicle stands."""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import encode, pack
from rrins.dbc.contract import MessageSignals
from rrins.host_tools.hardware.memory import Plant

_NS_PER_MS = 1_000_000


@compiled
def is_due(plant: Plant, message: MessageSignals) -> bool:
    """Return whether ZERO_VELOCITY is sent in this epoch: at a change, and each cycle."""
    standing = plant.standing
    present = -1
    for k in range(standing.count):
        if standing.first[k] <= plant.epoch <= standing.last[k]:
            present = k
    changed = present != standing.present
    standing.present = present
    every = max(1, message.message.cycle_ms * _NS_PER_MS // plant.period_ns)
    return changed or (present >= 0 and plant.epoch % every == 0)


@compiled
def word(plant: Plant, message: MessageSignals) -> np.uint64:
    """Return the payload of ZERO_VELOCITY in this epoch."""
    present = plant.standing.present
    if present < 0:
        return np.uint64(0)
    payload = pack(np.uint64(0), message.standing, 1)
    return encode(payload, message.velocity_sigma, plant.standing.sigma[present])
