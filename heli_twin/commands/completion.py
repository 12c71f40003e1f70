"""`heli-twin completion`: a script with which a shell completes commands, options and files."""

from argparse import ArgumentParser, Namespace, _SubParsersAction

from heli_twin.commands import command, command_line

SHELLS = ("bash", "zsh", "fish", "tcsh")


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "completion",
        run,
        "print what makes a shell complete commands and options",
        "Print a script that makes a shell complete the commands, options and files of heli-twin.",
        '  eval "$(heli-twin completion bash)"                    # in this shell; in ~/.bashrc for every one\n'
        "  heli-twin completion zsh > ~/.zfunc/_heli-twin         # a folder of $fpath\n"
        "  heli-twin completion fish > ~/.config/fish/completions/heli-twin.fish",
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(parsed: Namespace) -> int:
    """Print it."""
    import shtab

    print(shtab.complete(command_line(), parsed.shell))
    return 0
