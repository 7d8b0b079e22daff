"""The screen by its keys, at 80 x 24 and 120 x 40; and its picture in the docs."""

from __future__ import annotations

import asyncio
import functools
import html
import os
import re
from pathlib import Path

import can
import pytest
from textual import events

from rrins.host_tools.monitor.screen.app import MonitorApp

PICTURE = Path(__file__).parents[3] / "docs" / "pictures" / "monitor.svg"
REWRITE = "RRINS_REWRITE_PICTURES"
"""Set in the environment, the picture in the docs is made anew instead of compared."""

SIZES = [(80, 24), (120, 40)]


def lines_of(app):
    """Return what is on the screen, as the terminal gets it."""
    return [
        "".join(segment.text for segment in strip)
        for strip in app.screen._compositor.render_strips()
    ]


def text_of(app):
    return "\n".join(lines_of(app))


def run(bus, size, use, **options):
    """Run the screen of a bus, without pictures of its own accord, and use it."""

    async def session():
        app = MonitorApp("rrins:rrins0", bus.watch, refresh_hz=0, **options)
        async with app.run_test(size=size) as pilot:

            async def press(*keys):
                await pilot.press(*keys)
                await pilot.pause()
                return text_of(app)

            await pilot.pause()
            app.look()
            await pilot.pause()
            await use(app, press)
        return app

    return asyncio.run(session())


def on_screen(*sizes, **options):
    """Make a test of a function that uses the screen of a bus, at 80 x 24 by default."""

    def made(use):
        def test(bus, size):
            run(bus, size, functools.partial(use, bus), **options)

        return pytest.mark.parametrize("size", sizes or SIZES[:1])(test)

    return made


@pytest.fixture
def bus(played):
    """Two seconds of a bus; SENSOR_3 has been silent for the last."""
    for k in range(401):
        time_s = k * 0.005
        played.send("SYNC", time_s, k, epoch=k, time_us=5000 * k)
        for group in (1, 2, 3, 4):
            if group != 3 or k <= 200:
                played.send(f"SENSOR_{group}", time_s, k, gyro_dtheta=1e-6 * k)
        played.send("AXIS_INNER_STATUS", time_s, k, state="MOVING", encoder_angle_deg=k / 20)
        if k % 20 == 0:
            played.send("FIRMWARE_STATUS", time_s, k // 20, mode="STANDBY", usable_sensors=3)
    played.put_message(can.Message(arbitration_id=0x7E9, is_extended_id=False, data=b"\x02"), 2.0)
    return played


@on_screen(*SIZES)
async def test_everything_is_on_the_first_screen(bus, app, press):
    lines = lines_of(app)
    assert [len(line) for line in lines] == [app.size.width] * app.size.height
    text = "\n".join(lines)
    assert "rrins:rrins0  time 2.000 s" in text
    assert "mode STANDBY" in text
    assert "inner 20.0000°" in text
    assert "TROUBLES 2: the firmware uses 3 of 4 sensor groups; " in text
    for name in ("SYNC", "SENSOR_4", "AXIS_INNER_STATUS", "FIRMWARE_STATUS", "unknown"):
        assert any(name in line for line in lines[8:]), name
    silent = next(line for line in lines[8:] if "SENSOR_3" in line)
    assert silent.startswith(" !0x042")
    assert " silent " in silent
    assert "q quit" in lines[-1]


@pytest.mark.parametrize("size", SIZES)
def test_the_page_on_the_estimator(bus, size):
    async def none(app, press):
        assert "it runs none, or not yet" in await press("e")
        assert "SYNC" in await press("escape")

    run(bus, size, none)

    async def all_of_it(app, press):
        for k in range(3):  # another source and sensor each time
            at = 2.0 + k
            bus.send("ESTIMATOR_STATUS", at, k, aided_by=0b1100, rejecting=0b10000, used=30)
            bus.send("ESTIMATOR_SOURCE", at, k, source=2 + k, used=10 + k, rejected=k, nis=1.25)
            bus.send("ESTIMATOR_ATTITUDE", at, k, east_sigma=12.5, north_sigma=12.1, up_sigma=455)
            bus.send("ESTIMATOR_POSITION", at, k, east_sigma=0.5 + k, north_sigma=0.25)
            bus.send("ESTIMATOR_GYRO", at, k, sensor=1 + k, bias=0.5 - k, bias_sigma=0.01)
            bus.send("AIDING_STATUS", at, k, gnss="LOST", gnss_age=7.5, gnss_losses=2)
            app.look()
        text = await press("e")
        assert "σ attitude      east 12.5″, north 12.1″, up 455.0″" in text
        assert "aided by        GNSS position, GNSS velocity" in text
        assert "rejecting       odometer" in text
        assert "GNSS velocity   11 used, 1 rejected, NIS 1.25" in text
        assert "GNSS            LOST, the latest 7.5 s old, lost 2 times" in text
        assert "gyro 1          +0.5000 ± 0.0100 °/h" in text
        assert "gyro 3          -1.5000 ± 0.0100 °/h" in text
        assert "SYNC" in await press("escape")

    run(bus, size, all_of_it)


@pytest.mark.parametrize("size", SIZES)
def test_the_page_on_redundancy(bus, size):
    async def none(app, press):
        expected = "compares no sensors" if app_sees_status else "No report yet"
        assert expected in await press("r")
        assert "SYNC" in await press("escape")

    app_sees_status = False
    run(bus, size, none)
    for k in range(30):
        bus.send("FIRMWARE_STATUS", 2.0 + k / 10, k)
    app_sees_status = True
    run(bus, size, none)
    for k in range(3):
        ratio = (0.25, 1.5, 0.5)[k]
        values = {"redundant": 1, "parity_ratio": ratio, "window_log2": 4, "suspect": 3}
        values |= {"drift": "ABOVE_320_PPM"}
        bus.send("GYRO_REDUNDANCY", 2.0 + k, k, **values)
    bus.send("ACCELEROMETER_REDUNDANCY", 4.0, 0, excluded=1, isolated=1, how="ABSENT")
    bus.send("READMISSION_STATUS", 4.0, 0, state="TESTING", kind="GYRO", sensor=4, test_s=60)

    async def all_of_it(app, press):
        lines = (await press("r")).splitlines()
        text = "\n".join(lines)
        now = next(line for line in lines if "parity/threshold" in line)
        assert now.count("#") == 10  # of 20 to the threshold
        assert now.rstrip().endswith("0.50")
        largest = next(line for line in lines if "largest so far" in line)
        assert largest.index("|") < largest.rindex("#")
        assert "window            16 s" in text
        assert "suspect           none: all agree" in text
        assert text.count("calibration       DRIFTED: above 320 ppm, if it is one sensor") == 1
        assert "GYRO_REDUNDANCY.parity_ratio  now 0.50" in text
        assert "left out          1 (the last, 1, by its flag)" in text
        assert "NO: a fault of another would not show" in text
        assert "READMISSION  gyro 4 TESTING, compared for 0 of 60 s" in text
        assert "SYNC" in await press("r")

    run(bus, size, all_of_it)


@on_screen()
async def test_the_filter_narrows_while_it_is_written(bus, app, press):
    text = await press("slash", *"gyro")
    assert "Esc show all" in text
    assert "SENSOR_4" in text
    assert "SYNC" not in text.split("name", 1)[1]
    text = await press("enter")
    assert "filter: gyro" in text
    assert "gyro_dtheta=0.000400000" in text
    text = await press("slash", *"q?s", "escape")  # these are letters here, not keys
    assert "SYNC" in text
    assert "filter:" not in text
    text = await press("slash", *"nowhere")
    assert "SENSOR" not in text.split("name", 1)[1]
    await press("enter", "enter", "p", "down")  # nothing to open, plot or point at


@on_screen()
async def test_pasted_text_is_the_filter_and_no_keys(bus, app, press):
    app.post_message(events.Paste("axis\nq"))
    text = await press()
    assert "filter: axis" in text
    assert "AXIS_INNER_STATUS" in text
    assert "SENSOR_4" not in text
    text = await press("enter", "down")
    assert "filter: axis" in text
    app.post_message(events.Paste("gyro"))
    assert "SENSOR_4" in await press()
    await press("escape", "question_mark")
    app.post_message(events.Paste("q"))
    assert "KEYS" in await press()
    assert app.is_running


@on_screen(needle="axis", order="rate")
async def test_a_filter_given_at_the_start(bus, app, press):
    assert "filter: axis" in text_of(app)
    assert "SENSOR_1" not in text_of(app)


@on_screen()
async def test_the_order_goes_round_and_the_cursor_stays_on_its_message(bus, app, press):
    await press("down", "down", "down")
    for title in ("name*", "rate/s*", "errors*", "id*"):
        text = await press("s")
        assert title in text
        pointed = [line for line in text.splitlines() if line.startswith(">")]
        assert len(pointed) == 1
        assert "SENSOR_3" in pointed[0]


@on_screen()
async def test_frozen_the_picture_stands_while_frames_are_taken(bus, app, press):
    text = await press("f")
    assert "FROZEN" in text
    bus.send("SYNC", 2.005, 401, epoch=401)
    app.look()
    assert "time 2.000 s" in await press("down")
    assert "0x040" in await press("s", "s", "s", "s", "enter")  # still works
    text = await press("f")
    assert "FROZEN" not in text
    assert "time 2.005 s" in text


@on_screen(*SIZES)
async def test_the_detail_of_a_message(bus, app, press):
    await press(*["down"] * 5)
    text = await press("enter")
    assert "0x060 AXIS_INNER_STATUS  HARDWARE to FIRMWARE, HOST" in text
    assert re.search(r"state +MOVING \(2\) +2 +2\b", text)
    assert re.search(r"encoder_angle_deg +19\.99\d+ ° +0\.000000 +19\.99", text)
    has_both = "SENSOR_4" in "\n".join(text.splitlines()[8:])
    assert has_both == (app.size.height >= 34)
    text = await press("down")
    assert ">  encoder_angle_deg" in text
    assert "Angle, counted over whole turns, modulo 64 turns." in text
    text = await press("escape")
    assert "encoder_angle_deg +20" not in text
    assert "SENSOR_4" in text


@on_screen()
async def test_an_unknown_message_has_a_detail_too(bus, app, press):
    text = await press("end", "enter")
    assert "0x7E9 unknown  1 bytes, not in the DBC" in text
    assert "last frame 02" in text


@on_screen(*SIZES)
async def test_plots_come_go_and_change_their_span(bus, app, press):
    text = await press("end", "up", "up", "p")
    assert "AXIS_INNER_STATUS.encoder_angle_deg  now 19.99" in text
    assert "last 1 min" in text
    assert re.search("[\u2801-\u28ff]", text)
    assert "last 10 min" in await press("w")
    text = await press("home", "p")
    assert "SYNC.time_us  now 2000000 µs" in text
    assert "AXIS_INNER_STATUS.encoder" in text
    text = await press("p")
    assert "SYNC.time_us" not in text
    assert "q quit" in text


@on_screen()
async def test_help_and_troubles_cover_the_screen_and_go_again(bus, app, press):
    text = await press("question_mark")
    assert "KEYS" in text
    assert "COLUMNS" in text
    assert max(len(line) for line in app.screen.lines.plain.splitlines()) <= 79
    assert "SYNC" in await press("escape")
    text = await press("t")
    assert "TROUBLES 2" in text
    assert "\n  SENSOR_3 has been silent for 1.0 s" in text
    bus.send("SENSOR_3", 2.0, 400)
    app.look()
    assert "SYNC" in await press("q")
    assert app.is_running


@on_screen()
async def test_setting_to_zero(bus, app, press):
    assert "SYNC" in text_of(app)
    text = await press("z")
    assert "SYNC" not in text
    bus.send("SYNC", 2.005, 401)
    app.look()
    assert "SYNC" in await press("down")


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_quitting(bus, key):
    async def use(app, press):
        await press("slash")
        if key == "q":
            await press("escape")
        await press(key)

    assert run(bus, (80, 24), use).return_code == 0


@on_screen()
async def test_when_the_bus_ends_the_last_state_stays(bus, app, press):
    bus.watch.end("its host has gone")
    bus.clock.now_ns += 60_000_000_000
    app.look()
    text = await press("down")
    assert "THE BUS HAS ENDED: its host has gone" in text
    assert "SENSOR_4" in text


@on_screen((30, 8))
async def test_a_small_screen_does_no_harm(bus, app, press):
    await press("enter", "p", "escape", "slash", "escape", "t", "escape", "question_mark")


# ---- the picture in the docs


def rows_of_svg(svg):
    """Return the text of a picture, line by line, whatever it is cut into."""
    rows = {}
    for attributes, text in re.findall(r"<text([^>]*)>([^<]*)</text>", svg):
        place = re.search(r'\by="([\d.]+)"', attributes)
        rows.setdefault(float(place[1]), []).append(html.unescape(text).replace("\xa0", " "))
    joined = [" ".join("".join(parts).split()) for _, parts in sorted(rows.items())]
    return [line for line in joined if line]


def drive(bench):
    """Half a minute of the turning RIMU, with a sensor that is dropped at the end."""
    bench.expect("FIRMWARE_STATUS", within=5, where={"mode": "NAVIGATION_ROTATING"})
    bench.advance(28)
    bench.inject("drop", message="SENSOR_3")
    bench.advance(1.2)


@pytest.mark.slow
def test_the_picture_in_the_docs_is_what_the_screen_shows(rehearsed):
    bus = rehearsed(drive, firmware={"alignment_s": 1, "turn_rate_dps": 20, "stand_s": 2})

    async def use(app, press):
        await press(*["down"] * 8, "p", "up", "up", "enter", "down", "p")
        svg = app.export_screenshot(title="rrins monitor")
        # Some viewers fold spaces, even those that do not break.
        use.svg = svg.replace("<text ", '<text xml:space="preserve" ')

    run(bus, (110, 44), use)
    if os.environ.get(REWRITE):
        PICTURE.write_text(use.svg, encoding="utf-8")
    drawn = rows_of_svg(PICTURE.read_text(encoding="utf-8"))
    assert rows_of_svg(use.svg) == drawn, f"{PICTURE}: make it anew with {REWRITE}=1"
    assert any("TROUBLES" in row for row in drawn)
