"""Diagnostics of the navigation computer: UDS (ISO 14229) on ISO-TP (ISO 15765-2).

`table` is the one place where identifiers, routines, trouble codes, memory regions, sessions and
negative responses are described; the server, clients, the docs and the tests read it.

=====================  =============================================================================
table                  what there is to read, write, start and find: no behaviour
records                what the step keeps for diagnostics in the RAM image
monitor                finds faults, debounces them, takes freeze frames: part of the compiled step
fault_memory           the trouble codes' status bytes and freeze frames, as the services read them
image, store           the calibration file, and memory that survives power loss
parameter_memory       the parameters in force
transport              ISO-TP, in the time of the epoch counter
server, services       the UDS server: one file per group of services
node                   what the loop calls between two steps
=====================  =============================================================================
"""
