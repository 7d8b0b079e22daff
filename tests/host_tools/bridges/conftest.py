"""A short scenario for the tests of adapters."""

from tests.host_tools.serial.conftest import scenario, terminal  # noqa: F401
