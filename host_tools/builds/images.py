"""The memories of both sides at power-on, as a scenario sets them up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.settings import Settings
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.builds.variants import Variant, shortened
from rrins.host_tools.hardware.settings import pieces_of, power_on
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.runs.set_up.setup_file import setup_text
from rrins.host_tools.scenario.scenario import Scenario

_Image = np.ndarray[Any, np.dtype[np.void]]


@dataclass(frozen=True)
class Images:
    """The memories that the steps work on.

    Attributes
    ----------
    variant : Variant
    ram : array
        The firmware's memory, one record of the variant's size.
    contract : array
        One record.
    plant : array
        The hardware's memory, one record.
    motion : array, shape (n, 15, 8)
        The vehicle's, as `rrins.host_tools.hardware.motion` describes it.
    settings : Settings
        Of the firmware.
    setup : str
        The set-up file of the firmware, as `rrins setup` shows it.
    """

    variant: Variant
    ram: _Image
    contract: _Image
    plant: _Image
    motion: Floats
    settings: Settings
    setup: str

    @property
    def hello(self) -> FrameArray:
        """The frame by which the firmware announces itself before the first epoch."""
        frames = frame_array(1)
        message = load_contract()[0].heartbeat_firmware.message
        fill(frames[0], message, np.uint64(0), 0)
        return frames

    @classmethod
    def of(
        cls, scenario: Scenario, variant_of: Callable[[Records[Ram]], Variant] = Variant.of
    ) -> Images:
        """Return those of a scenario.

        Parameters
        ----------
        scenario : Scenario
        variant_of : callable
            Chooses the variant by the memory at power-on.

        Raises
        ------
        RehearsalError
            When one of its files cannot be used.
        """
        settings = firmware_settings(scenario)
        ram = Firmware(settings).ram
        variant = variant_of(ram)
        hardware = hardware_settings(scenario)
        return cls(
            variant,
            shortened(ram, variant.memory),
            load_contract(),
            power_on(hardware),
            pieces_of(hardware),
            settings,
            setup_text(scenario),
        )
