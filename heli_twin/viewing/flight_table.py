"""Many flights as a table in Rerun: one row a flight, with a small picture that moves; a click opens the flight."""

import logging
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import TYPE_CHECKING, NamedTuple
from uuid import uuid4

import pyarrow as pa
import rerun.blueprint as rrb
from rerun.blueprint import table as rrt

from heli_twin.errors import HeliTwinError
from heli_twin.flight import INTACT
from heli_twin.logbook import viewed_experiment
from heli_twin.recording import Log, read_log
from heli_twin.recording.records import Messages
from heli_twin.viewing.blueprint import TIMELINE, Scales, layout, scene
from heli_twin.viewing.delivery import APPLICATION, Destination
from heli_twin.viewing.live import show
from heli_twin.viewing.ranges import ranges
from heli_twin.viewing.show import scales_of, with_truth
from heli_twin.viewing.viewer_process import HOST

if TYPE_CHECKING:
    from rerun.catalog import DatasetEntry

FLIGHT = "flight"
"""The column with the pictures."""
TILE_DISTANCE = 1.7
"""Distance of the camera in a small picture, times that in a large one: it is higher than wide."""
WHOLE_PICTURES = 64
"""Flights that are shown whole. Rerun's server keeps 30 s of flight in 20 MB of memory; those further down, with every
tenth sample, take 7 MB."""
THINNED = 10
"""Of how many samples one is shown further down."""
READY_FIRST = 8
"""Pictures that are made before the table is shown: more than a window has rows."""

_LOGGER = logging.getLogger(__name__)


class FlightTable(NamedTuple):
    """The rows of a table of flights, in the order in which they are shown."""

    title: str
    columns: pa.Table
    """Numbers and texts; their names are the headings."""
    logs: Sequence[Path | None]
    """The log of each row; None where none was kept."""


@contextmanager
def served(flights: FlightTable, port: int | None = None) -> Generator[str]:
    """Serve a table of flights to this machine while the block lasts; yields its address for a viewer.

    The pictures of the first rows are made before, the others meanwhile, in the order of the table.

    Args:
        flights: The rows.
        port: Of the server; None for a free one.

    Raises:
        HeliTwinError: Rerun's catalog is not installed, or there is no row.
    """
    try:
        import datafusion as datafusion
        from rerun.server import Server
    except ImportError:
        raise HeliTwinError("a table of flights needs Rerun's catalog: pip install 'heli-twin[table]'") from None
    if not len(flights.logs):
        raise HeliTwinError(f"{flights.title} has no flights to show")
    stop = Event()
    with (
        TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        Server(host=HOST, port=port) as server,
        ThreadPoolExecutor(1) as background,
    ):
        client = server.client()
        dataset = client.create_dataset("flights")
        kept = [log for log in flights.logs if log is not None]
        names = {log: uuid4().hex for log in kept}
        ids = [names.get(log) if log is not None else None for log in flights.logs]
        makers = _Makers(dataset, Path(folder), stop)
        wanted = [(log, name, 1 if i < WHOLE_PICTURES else THINNED) for i, (log, name) in enumerate(names.items())]
        first = [makers.picture(*each) for each in wanted[:READY_FIRST]]
        path = first[0][1].path if first else None
        # All flights have one layout: the axes fit the first ones, but for flights that went who knows where.
        fitting = [log for log, _ in first if log.outcome in INTACT] or [log for log, _ in first]
        background.submit(makers.pictures, wanted[READY_FIRST:])
        shown = layout(Scales(path=path, ranges=ranges(fitting)))
        dataset.register_blueprint(_saved(shown, Path(folder) / "flight.rbl"))
        links = pa.array([dataset.segment_url(name) if name else None for name in ids], pa.string())
        # The server's tables take no points in the names of columns; the headings have them.
        sources = [_source(number) for number in range(flights.columns.num_columns)]
        columns = flights.columns.rename_columns(sources).add_column(0, FLIGHT, links)
        entry = client.create_table(_title(flights.title), columns.schema)
        entry.append(columns.to_batches())
        entry.register_blueprint(
            _saved(_blueprint(flights, scene("Flight", path, distance=TILE_DISTANCE)), Path(folder) / "table.rbl")
        )
        try:
            yield f"{server.url()}/entry/{entry.id}"
        finally:
            stop.set()


class _Makers:
    """Makes pictures of flights and hands them to the server."""

    def __init__(self, dataset: "DatasetEntry", folder: Path, stop: Event) -> None:
        self._dataset, self._folder, self._stop = dataset, folder, stop

    def pictures(self, wanted: Sequence[tuple[Path, str, int]]) -> None:
        """Make all of them, until it is told to stop; one that cannot be made is told and left out."""
        for log, name, every in wanted:
            if self._stop.is_set():
                return
            try:
                self.picture(log, name, every)
            # Whatever is wrong with a log costs its picture alone.
            except Exception as error:
                _LOGGER.warning("%s has no picture: %s", log, error)

    def picture(self, path: Path, name: str, every: int) -> tuple[Log, Scales]:
        """Make that of one of `every` samples of a log, under a name; returns what its plots show and compare with."""
        log = thinned(read_log(path), every)
        scales = scales_of(viewed_experiment(log)).for_source(log).for_log(with_truth(log))
        file = self._folder / f"{name}.rrd"
        show(with_truth(log), Destination(file=file, recording=name, name=path.stem), scales)
        self._dataset.register([file.as_uri()]).wait()
        return with_truth(log), scales


def thinned(log: Log, every: int) -> Log:
    """A log with one of `every` samples, the first one included; of topics with few messages it keeps all."""
    return replace(
        log,
        messages={
            topic: Messages(messages.times[::every], messages.data[::every])
            if len(messages.times) > FEW_MESSAGES
            else messages
            for topic, messages in log.messages.items()
        },
    )


FEW_MESSAGES = 100
"""Events and planned paths are fewer in a flight, samples are more."""


def _blueprint(flights: FlightTable, picture: rrb.View) -> rrt.TableBlueprint:
    """Pictures to the left, then the columns."""
    columns = [
        rrt.Column(FLIGHT, name="Flight", column_type=rrt.PreviewCell(picture)),
        *(rrt.Column(_source(i), name=heading) for i, heading in enumerate(flights.columns.column_names)),
    ]
    moving = rrt.PreviewsConfig(timeline=TIMELINE, play_state="playing", start_point=0.0)
    return rrt.TableBlueprint(table_layout=rrt.TableLayout(columns=columns), previews_config=moving)


def _source(number: int) -> str:
    return f"column_{number}"


def _saved(blueprint: rrb.Blueprint | rrt.TableBlueprint, file: Path) -> str:
    blueprint.save(APPLICATION, file)
    return file.as_uri()


def _title(text: str) -> str:
    """A name that Rerun's catalog takes."""
    return "".join(c if c.isalnum() or c in "-_ " else "_" for c in text)[:60] or "flights"
