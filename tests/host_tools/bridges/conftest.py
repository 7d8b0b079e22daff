"""Fixtures that the tests of bridges share with those of the bus and of serial lines."""

from tests.host_tools.bus.conftest import (  # noqa: F401 - fixtures
    attach_to,
    player,
    runtime_directory,
    start_player,
)
from tests.host_tools.serial.conftest import scenario, terminal  # noqa: F401 - fixtures
