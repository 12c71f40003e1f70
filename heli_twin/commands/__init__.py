"""The subcommands of `heli-twin`. One file here is one command, found without a registry.

Each has `add(subparsers)`, which adds an argparse parser with `set_defaults(run=...)`; `run(parsed)` does the work and
returns the exit code. Heavy imports belong inside `run`. A user's mistake is a `HeliTwinError` of one sentence. Text
from logs, files and arguments is printed by `say`.
"""

import sys
from argparse import (
    PARSER,
    Action,
    ArgumentParser,
    ArgumentTypeError,
    Namespace,
    RawDescriptionHelpFormatter,
    _SubParsersAction,
)
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Self, TypeVar

from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean, pasteable

if TYPE_CHECKING:
    from rich.progress import Progress

T = TypeVar("T")
LINE_LIMIT = 5000
"""Characters of one printed line: room for a sentence and the longest path."""


class Parser(ArgumentParser):
    """A parser that takes words before, between and after the options, and refuses a mistake in one sentence."""

    _inside = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Parse, options first; a command line that goes on in a subcommand is left to the subcommand's parser."""
        if self._inside or any(action.nargs == PARSER for action in self._actions):
            return super().parse_known_args(args, namespace)
        self._inside = True
        try:
            parsed, unknown = self.parse_known_intermixed_args(args, namespace)
        finally:
            self._inside = False
        if unknown:
            options = [word for word in unknown if word.startswith("-")]
            self.error(f"unrecognized arguments: {' '.join(options or unknown)}")
        return parsed, []

    def print_help(self, file: Any = None) -> None:
        """Print the help; argparse itself does not notice an output that cannot be written."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """Print a sentence and exit with 2."""
        self.exit(2, f"{self.prog}: {clean(message, 400)}; see `{pasteable(*self.prog.split(), '--help')}`\n")


class Version(Action):
    """`--version`."""

    def __call__(self, parser: ArgumentParser, *_: Any) -> NoReturn:
        """Print the versions of the package, of what a flight does and of what a log holds."""
        from importlib.metadata import PackageNotFoundError, version

        from heli_twin.experiment.past import PHYSICS_VERSION
        from heli_twin.recording.schema import FORMAT

        try:
            ours = version("heli-twin")
        except PackageNotFoundError:
            ours = "not installed"
        print(f"heli-twin {ours}, physics {PHYSICS_VERSION}, log format {FORMAT}")
        parser.exit()


def command(
    subparsers: "_SubParsersAction[ArgumentParser]",
    name: str,
    run: Callable[[Namespace], int],
    summary: str,
    description: str,
    examples: str,
) -> ArgumentParser:
    """Add a subcommand whose help teaches by example."""
    parser = subparsers.add_parser(
        name,
        help=summary,
        description=description,
        epilog=f"examples:\n{examples}",
        formatter_class=RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


def command_line(word: str = "") -> Parser:
    """The parser of the command line: of one command if the first word names it, else of all."""
    parser = Parser(
        prog="heli-twin",
        description="Fly a 28 g coaxial helicopter's digital twin, log it, replay it, study it.",
        epilog="Start with `heli-twin fly`. Every command explains itself: `heli-twin fly --help`."
        " `heli-twin guide` has pages on what can be done.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=Version, nargs=0, help="show the versions that fly, and exit")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    # `pkgutil` would load `inspect`, which takes as long as all the commands.
    names = [file.stem for file in sorted(Path(__file__).parent.glob("[!_]*.py"))]
    for name in [word] if word in names else names:
        import_module(f"{__name__}.{name}").add(subparsers)
    return parser


def add_experiment(parser: ArgumentParser) -> None:
    """Add the arguments that say what to fly; `experiment_arguments` reads them."""
    parser.add_argument(
        "experiment",
        nargs="*",
        default=[],
        metavar="PRESET | EXPERIMENT.toml | path.to.field=value",
        help="what to fly: a preset (lab, ideal) or a TOML file, then changes of single fields; default lab",
    )


def experiment_arguments(parsed: Namespace) -> tuple[str | None, list[str]]:
    """The preset or file, if one was given, and the overrides."""
    words: list[str] = list(parsed.experiment)
    source = next((word for word in words if "=" not in word), None)
    if source is not None:
        words.remove(source)
    return source, words


def names_several(source: str) -> bool:
    """Return whether a preset or a TOML file is of several helicopters."""
    from heli_twin.experiment.toml_file import is_several

    return is_several(source)


def file_path(text: str) -> Path:
    """The type of an argument that names a file."""
    if not Path(text).name:
        raise ArgumentTypeError(f"'{text}' is a folder: give the name of a file")
    return Path(text)


def add_with(parser: ArgumentParser) -> None:
    """Add `--with`, for logs that were flown by classes of a user's own; `load_with` reads it."""
    parser.add_argument(
        "--with",
        dest="own",
        action="append",
        default=[],
        metavar="FILE.py | PACKAGE.MODULE:CLASS | PROGRAM",
        help="the control law or another member of your own that the log was flown with, since a log holds no code;"
        ' or the program of an external law: ./pid, or with arguments \'["python3", "law.py"]\'',
    )


def load_with(parsed: Namespace) -> None:
    """Load the members that `--with` names, and supply the programs.

    Raises:
        HeliTwinError: One cannot be loaded.
    """
    if parsed.own:
        from controllers.programs import supply
        from heli_twin.experiment.named_classes import is_reference, own_members

        for reference in parsed.own:
            if is_reference(reference):
                own_members(reference)
                continue
            try:
                supply(command_words(reference))
            except ValueError as error:
                raise HeliTwinError(f"--with: {error}") from None


def command_words(text: str) -> list[str]:
    """The words of a command: a list as TOML and JSON write it, or a program without arguments.

    Raises:
        HeliTwinError: It begins like a list and is none of texts.
    """
    if not text.startswith("["):
        return [text]
    import tomllib

    try:
        words = tomllib.loads(f"v = {text}")["v"]
    except (ValueError, RecursionError):
        words = None
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words) or not words:
        raise HeliTwinError(f"'{clean(text, 80)}' is no command: write a list of texts, '[\"python3\", \"law.py\"]'")
    return words


def say(line: str) -> None:
    """Print a line in which text from logs, files or arguments may stand: no control characters, not too long."""
    print(clean(line, LINE_LIMIT))


class NoBar:
    """Stands for the progress bar where no terminal could show it, and costs nothing."""

    disable = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def start(self) -> None:
        """Show nothing."""

    def stop(self) -> None:
        """Show nothing."""

    def add_task(self, description: str, *, total: float | None) -> Any:
        """Return what names the task in `update` and `advance`."""

    def update(self, task: Any, **_: Any) -> None:
        """Show nothing."""

    def advance(self, task: Any) -> None:
        """Show nothing."""

    def track(self, sequence: Iterable[T], **_: Any) -> Iterable[T]:
        """Return what is done one by one."""
        return sequence


def progress_bar() -> "Progress | NoBar":
    """The bar of every command: on the standard error where that is a terminal, and gone when the work is done."""
    if sys.stderr is None or not sys.stderr.isatty():
        return NoBar()
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
        console=Console(stderr=True),
        transient=True,
    )
