"""Diagnostics of the navigation computer: UDS (ISO 14229) on ISO-TP (ISO 15765-2).

`table` is the one place where identifiers, routines, trouble codes, memory regions, sessions and
negative responses are described; the server, clients, the docs and the tests read it. Faults are
found, debounced and kept by the compiled step: `rrins.firmware_py.core.monitoring.monitor`.

========================  ==========================================================================
table                     what there is to read, write, start and find: no behaviour
identifiers, parameters,  its parts
regions, routines,
responses
fault_memory              status bytes and freeze frames of the trouble codes, as the services read
                          them
calibration_image, store  the calibration file, and memory that survives power loss
parameter_memory          the parameters in effect
transport                 ISO-TP, in the time of the epoch counter
server, services          the UDS server: one file per group of services
node                      what the loop calls between two steps
========================  ==========================================================================
"""
