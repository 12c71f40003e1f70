"""`heli-twin show`: the effective experiment."""

from argparse import ArgumentParser, Namespace, _SubParsersAction

from heli_twin.commands import add_experiment, command, experiment_arguments, names_several


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "show",
        run,
        "print an experiment as TOML, every field with its unit and meaning",
        "Print the effective experiment as TOML. What it prints, `heli-twin fly` takes.",
        "  heli-twin show\n  heli-twin show ideal trajectory=hover > mine.toml\n  heli-twin fly mine.toml",
    )
    add_experiment(parser)


def run(parsed: Namespace) -> int:
    """Print it."""
    from heli_twin.experiment.text import load
    from heli_twin.experiment.tree import toml_of

    source, overrides = experiment_arguments(parsed)
    if source is not None and names_several(source):
        from heli_twin.experiment.several_text import load_several
        from heli_twin.experiment.several_written import several_toml

        print(several_toml(load_several(source, overrides)), end="")
        return 0
    print(toml_of(load(source, overrides)), end="")
    return 0
