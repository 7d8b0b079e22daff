"""Rehearse on the embedded bus, record it, and plot two signals of the log."""

import tempfile
from pathlib import Path

from matplotlib.figure import Figure

import rrins

folder = Path(tempfile.mkdtemp())
rrins.rehearse("rimu_rotating", duration_s=60, record=folder / "bus.blf")
log = rrins.open_log(folder / "bus.blf")

figure = Figure(figsize=(8, 5), layout="constrained")
upper, lower = figure.subplots(2, 1, sharex=True)
log["AXIS_INNER_STATUS.encoder_angle_deg"].plot(ax=upper)
log["NAV_VELOCITY.velocity_north"].plot(ax=lower)
figure.savefig(folder / "signals.png")
print(folder / "signals.png")
