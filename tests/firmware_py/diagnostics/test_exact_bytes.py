"""Each service's positive and negative responses, byte for byte (ISO 14229-1)."""

from __future__ import annotations

import pytest

from rrins.firmware_py.core.modes.modes import Mode

# What every session answers.
DEFAULT = {
    # 0x10 DiagnosticSessionControl
    "1001": "5001003201f4",
    "1003": "5003003201f4",
    "1083": None,
    "1002": "7f107e",  # by way of the extended session only
    "1004": "7f1012",
    "10": "7f1013",
    "100100": "7f1013",
    # 0x11 ECUReset
    "1101": "7f117f",
    # 0x14 ClearDiagnosticInformation
    "14ffffff": "54",
    "14d10187": "54",
    "14ffff": "7f1413",
    "14ffffff00": "7f1413",
    "14123456": "7f1431",
    "14d10987": "7f1431",  # of a ninth sensor, and there are four
    # 0x19 ReadDTCInformation
    "190108": "59017f010000",
    "190208": "59027f",
    "1903": "5903",
    "1904d1018701": "5904d1018700",
    "1906d1018701": "5906d101870001" + "00000080",
    "1906d10187ff": "5906d101870001" + "00000080",
    "1914": "5914",
    "19": "7f1913",
    "1901": "7f1913",
    "19010800": "7f1913",
    "190b": "7f1912",
    "1904d1098701": "7f1931",
    "1904d1018703": "7f1931",
    "1906d1018705": "7f1931",
    # 0x22 ReadDataByIdentifier
    "220102": "6201020200",
    "22f186": "62f18601",
    "22f195": "62f195" + b"0.1.0".ljust(16).hex(),
    "220102f186": "6201020200f18601",
    "22ffff0102": "6201020200",  # what there is, of several
    "22ffff": "7f2231",
    "221105": "7f2231",  # of a fifth gyro
    "22": "7f2213",
    "2201": "7f2213",
    "220102f1": "7f2213",
    "22" + "0102" * 17: "7f2213",
    # 0x23, 0x27, 0x28, 0x2E, 0x2F, 0x31, 0x34 to 0x37, 0x85: not in the default session
    "23140000000010": "7f237f",
    "2701": "7f277f",
    "280001": "7f287f",
    "2e10043fe0000000000000": "7f2e7f",
    "2f031100": "7f2f7f",
    "31010201": "7f317f",
    "34004410000000000000ff": "7f347f",
    "350044100000000000ffff": "7f357f",
    "3601": "7f367f",
    "37": "7f377f",
    "8501": "7f857f",
    # 0x3E TesterPresent
    "3e00": "7e00",
    "3e80": None,
    "3e01": "7f3e12",
    "3e": "7f3e13",
    "3e0000": "7f3e13",
    # what there is not
    "00": "7f0011",
    "24f186": "7f2411",
    "2a01f1": "7f2a11",
    "3d14000000001000": "7f3d11",
    "ff": "7fff11",
}

# In the extended session, locked.
LOCKED = {
    "1001": "5001003201f4",
    "1002": "5002003201f4",
    "1101": "5101",
    "1103": "5103",
    "1181": None,
    "1102": "7f1112",
    "11": "7f1113",
    "110100": "7f1113",
    "22f186": "62f18603",
    "2312000004": "63404b4c00",  # the period in ns, little-endian
    "23110004": "63404b4c00",
    "23440000000000000004": "63404b4c00",
    "23": "7f2313",
    "2314": "7f2313",
    "2311000400": "7f2313",
    "23000000": "7f2331",
    "23150000000000" + "04": "7f2331",
    "23110000": "7f2331",
    "2324ffffffff0010": "7f2331",
    "2702": "7f2713",
    "2702000000000000000a": "7f2724",  # no seed was asked for
    "2703": "7f2712",
    "27": "7f2713",
    "280001": "6800",
    "280103": "6801",
    "288103": None,
    "280201": "7f2812",
    "2801f1": "6801",  # of the network that it came by
    "280111": "7f2831",  # of another
    "280104": "7f2831",
    "280100": "7f2831",
    "2801": "7f2813",
    "2e10043fe0000000000000": "7f2e33",
    "2e0102020000": "7f2e31",  # cannot be written
    "2e1004": "7f2e13",
    "2f031100": "7f2f33",
    "2f010200": "7f2f31",
    "2f0311": "7f2f13",
    "31010201": "7f3133",
    "3101ffff": "7f3131",
    "31040201": "7f3112",
    "310102": "7f3113",
    "34004410000000000000ff": "7f347f",  # in the programming session only
    "3601": "7f3624",
    "37": "7f3724",
    "36": "7f3613",
    "3700": "7f3713",
    "35004420000000000000ff": "7f3531",
    "35104410000000000000ff": "7f3531",
    "3500441000000000": "7f3513",
    "350044100000000000ffff": "75200402",
    "8501": "c501",
    "8502": "c502",
    "8582": None,
    "8503": "7f8512",
    "85": "7f8513",
    "850100": "7f8513",
}

# In the extended session, unlocked, in STANDBY.
UNLOCKED = {
    "2701": "67010000000000000000",  # is unlocked
    "2e10043fe0000000000000": "6e1004",
    "2e100440240000000000": "7f2e13",
    "2e10044024000000000001": "7f2e31",  # more than 10 s
    "2e10047ff8000000000000": "7f2e31",  # no number
    "2e1105" + 40 * "00": "7f2e31",
    "2e1101" + 40 * "00": "6e1101",
    "2f0311034056800000000000": "6f0311034056800000000000",
    "2f031103c0b0000000000000": "7f2f31",  # -4096 turns
    "2f03110340568000000000": "7f2f13",
    "2f03110240568000000000": "7f2f13",
    "2f02110300030001": "6f02110300030001",
    "2f02110300100000": "7f2f31",  # a sensor that there is not
    "2f02110300000010": "7f2f31",
    "2f021100": "6f02110000000000",
    "2f031100": "6f0311000000000000000000",
    "2f031101": "6f0311010000000000000000",
    "2f031102": "6f0311020000000000000000",
    "2f031104": "7f2f31",
    "2f021103000f0003": "6f021103000f0003",
    "2f021101": "6f02110100000000",
    "31010203004056800000000000": "710102030100000000000000000001",
    "31010203024056800000000000": "7f3131",  # no third axis
    "310102030040568000000000": "7f3113",
    "31020203": "7f3124",
    "31030203": "7f3124",
    "31010204": "7f3122",  # does not navigate
    "31020201": "7f3112",
    "31010207": "7f3122",
    "31010206": "7101020602",
    "340044100000000000ffff": "7f347f",
}

# In the programming session, unlocked.
PROGRAMMING = {
    "34004410000000000000ff": "74200402",
    "340044100000000000ffff": "7f3431",  # too long
    "34004410000000000000": "7f3413",
    "34114410000000000000ff": "7f3431",
    "3400441000000000000000": "7f3431",
    "34": "7f3413",
    "22f186": "62f18602",
}


def cases(of: dict[str, str | None]) -> list[object]:
    return [pytest.param(ask, answer, id=ask[:24]) for ask, answer in of.items()]


@pytest.mark.parametrize(("ask", "answer"), cases(DEFAULT))
def test_in_the_default_session(standing_by, ask, answer):
    assert standing_by.ask(ask) == answer


@pytest.mark.parametrize(("ask", "answer"), cases(LOCKED))
def test_in_the_extended_session(standing_by, ask, answer):
    standing_by.ask("1003")
    assert standing_by.ask(ask) == answer


@pytest.mark.parametrize(("ask", "answer"), cases(UNLOCKED))
def test_unlocked(standing_by, ask, answer):
    standing_by.unlock()
    assert standing_by.ask(ask) == answer


@pytest.mark.parametrize(("ask", "answer"), cases(PROGRAMMING))
def test_in_the_programming_session(standing_by, ask, answer):
    standing_by.unlock(session=2)
    assert standing_by.ask(ask) == answer


def test_in_the_programming_session_locked(standing_by):
    standing_by.ask("1003")
    standing_by.ask("1002")
    assert standing_by.ask("34004410000000000000ff") == "7f3433"


def test_more_than_a_response_can_have(standing_by):
    standing_by.ask("1003")
    assert standing_by.ask("23120000" + "0f") is not None
    assert standing_by.ask("232200000fff") == "7f2314"
    answer = standing_by.ask("232200000ffe")
    assert answer is not None
    assert len(answer) == 2 * 4095


def test_while_navigating(tool_at):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN)
    tool.unlock()
    for ask, answer in {
        "31010201": "7f3122",  # the self-test is for STANDBY and FAULT
        "31010202": "7f3122",
        "310102050001" + "00": "7f3122",
        "31010204": "7101020401" + "05" + "0000" + "00000000",
        "31010203004056800000000000": "7f3122",  # not while the scheme turns the axes
        "2f031103" + "0" * 16: "7f2f22",
        "31020204": "7102020404" + "05" + "0000" + "00000000",
    }.items():
        assert tool.ask(ask) == answer, ask
