"""The diagnostic tool: `rrins diag`, a UDS client (ISO 14229) for the navigation computer.

Only `rrins.firmware_py.diagnostics.table` describes what can be read, written and started, and the
trouble codes. The commands are in `rrins.host_tools.cli.diag`.

===================  ===============================================================================
transport            frames to and from a bus: the embedded one or any python-can interface
connection           ISO-TP over a transport or by the kernel, as a connection for udsoncan
target               which bus to use, and how to connect to it
conversation         sessions, security, retries
tester               the requests that the commands make
advice               negative responses in words, with advice
values, ram          values of the table to and from text; fields of the RAM image
calibration_file     the calibration as TOML
===================  ===============================================================================
"""
