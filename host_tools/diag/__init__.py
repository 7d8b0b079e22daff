"""The diagnostic tool: `rrins diag`, a UDS client (ISO 14229) for the navigation computer.

What there is to read, write, start and find is described in `firmware_py.diagnostics.table` only.

===================  ===============================================================================
medium               frames to and from a bus: the embedded one, any of python-can
connection           ISO-TP over a medium, or by the kernel: what udsoncan's client speaks through
target               which bus, and how to get onto it
tester               sessions, security, retries: what the commands call
advice               negative responses in words, with what to do
values, memory       values of the table as text, and back; the RAM image's fields
calibration_file     the calibration as TOML
tables, lines        what is shown
command, did, …      the commands; `shell` runs them at a prompt
===================  ===============================================================================
"""
