"""The exception of campaigns."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class CampaignError(RehearsalError):
    """A campaign that is impossible, is not that of its folder, or cannot go on."""
