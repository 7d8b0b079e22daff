"""Errors of the dashboard."""

from __future__ import annotations

from rrins.host_tools.errors import RehearsalError


class DashboardError(RehearsalError):
    """The page cannot be served, or an order cannot be carried out."""
