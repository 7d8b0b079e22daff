"""Print as a C header what `cantools generate_c_source` leaves out: E2E data IDs and value limits.

python contract.py rrins.dbc > contract.h
"""

from __future__ import annotations

import sys
from pathlib import Path

import cantools

database = cantools.database.load_string(Path(sys.argv[1]).read_text(encoding="utf-8"), "dbc")
print("/* Made from the DBC by contract.py. */\n#ifndef CONTRACT_H\n#define CONTRACT_H\n")
for message in database.messages:
    name = f"RRINS_{message.name}"
    data_id = int(message.dbc.attributes["E2EDataID"].value)
    print(f"#define {name}_E2E_DATA_ID (0x{data_id:04X}u)")
    for signal in message.signals:
        if signal.minimum is not None and signal.maximum is not None:
            stem = f"{name}_{signal.name.upper()}"
            print(f"#define {stem}_LOW ({float(signal.minimum)!r})")
            print(f"#define {stem}_HIGH ({float(signal.maximum)!r})")
print("\n#endif")
