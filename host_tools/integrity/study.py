"""A campaign of random cases: Stanford diagram, risk, availability, time to alert."""

from __future__ import annotations

import shlex
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rrins.host_tools.campaigns.statistics import Estimate, proportion
from rrins.host_tools.campaigns.summary import shown
from rrins.host_tools.drawing.page import REPORT, write_report
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject, make_folder, write_text
from rrins.host_tools.integrity import cases
from rrins.host_tools.integrity.cases import Case
from rrins.host_tools.integrity.healthy import Healthy, healthy_of
from rrins.host_tools.integrity.pictures import stanford_figure
from rrins.host_tools.integrity.risk import Stratum, hourly, strata_of
from rrins.host_tools.integrity.stanford import NAMES, Counts, no_counts
from rrins.host_tools.integrity.trial import Result, judged, no_seconds, run
from rrins.host_tools.integrity.words import percent
from rrins.host_tools.scenario.scenario import Scenario

_CASES = "cases"


@dataclass
class Study:
    """Random cases, of some scenarios or of none, and what came of them."""

    cases: int
    seed: int = 1
    bases: Sequence[tuple[str, Scenario]] = ()  #: names and scenarios, in turns; all drawn without
    results: list[Result] = field(default_factory=list)  #: without their counts
    counts: Counts = field(default_factory=no_counts)

    def case(self, number: int) -> Case:
        """Return a case, from 0."""
        base = self.bases[number % len(self.bases)][1] if self.bases else None
        return cases.draw(self.seed, number, base)

    def run(
        self,
        workers: int,
        stop: threading.Event,
        on_done: Callable[[], None] = lambda: None,
    ) -> None:
        """Run the cases; once stopped, `results` has those that are done."""

        def tried(number: int) -> Result | None:
            if stop.is_set():
                return None
            case = self.case(number)
            try:
                return run(case, stop.is_set)
            except Exception as error:  # noqa: BLE001 - a case that breaks is a row with its reason
                why = str(error) if isinstance(error, RehearsalError) else repr(error)
                return judged(case, no_seconds(), ended=why)

        with ThreadPoolExecutor(workers) as pool:
            for result in pool.map(tried, range(self.cases)):
                if result is not None:
                    self.counts += result.counts
                    self.results.append(result.without_counts())
                    on_done()

    @property
    def title(self) -> str:
        """Whose cases these are."""
        return (
            ", ".join(name for name, _ in self.bases) or "random sites, motions, sensors and aids"
        )

    @property
    def strata(self) -> list[Stratum]:
        """The kinds of cases."""
        return strata_of(self.results)

    @property
    def hours(self) -> float:
        """Navigated time."""
        return sum(one.seconds for one in self.results) / 3600

    @property
    def misleading(self) -> list[Result]:
        """The cases whose error went beyond a bound while the unit called itself available."""
        return [one for one in self.results if one.is_misleading and not one.case.is_beyond]

    @property
    def misleading_beyond(self) -> list[Result]:
        """The same by faults that the unit assumes never to happen."""
        return [one for one in self.results if one.is_misleading and one.case.is_beyond]

    @property
    def sound_left_out(self) -> list[Result]:
        """The cases in which a sound sensor was left out."""
        return [one for one in self.results if one.sound_left_out]

    @property
    def broken(self) -> list[Result]:
        """The cases that ended in FAULT, or could not run."""
        return [one for one in self.results if one.ended]

    def availability(self, kind: str | None = None) -> dict[str, float]:
        """Return the shares of the seconds available, degraded and not available."""
        own = [one for one in self.results if kind in (None, one.case.stratum)]
        seconds = sum(one.seconds for one in own)
        available, degraded = sum(one.available for one in own), sum(one.degraded for one in own)
        shares = {"available": available, "degraded": degraded}
        shares["not_available"] = seconds - available - degraded
        return {name: value / max(seconds, 1) for name, value in shares.items()}

    @property
    def risk_per_h(self) -> float:
        """The risk that the units state: the largest."""
        return max((one.case.scenario.integrity.risk_per_h for one in self.results), default=0.0)

    @property
    def hourly(self) -> Estimate:
        """Misleading cases per hour, by the priors."""
        return hourly(self.strata)

    def misleading_seconds(self) -> tuple[int, ...]:
        """Return the seconds available with the error beyond each bound."""
        rows = [one.misleading for one in self.results] or [(0, 0, 0)]
        return tuple(int(count) for count in np.sum(rows, axis=0))

    @property
    def healthy(self) -> list[Healthy]:
        """The healthy cases: all first, then by preset of the sensors and by aids."""
        return healthy_of(self.results)

    def to_alert_s(self) -> list[float]:
        """Return the times to alert of the cases whose error went beyond a limit, longest first."""
        return sorted((one.to_alert_s for one in self.results if one.to_alert_s), reverse=True)

    def values(self) -> JsonObject:
        """Return all figures as plain values."""
        alerts = self.to_alert_s()
        return {
            "title": self.title,
            "seed": self.seed,
            "planned": self.cases,
            "done": len(self.results),
            "hours": round(self.hours, 3),
            "misleading": {
                "cases": [one.case.number for one in self.misleading],
                "seconds": dict(zip(NAMES, self.misleading_seconds(), strict=True)),
                "beyond": [one.case.number for one in self.misleading_beyond],
                "share": proportion(len(self.misleading), len(self.results)).values(),
                "per_h": self.hourly.values(),
                "stated_per_h": self.risk_per_h,
            },
            "strata": [
                {
                    "kind": one.kind,
                    "cases": one.cases,
                    "misleading": one.misleading,
                    "share": one.share.values(),
                    "prior_per_h": one.prior_per_h,
                    "availability": self.availability(one.kind),
                }
                for one in self.strata
            ],
            "availability": self.availability(),
            "healthy": [group.values() for group in self.healthy],
            "time_to_alert_s": {"cases": len(alerts), "longest": alerts[0] if alerts else None},
            "sound_left_out": [
                {"case": one.case.number, "sensors": list(one.sound_left_out)}
                for one in self.sound_left_out
            ],
            "broken": [{"case": one.case.number, "why": one.ended} for one in self.broken],
        }

    def listed(self) -> list[Result]:
        """Return the cases to look at: misleading, with a sound sensor left out, broken."""
        found = [*self.misleading, *self.misleading_beyond, *self.sound_left_out, *self.broken]
        return list({one.case.number: one for one in found}.values())

    def write(self, folder: Path) -> tuple[list[Path], dict[int, str]]:
        """Write page, picture and the scenarios of the cases to look at.

        Returns
        -------
        list of Path
            Page and picture.
        dict of int to str
            The command that repeats a case, by number.

        Raises
        ------
        RehearsalError
            When they cannot be written.
        """
        commands = {}
        listed = self.listed()
        if listed:
            make_folder(folder / _CASES)
        for one in listed:
            path = folder / _CASES / f"{self.seed}-{one.case.number}.toml"
            write_text(path, one.case.scenario.toml())
            commands[one.case.number] = f"rrins simulate {shlex.quote(str(path))}"
        paths = write_report(
            folder,
            "rrins.host_tools.integrity",
            {"stanford": stanford_figure(self.counts, self.alerts)},
            keeps=(REPORT,),
            filters={"shown": shown, "percent": percent},
            study=self,
            bounds=NAMES,
            listed=listed,
            commands=commands,
            share=proportion(len(self.misleading), len(self.results)),
        )
        return paths, commands

    @property
    def alerts(self) -> tuple[float, float, float]:
        """The alert limits, in the units of the diagrams."""
        base = self.bases[0][1] if self.bases else None
        settings = (base or self.results[0].case.scenario).integrity
        return settings.horizontal_alert_m, settings.vertical_alert_m, settings.heading_alert_deg
