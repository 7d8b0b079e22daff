"""Measurement and calibration of the navigation computer: XCP on CAN (ASAM MCD-1 XCP 1.5).

    loop -> node -> slave -> a service -> memory, pages, daq        between two steps
                 -> stimulation                                     just before a step

Present only if the set-up says so. While nobody is connected, no Python runs for it and the step
does the same as without. All that a tool has to know of the memory is in the A2L file, which is
made from the same records (`a2l`).
"""
