"""The page without a server: the rehearsal itself runs in the browser, as WebAssembly.

A folder of static files: the page, the machine code of each variant of the firmware that the
scenarios need, their memories at power-on, and `facts.json`: layouts and tables that the worker of
the page (`page/local/worker.js`) reads instead of having its own.
"""

from __future__ import annotations

import gzip
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from rrins.dbc.codec import load as load_codec
from rrins.dbc.contract import load_contract
from rrins.dbc.frame import Frame
from rrins.host_tools.builds import toolchain
from rrins.host_tools.builds.code import object_of
from rrins.host_tools.builds.entries import FIRMWARE_OUTBOX, HARDWARE_OUTBOX
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.rehearsal import TRUTHS, Session, TruthKept
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.builds.variants import Variant
from rrins.host_tools.dashboard import events, now, quantities
from rrins.host_tools.dashboard.bus_table import ABSENT_BIT, SATURATED_BIT
from rrins.host_tools.dashboard.fault_forms import fault_forms
from rrins.host_tools.dashboard.page_files import page_files
from rrins.host_tools.dashboard.source import described
from rrins.host_tools.files import JsonObject, make_folder, replacing, write_text
from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault
from rrins.host_tools.hardware.faults import NEVER
from rrins.host_tools.hardware.memory import FAULT_CAPACITY, Plant
from rrins.host_tools.monitor.state import SILENT_NS, SILENT_PERIODS, WINDOW_NS, decimals_of
from rrins.host_tools.monitor.tally import BIN_NS, BINS, Tally, tally_of
from rrins.host_tools.monitor.words import FOUND_BY, WITHOUT_ENCODER
from rrins.host_tools.rounding import unit_words
from rrins.host_tools.scenario.scenario import Scenario, load

SCENARIOS: Final = (
    "rimu_rotating",
    "tour",
    "rimu_strapdown",
    "ideal",
    "rimu_rotating_aligned",
)
"""Shown where none is named: the vehicle rests in all, so their memories are small."""

FOLDER: Final = "local"
ORDERS: Final = frozenset(
    {"inject", "remove", "list_faults", "clear_faults", "start", "stop", "pause", "speed"}
)
"""Orders that the worker takes; modes and trouble codes need UDS, which it does not speak."""

_HEAD: Final = '<html lang="en"', '<link rel="icon"'
_LOCAL_HEAD: Final = (
    f'<html lang="en" data-local="{FOLDER}/worker.js"',
    '<script type="module" async src="local_socket.js"></script>\n<link rel="icon"',
)


@dataclass(frozen=True)
class StaticPage:
    """A page that was written.

    Attributes
    ----------
    folder : Path
    size : int
        Bytes of all files.
    """

    folder: Path
    size: int


def write_static_page(
    folder: Path, names: Sequence[str] = (), on_note: Callable[[str], None] = lambda text: None
) -> StaticPage:
    """Write the page for some scenarios, the first of which is shown at first.

    Parameters
    ----------
    folder : Path
        Made if it is not there; files of the same names are replaced.
    names : sequence of str
        Built-in scenarios or files; `SCENARIOS` if there are none.
    on_note : callable
        Told what is being done.

    Raises
    ------
    RehearsalError
        When a scenario cannot be used, the folder not be written, or no compiler is there.
    """
    toolchain.check()
    scenarios = {Path(name).stem: load(name) for name in names or SCENARIOS}
    # Browsers have room: with the memory of this machine's own code, most is compiled already.
    images = {name: Images.of(one, Variant.whole) for name, one in scenarios.items()}
    variants = list(dict.fromkeys(one.variant for one in images.values()))
    make_folder(folder / FOLDER)
    contents = _page() | {
        f"{FOLDER}/{name}.image": _packed(one.ram, one.plant, one.motion, _session(scenarios[name]))
        for name, one in images.items()
    }
    one = next(iter(images.values()))
    codec = load_codec()
    contents[f"{FOLDER}/bus.image"] = _packed(one.contract, tally_of(codec, codec.bits_per_s))
    for number, variant in enumerate(variants):
        on_note(f"machine code {number + 1} of {len(variants)}: compiling")
        contents[f"{FOLDER}/{_code(number)}"] = web_assembly(variant)
    told = {
        name: _told(name, scenarios[name], one, variants.index(one.variant))
        for name, one in images.items()
    }
    first = {"first": next(iter(told)), "scenarios": told}
    facts = json.dumps(_facts() | first, separators=(",", ":"), allow_nan=False)
    for name, content in contents.items():
        (folder / name).parent.mkdir(exist_ok=True)
        with replacing(folder / name) as made:
            made.write_bytes(content)
    write_text(folder / FOLDER / "facts.json", facts)
    return StaticPage(folder, len(facts.encode()) + sum(map(len, contents.values())))


def web_assembly(variant: Variant) -> bytes:
    """Return the rehearsal of a variant of the firmware as a WebAssembly module."""
    with tempfile.TemporaryDirectory(prefix="rrins-") as scratch:
        code, linked = Path(scratch) / "rehearsal.o", Path(scratch) / "rehearsal.wasm"
        code.write_bytes(object_of("rehearsal", variant, "wasm32"))
        exports = [f"-Wl,--export={name}" for name in ("rrins_rehearse", "__heap_base")]
        target = ["-target", TARGETS["wasm32"].system, "-mexec-model=reactor"]
        toolchain.zig("cc", *target, "-O2", "-s", *exports, code, "-o", linked)
        return linked.read_bytes()


def _code(number: int) -> str:
    return f"code-{number}.wasm"


def _page() -> dict[str, bytes]:
    """Return the files of the page, by path; it starts a worker as its feed."""
    files = {path[1:]: file.content for path, file in page_files().items() if path != "/"}
    for of_server, local in zip(_HEAD, _LOCAL_HEAD, strict=True):
        assert of_server.encode() in files["index.html"]
        files["index.html"] = files["index.html"].replace(of_server.encode(), local.encode(), 1)
    return files


def _packed(*memories: np.ndarray[Any, Any]) -> bytes:
    """Return memories one after the other, by gzip."""
    return gzip.compress(b"".join(memory.tobytes() for memory in memories), 9, mtime=0)


def _session(scenario: Scenario) -> np.ndarray[Any, Any]:
    session = Session.zeros()
    session[0].clock_error_ppm = scenario.firmware.clock_error_ppm
    return session


def _told(name: str, scenario: Scenario, images: Images, code: int) -> JsonObject:
    """Return a scenario as the worker gets it."""
    return {
        "name": name,
        "scenario": described(scenario),
        "epochs": scenario.epochs,
        "code": _code(code),
        "image": f"{name}.image",
        "ram_bytes": images.ram.nbytes,
        "pieces": len(images.motion),
        "motion_bytes": images.motion.nbytes,
    }


def _facts() -> JsonObject:
    """Return the facts that all scenarios share."""
    codec = load_codec()
    messages = sorted(codec.database.messages, key=lambda message: message.frame_id)
    forms = {k: form for k, form in fault_forms().items() if form["group"] != "on the wire"}
    return {
        "hello": {
            "source": "rehearsal",
            "bus": "",
            "place": "rehearsal in this browser: nothing leaves it",
            "columns": list(quantities.NAMES),
            "may_control": True,
            "explains": False,
            "orders": sorted(ORDERS),
            "forms": forms,
            "guides": [],
            "message_names": [message.name for message in messages],
            "tour": [],
        },
        "layouts": {
            "plant": layout(Plant.dtype),
            "tally": layout(Tally.dtype),
            "truth": layout(TruthKept.dtype),
            "session": layout(Session.dtype),
        },
        "truths": TRUTHS,
        "outboxes": [Frame.dtype.itemsize * n for n in (HARDWARE_OUTBOX, FIRMWARE_OUTBOX)],
        "contract_bytes": load_contract().nbytes,
        "messages": [_message(message.name) for message in codec.database.messages],
        "quantities": quantities.facts(),
        "events": events.facts(),
        "troubles": now.facts(),
        "faults": {
            "kinds": {kind.word: _kind(kind) for kind in HardwareFault},
            "capacity": FAULT_CAPACITY,
            "every": EVERY,
            "never": str(NEVER),
        },
        "found_by": FOUND_BY,
        "without_encoder": WITHOUT_ENCODER,
        "absent_bit": ABSENT_BIT,
        "saturated_bit": SATURATED_BIT,
        "silent": [SILENT_PERIODS, SILENT_NS],
        "window_ns": WINDOW_NS,
        "bins": [BINS, *BIN_NS],
    }


def _message(name: str) -> JsonObject:
    """Return a message with its signals, in the order of the codec's tables."""
    codec = load_codec()
    message = codec.database.get_message_by_name(name)
    return {
        "name": name,
        "text": f"{', '.join(message.senders)} to {', '.join(sorted(message.receivers))}",
        "signals": [
            {
                "name": signal.name,
                "scale": float(signal.scale),
                "offset": float(signal.offset),
                "decimals": decimals_of(float(signal.scale)),
                "unit": unit_words(signal.unit),
                "text": signal.comment or "",
                "choices": codec.choices(name, signal.name),
                "valid_if": codec.valid_if(name, signal.name),
            }
            for signal in message.signals
        ],
    }


def _kind(kind: HardwareFault) -> JsonObject:
    parameter, target = kind.parameter, kind.target
    return {
        "number": int(kind),
        "part": kind.part.name.lower(),
        "target": None if target is None else {"key": target.key, "names": target.names},
        "parameter": None if parameter is None else {"key": parameter.key, "si": parameter.si},
    }


def layout(dtype: np.dtype[Any]) -> JsonObject:
    """Return where the fields of a record are: offsets, kinds as numpy writes them, shapes."""
    fields = {}
    for name in dtype.names or ():
        assert dtype.fields is not None
        field, offset = dtype.fields[name][:2]
        one: JsonObject = {"at": offset, "size": field.base.itemsize}
        one |= {"is": layout(field.base)} if field.base.names else {"kind": field.base.str[1:]}
        fields[name] = one | ({"shape": field.shape} if field.shape else {})
    return {"size": dtype.itemsize, "fields": fields}
