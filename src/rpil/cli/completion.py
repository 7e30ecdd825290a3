"""``rpil --install-completion``: the shell completes commands, options, choices and files; click writes the script."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from rpil.data.files import replacing

SCRIPTS = {"bash": ".rpil-complete.bash", "zsh": ".rpil-complete.zsh", "fish": ".config/fish/completions/rpil.fish"}
"""Shell -> file in the home folder. fish reads its file by itself; the others by a line in their start file."""

_LOAD_COMPDEF = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }\n"
"""What the script needs of zsh."""


def install_completion(ctx: click.Context, _: click.Parameter, shell: str | None) -> None:
    """Callback of the option: install the script, say where, and end the command."""
    if shell is None or ctx.resilient_parsing:
        return
    shell = shell or Path(os.environ.get("SHELL", "")).name
    completion = get_completion_class(shell)
    if shell not in SCRIPTS or completion is None:
        raise click.UsageError(f"there is no completion for the shell {shell!r}: name one of {', '.join(SCRIPTS)}", ctx)
    script = Path.home() / SCRIPTS[shell]
    script.parent.mkdir(parents=True, exist_ok=True)
    source = completion(ctx.command, {}, "rpil", "_RPIL_COMPLETE").source()
    with replacing(script) as temporary:
        temporary.write_text((_LOAD_COMPDEF if shell == "zsh" else "") + source, encoding="utf-8")
    read_by = [] if shell == "fish" else [_add_line(Path.home() / f".{shell}rc", f". {shlex.quote(str(script))}")]
    click.echo(f"Completion for {shell}: {', read by '.join([str(script), *read_by])}. Start a new shell to use it.")
    ctx.exit()


def _add_line(file: Path, line: str) -> str:
    """Add a line to a start file, unless it is there; the name of the file."""
    text = file.read_text(encoding="utf-8", errors="surrogateescape") if file.exists() else ""
    if line not in text.splitlines():
        with open(file, "a", encoding="utf-8") as stream:
            stream.write(f"{'' if text.endswith(chr(10)) or not text else chr(10)}{line}\n")
    return str(file)
