"""Help in groups, and commands that are imported when they are called or asked for their help.

Typer draws groups only through rich, which costs twice the processor time.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

MAIN = "Options"
"""Heading of options that belong to no other group: those used most."""


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """A command, before it is imported.

    summary: what `roadscope --help` says of it, one line of at most 60 characters.
    group: its heading there.
    examples: lines for a shell that work as they are, after those of earlier commands.
    function: in the module of `roadscope.commands` that has the command's name; may also be a
        `typer.Typer`. Empty: it has that name too.
    """

    summary: str
    group: str
    examples: tuple[str, ...]
    function: str = ""

    def load(self, name: str) -> Any:
        """Import the command and return it as Typer runs it."""
        module = name.replace("-", "_")
        loaded = getattr(import_module(f"roadscope.commands.{module}"), self.function or module)
        if isinstance(loaded, typer.Typer):
            command: Any = typer.main.get_command(loaded)
        else:
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            alone.command(name, cls=RegisteringCommand)(loaded)
            command = typer.main.get_command(alone)
        command.examples = self.examples
        return command


class _Help:
    """Help with the options in groups, then the examples, each on a line of its own."""

    examples: Sequence[str] = ()

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write arguments, then the options of each group; `--help` itself is left out."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            if param.name != "help" and (record := param.get_help_record(ctx)) is not None:
                usual = "Arguments" if param.param_type_name == "argument" else MAIN
                group = groups.setdefault(param.rich_help_panel or usual, [])
                group.append((record[0], param.help + _default(param)))
        _write_groups(formatter, groups)

    def format_epilog(self: Any, ctx: Any, formatter: Any) -> None:
        """Write the examples, unbroken, so that they can be copied."""
        if self.examples:
            formatter.write(f"\n{_heading('Examples')}:\n")
            formatter.write("".join(f"  {line}\n" for line in self.examples))


class GroupedCommand(_Help, TyperCommand):
    """A command whose help, its docstring, shows options in groups."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.help = _paragraphs(self.help or "")


class RegisteringCommand(GroupedCommand):
    """A command, before which the Gymnasium ids are registered: `--help` does without Gymnasium."""

    def invoke(self, ctx: Any) -> Any:
        """Register the ids, then run the command."""
        from roadscope.envs.gym.registration import register

        register()
        return super().invoke(ctx)


class GroupedCommands(_Help, TyperGroup):
    """The commands of a table, listed in groups without importing them."""

    entries: Mapping[str, CommandEntry] = {}

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        not_loaded: Any = dict.fromkeys(self.entries)
        self.commands.update(not_loaded)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, which is imported now; None if there is none of that name."""
        entry = self.entries.get(cmd_name)
        return super().get_command(ctx, cmd_name) if entry is None else entry.load(cmd_name)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands of each group, then the options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, entry in self.entries.items():
            groups.setdefault(entry.group, []).append((name, entry.summary))
        _write_groups(formatter, groups)
        _Help.format_options(self, ctx, formatter)
        if not self.entries:
            self.format_commands(ctx, formatter)


def command_group(summary: str) -> typer.Typer:
    """Return a group for commands of its own; without a command it shows its help."""
    group = typer.Typer(
        cls=GroupedCommands, help=summary, add_completion=False, rich_markup_mode=None
    )

    @group.callback(invoke_without_command=True)
    def show_help(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            typer.echo(context.get_help())

    return group


def _write_groups(formatter: Any, groups: Mapping[str, Iterable[tuple[str, str]]]) -> None:
    """Write rows under headings, with one width of the first column for all."""
    rows = [row for group in groups.values() for row in group]
    width = max((len(name) for name, _ in rows if len(name) <= MAX_NAME), default=0)
    formatter.write("\n" * bool(rows))
    for heading, group in groups.items():
        formatter.write(f"{_heading(heading)}:\n")
        with formatter.indentation():
            formatter.write_dl([(name.ljust(width), text) for name, text in group], MAX_NAME)


MAX_NAME = 30
"""Longest name of an option, with its value, that has its text on the same line."""


def _heading(text: str) -> str:
    return typer.style(text, bold=True) if sys.stdout.isatty() else text


def _default(param: Any) -> str:
    default = param.default
    shown = param.show_default and default not in (None, "", ()) and default is not False
    return f"  [default: {default}]" if shown and not param.required else ""


def _paragraphs(docstring: str) -> str:
    """Return a docstring of which each paragraph is one line: terminals break them themselves."""
    return "\n\n".join(" ".join(each.split()) for each in inspect.cleandoc(docstring).split("\n\n"))
