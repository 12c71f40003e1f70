"""The `heli-twin` command. Each subcommand is one file in `heli_twin/commands/` and is found there."""

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pkgutil import iter_modules

from heli_twin import commands
from heli_twin.errors import HeliTwinError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code: 0 done, 1 done with a bad answer, 2 the caller's mistake."""
    parser = argparse.ArgumentParser(
        prog="heli-twin",
        description="Fly a 28 g coaxial helicopter's digital twin, log it, replay it, study it.",
        epilog="Start with `heli-twin fly`. Every command explains itself: `heli-twin fly --help`.",
        allow_abbrev=False,
    )
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for found in iter_modules(commands.__path__):
        import_module(f"{commands.__name__}.{found.name}").add(subparsers)
    parsed, left = parser.parse_known_args(arguments)
    # argparse gives up on words that continue after an option: `fly lab --json seed=1`.
    words = next((getattr(parsed, name) for name in ("experiment", "overrides") if hasattr(parsed, name)), None)
    if left and (words is None or any(word.startswith("-") for word in left)):
        parser.error(f"unrecognized arguments: {' '.join(left)}")
    if words is not None:
        words.extend(left)
    try:
        code = parsed.run(parsed)
        sys.stdout.flush()
        return code
    except HeliTwinError as error:
        print(f"heli-twin: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("heli-twin: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of our output has gone; Python would complain once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
