"""The page of a study that is still running: progress, failures and the first maps. It refreshes itself."""

import html
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, process_time

from heli_twin.errors import HeliTwinError
from heli_twin.reporting.figure import Figure, Table
from heli_twin.reporting.html_page import Section, html_page, table_section
from heli_twin.reporting.svg import write_svg
from heli_twin.studies import PAGE
from heli_twin.studies.campaign import StudyProgress
from heli_twin.studies.report.boundary import boundary
from heli_twin.studies.report.ladder import ladder
from heli_twin.studies.report.maps import maps
from heli_twin.studies.report.results import Results, results_of
from heli_twin.studies.report.tables import worst
from heli_twin.studies.report.tornado import tornado
from heli_twin.studies.report.verdict import verdict
from heli_twin.studies.study import Study
from heli_twin.whole_file import write_whole

REFRESH_S = 10
"""Time after which a browser loads the page again, and the least time between two pages."""
MAX_TIME_SHARE = 0.03
"""Greatest share of the time that pages take: they are made by the process that hands out the flights."""
SECTIONS: tuple[Callable[[Results], Iterator[Figure | Table]], ...] = (
    verdict,
    ladder,
    tornado,
    maps,
    boundary,
    worst,
)


class ProgressPage:
    """Writes `report.html` now and then while a study is flown; the whole report takes its place."""

    def __init__(self, study: Study, folder: Path, began: float) -> None:
        """Begin without a page.

        Args:
            study: What is flown.
            folder: Of its results.
            began: When its flights began, by `time.monotonic`.
        """
        self._study, self._folder, self._began = study, folder, began
        self._next = monotonic()

    def __call__(self, progress: StudyProgress) -> None:
        """Write the page if it is due."""
        if monotonic() < self._next or not progress.flown:
            return
        began = process_time()
        sections = [Section("Progress", self._bar(progress)), *_parts(self._folder)]
        text = html_page(self._study.name.replace("_", " "), self._study.question, sections, style=STYLE)
        self._write(text.replace("<title>", f"{REFRESH}<title>", 1))
        self._next = monotonic() + max(REFRESH_S, (process_time() - began) / MAX_TIME_SHARE)

    def close(self, state: str) -> None:
        """Let the page, if there is one, no longer refresh itself, and say why."""
        try:
            text = (self._folder / PAGE).read_text(encoding="utf-8")
        except OSError:
            return
        if REFRESH in text:
            self._write(text.replace(REFRESH, "", 1).replace(REFRESHES, html.escape(state), 1))

    def _write(self, text: str) -> None:
        """Write the page; a folder that takes none costs the page and not the study."""
        with suppress(OSError):
            write_whole(self._folder / PAGE, text.encode())

    def _bar(self, progress: StudyProgress) -> str:
        share = 100 * progress.done / max(progress.total, 1)
        rate = progress.flown / max(monotonic() - self._began, 1e-3)
        failed = ", ".join(f"{number} {kind}" for kind, number in sorted(progress.failed.items())) or "none failed"
        left = _told((progress.total - progress.done) / max(rate, 1e-9))
        facts = (f"{progress.done} of {progress.total} flights", html.escape(failed), f"{rate:.1f} flights/s", left)
        said = " · ".join([*facts, REFRESHES])
        return f'<div class="bar"><div style="width:{share:.1f}%"></div></div><p>{said}</p>'


REFRESH = f'<meta http-equiv="refresh" content="{REFRESH_S}">'
REFRESHES = f"running: this page refreshes itself every {REFRESH_S} s"


def _told(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s left"
    return f"{seconds / 60:.0f} min left" if seconds < 7200 else f"{seconds / 3600:.1f} h left"


def _parts(folder: Path) -> Iterator[Section]:
    """What the flights so far say; nothing before the first one."""
    try:
        results = results_of(folder)
    except HeliTwinError:
        return
    with TemporaryDirectory() as place:
        for section in SECTIONS:
            yield from _drawn(section, results, Path(place))


def _drawn(section: Callable[[Results], Iterator[Figure | Table]], results: Results, place: Path) -> Iterator[Section]:
    """A section of the report; one that does not make sense of half of the points is left out."""
    try:
        for part in section(results):
            if isinstance(part, Table):
                yield table_section(part)
            else:
                write_svg(part, place / "figure.svg")
                drawn = b64encode((place / "figure.svg").read_bytes()).decode()
                image = f'<img alt="{html.escape(part.title)}" src="data:image/svg+xml;base64,{drawn}">'
                yield Section(part.title, f"<p>So far: {html.escape(part.sentence)}</p>{image}")
    except (ValueError, IndexError, KeyError):
        return


STYLE = """
.bar { background: #eee; height: 1.1rem; border-radius: .3rem; overflow: hidden; max-width: 75ch; }
.bar div { background: #0072B2; height: 100%; }
img { max-width: 100%; }
"""
