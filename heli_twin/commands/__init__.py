"""The subcommands of `heli-twin`. One file here is one command, found without a registry.

Each has `add(subparsers)`, which adds an argparse parser with `set_defaults(run=...)`; `run(parsed)` does the work and
returns the exit code. Heavy imports belong inside `run`. A user's mistake is a `HeliTwinError` of one sentence.
"""

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter, _SubParsersAction
from collections.abc import Callable


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


def add_experiment(parser: ArgumentParser) -> None:
    """Add the arguments that say what to fly; `experiment_arguments` reads them."""
    parser.add_argument(
        "experiment",
        nargs="*",
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
